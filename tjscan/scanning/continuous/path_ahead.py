"""The path that the arm follows, and its continuation along the seam ahead."""

from __future__ import annotations

from dataclasses import replace
from math import ceil, sqrt
from typing import Final, Self

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from tjscan.core.errors import ConfigurationError, PathNotExtended, PoseUnreachable
from tjscan.core.frames import Array, array_dataclass, inverse_pose, pose, unit_vector
from tjscan.core.pose_vector import pose_from_vector, pose_to_vector
from tjscan.robot.following import JointMotion
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import LARGEST_JOINT_TURN, MotionLimits, linear_waypoints
from tjscan.robot.time_optimal import LengthOverTime, PathTiming, joint_motion
from tjscan.scanning.continuous.seam_ahead import SeamAhead
from tjscan.scanning.sections_before import PLANNING_SPACING

PLANNING_TIME: Final = 0.3
"""Seconds from the state that a path is planned for until the arm can be on it."""

STARTING_TIME: Final = 0.35
"""Seconds that a path from rest begins later, where the arm's clock goes on meanwhile."""

KEPT_KNOTS: Final = 4
"""Knots of the old path that the new one keeps beyond: a spline bends before it turns off."""

KNOT_SPACING: Final = 4e-3
"""Metres between the joint angles that a path runs through."""

BLEND_LENGTH: Final = 40e-3
"""Metres over which a path goes over from the one before to the seam as it is seen now."""

MOST_TIMES_AS_FAST: Final = 3.0
"""As between the taught poses the groove may be followed elsewhere: on joints of 219 to 610 mm the
flange moves 2.2 to 4.4 times as fast as the groove, hand-taught poses turn it, too. Twice refused
joints of 168 mm that were followed whole."""

SHUTTLE_AMPLITUDE: Final = 4e-3
"""Metres to either side that the laser goes across the groove, and half of it nearer and back."""

SHUTTLE_CYCLES: Final = 2
SHUTTLE_SPEED: Final = 0.04
"""Metres per second: 1.5 cycles a second."""

SLOPE_LENGTH: Final = 1e-3
"""Metres over which a slope is taken as a difference."""


@array_dataclass
class FollowedPath:
    """A path of the joints over the length along the groove, and the length over time.

    Parameters
    ----------
    q : CubicSpline
        Joint angles in radians over metres.
    gone : LengthOverTime
        Metres over seconds on the arm's clock.
    """

    q: CubicSpline
    gone: LengthOverTime

    @classmethod
    def standing(cls, q: Array, length: float, time: float) -> Self:
        """No path yet: joint angles, shape (n,), at a length, from a time on."""
        still = CubicSpline((length - SLOPE_LENGTH, length), (q, q))
        times = np.array((time - 1.0, time))
        return cls(still, LengthOverTime(times, np.full(2, length), np.zeros(2)))

    def begun_from_rest(self, now: float) -> Self:
        """The same, but later if the arm took its time until it could follow."""
        late = now + PLANNING_TIME - self.gone.times[0]
        if late <= 0.0:
            return self
        gone = replace(self.gone, times=self.gone.times + late + STARTING_TIME)
        return replace(self, gone=gone)

    @property
    def leads_on(self) -> bool:
        """Whether it leads anywhere."""
        return bool(self.gone.speeds.any())

    @property
    def motion(self) -> JointMotion:
        """The same as the arm takes it."""
        return joint_motion(self.q, self.gone)

    @property
    def end(self) -> float:
        """When it is at rest, seconds."""
        return float(self.gone.times[-1])

    @property
    def length(self) -> float:
        """Where it ends, metres along the groove."""
        return float(self.gone.lengths[-1])


class PathAhead:
    """Plans the paths of a continuous scan.

    Parameters
    ----------
    kinematics : Kinematics
        Of the arm, as calibrated.
    limits : MotionLimits
        How fast it may go.
    speed : float
        Largest speed along the groove, metres per second.
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange, metres.
    p_s_t : ndarray, shape (3,)
        Where the groove is meant to be seen, in the sensor frame, metres.
    """

    def __init__(
        self, kinematics: Kinematics, limits: MotionLimits, speed: float, T_f_s: Array, p_s_t: Array
    ) -> None:
        self._kinematics = kinematics
        self._timing, self._speed = PathTiming(kinematics, limits, speed), speed
        self._shuttle_timing = PathTiming(kinematics, limits, SHUTTLE_SPEED)
        self._T_s_f, self._p_f_t = inverse_pose(T_f_s), (T_f_s @ np.append(p_s_t, 1.0))[:3]

    def groove_point(self, T_b_f: Array) -> Array:
        """Where the groove is meant to be, of a flange pose, shape (3,), metres."""
        return np.asarray(T_b_f[:3, :3] @ self._p_f_t + T_b_f[:3, 3])

    def straight(self, q: Array, T_b_f: Array, time: float) -> FollowedPath:
        """A path from rest, straight to a pose of the flange; lengths count from its start.

        Raises
        ------
        PoseUnreachable
            If it leaves reach or limits.
        """
        waypoints, _ = linear_waypoints(self._kinematics, q, T_b_f)
        here, there = (self.groove_point(T) for T in (self._kinematics.forward(q), T_b_f))
        lengths = np.linspace(0.0, float(np.linalg.norm(there - here)), len(waypoints))
        path = CubicSpline(lengths, waypoints)
        gone = self._timing.fastest(path, 0.0, time + PLANNING_TIME)
        if gone is None:
            raise PoseUnreachable("no motion within the arm's limits leads there", T_b_f)
        return FollowedPath(path, gone)

    def check_plan(self, q: Array, T_b_f: Array, horizon: float) -> None:
        """Refuse a speed and a horizon that the way between the taught poses shows not to do.

        Parameters
        ----------
        q : ndarray, shape (n,)
            Joint angles at the first one, radians.
        T_b_f : ndarray, shape (4, 4)
            The second, metres.
        horizon : float
            How far beyond the last section the path may lead, metres.

        Raises
        ------
        PoseUnreachable
            If it leaves reach or limits.
        ConfigurationError
            If joints or tool are much too slow, or the arm needs more than the horizon to go on
            until a new path is followed and to come to rest.
        """
        fastest, braking = self._timing.speed_and_braking(self.straight(q, T_b_f, 0.0).q)
        if self._speed > MOST_TIMES_AS_FAST * fastest:
            raise ConfigurationError(
                f"joints and flange of the arm allow {1e3 * fastest:.0f} mm/s along the groove "
                f"between the taught poses: set it to {int(1e3 * MOST_TIMES_AS_FAST * fastest)} at "
                "most, where the groove lets them it is reached",
                key="scan.speed_mm_s",
            )
        speed = min(self._speed, fastest)
        least = PLANNING_SPACING + PLANNING_TIME * speed + 0.5 * braking * speed**2
        if horizon < least:
            room = horizon - PLANNING_SPACING
            slow = 2 * room / (PLANNING_TIME + sqrt(PLANNING_TIME**2 + 2 * braking * room))
            raise ConfigurationError(
                f"at {1e3 * speed:.0f} mm/s the arm needs {1e3 * least:.0f} mm until it is on a "
                f"new path or at rest: set it to {ceil(1e3 * least)} at least, or speed_mm_s to "
                f"{int(1e3 * slow)} at most",
                key="scan.horizon_mm",
            )

    def extend(
        self, path: FollowedPath, seam: SeamAhead, seam_start: float, end: float, now: float
    ) -> FollowedPath:
        """Lead a path over to the seam ahead.

        Parameters
        ----------
        path : FollowedPath
            What is followed now.
        seam : SeamAhead
            What is seen to follow.
        seam_start : float
            Length along the groove that the seam's lengths count from, metres.
        end : float
            Length, counted as the seam's, at which the path shall end at the latest, metres.
        now : float
            Seconds on the arm's clock.

        Returns
        -------
        FollowedPath
            It begins at a knot of the old one, and goes through the next ones of it.

        Raises
        ------
        PathNotExtended
            If none leads further than the old one, and why.
        """
        start, leave, speed = path.gone.knot_from(now + PLANNING_TIME)
        kept = np.append(leave, path.q.x[path.q.x > leave][:KEPT_KNOTS])
        join = float(kept[-1])
        ideal = _SeamPoses(seam, seam_start, end, self._T_s_f)
        old = self._kinematics.forward(path.q(join))
        ideal.shift_to(join, self.groove_point(old))
        end = ideal.end
        if end < max(path.length - KNOT_SPACING, join + SLOPE_LENGTH):
            raise PathNotExtended("the seam is known no further than the path leads")
        offset = pose_to_vector(inverse_pose(ideal.at(join)) @ old)
        before = join - SLOPE_LENGTH
        was = inverse_pose(ideal.at(before)) @ self._kinematics.forward(path.q(before))
        slope = (offset - pose_to_vector(was)) / SLOPE_LENGTH if speed > 0 else 0.0 * offset

        reason = "the seam is known no further"
        lengths, angles = list(kept), list(path.q(kept))
        for s in _evenly(join, end)[1:]:
            T_b_f = ideal.at(s) @ pose_from_vector(_blend(offset, slope, s - join))
            try:
                q = self._kinematics.inverse(T_b_f, near=angles[-1])
            except PoseUnreachable as error:
                reason = error.reason
                break
            if np.abs(q - angles[-1]).max() > LARGEST_JOINT_TURN:
                reason = "a joint would have to swing round"
                break
            lengths.append(s)
            angles.append(q)
        if len(lengths) == len(kept):
            gone = 1e3 * (lengths[-1] - leave)
            raise PathNotExtended(f"the path ends {gone:.0f} mm on: {reason}")
        spline = (
            CubicSpline(lengths, angles, bc_type=((1, path.q(leave, 1)), "not-a-knot"))
            if speed > 0
            else CubicSpline(lengths, angles)
        )
        gone = self._timing.fastest(spline, speed, start)
        if gone is None:
            raise PathNotExtended("the arm can't stop any more before the new path ends")
        return FollowedPath(spline, gone)

    def shorten(self, path: FollowedPath, now: float) -> FollowedPath:
        """Let a path end as soon as the arm can rest on it; gives itself if it can't any sooner."""
        start, leave, speed = path.gone.knot_from(now + PLANNING_TIME)
        further = path.q.x[path.q.x > leave]
        for i in range(2, len(further)):
            lengths = np.append(leave, further[:i])
            begin, end = path.q(lengths[[0, -1]], 1)
            same = CubicSpline(lengths, path.q(lengths), bc_type=((1, begin), (1, end)))
            gone = self._timing.fastest(same, speed, start)
            if gone is not None:
                return FollowedPath(same, gone)
        return path

    def shuttle(self, q: Array, time: float) -> FollowedPath:
        """A path from rest to and fro across the groove, in the laser plane, and back.

        Raises
        ------
        PoseUnreachable
            If it leaves reach or limits.
        """
        T_b_f = self._kinematics.forward(q)
        phase = np.linspace(0.0, 2 * np.pi * SHUTTLE_CYCLES, 1 + 24 * SHUTTLE_CYCLES)
        across = np.column_stack((np.sin(phase), 0.0 * phase, 0.5 * (np.cos(phase) - 1.0)))
        moves_s = SHUTTLE_AMPLITUDE * across
        moves_b = moves_s @ (T_b_f[:3, :3] @ self._T_s_f[:3, :3].T).T
        angles = [q]
        for move in moves_b[1:]:
            angles.append(self._kinematics.inverse(pose(p=move) @ T_b_f, near=angles[-1]))
        lengths = np.append(0.0, np.linalg.norm(np.diff(moves_s, axis=0), axis=1).cumsum())
        path = CubicSpline(lengths, angles)
        gone = self._shuttle_timing.fastest(path, 0.0, time + PLANNING_TIME)
        if gone is None:
            raise PoseUnreachable("no motion within the arm's limits goes there", T_b_f)
        return FollowedPath(path, gone)


class _SeamPoses:
    """Flange poses along a seam ahead, by the length along the groove."""

    def __init__(self, seam: SeamAhead, start: float, end: float, T_s_f: Array) -> None:
        lengths, T_b_f = start + seam.lengths, seam.T_b_s @ T_s_f
        self._origins = CubicSpline(lengths, seam.T_b_t[:, :3, 3])
        self._places = CubicSpline(lengths, T_b_f[:, :3, 3])
        self._turns = RotationSpline(lengths, Rotation.from_matrix(T_b_f[:, :3, :3]))
        self._last, self._shift = min(end, float(lengths[-1])), 0.0

    @property
    def end(self) -> float:
        """Length up to which it is known and wanted, metres."""
        return self._last - self._shift

    def shift_to(self, length: float, point: Array) -> None:
        """Count lengths so that a point, shape (3,), lies square beside the seam at one."""
        for _ in range(3):
            s = length + self._shift
            along = self._origins(s, 1)
            self._shift += float((point - self._origins(s)) @ unit_vector(along))

    def at(self, length: float) -> Array:
        """Flange pose, shape (4, 4)."""
        s = length + self._shift
        return pose(self._turns(s).as_matrix(), self._places(s))


def _evenly(start: float, end: float) -> Array:
    """Lengths from one to another, about `KNOT_SPACING` apart."""
    return np.linspace(start, end, max(1, ceil((end - start) / KNOT_SPACING)) + 1)


def _blend(offset: Array, slope: Array, gone: float) -> Array:
    """What is left of an offset with a slope: a cubic that ends flat at zero."""
    u = min(gone / BLEND_LENGTH, 1.0)
    return np.asarray((1 + 2 * u) * (1 - u) ** 2 * offset + u * (1 - u) ** 2 * BLEND_LENGTH * slope)
