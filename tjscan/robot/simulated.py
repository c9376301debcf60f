"""A simulated arm: it plans as a real one does, keeps a clock, and does not quite repeat.

Its errors are of geometry, gears, backlash and warmth.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from math import ceil
from typing import Final, Self

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.core.devices import LocalDevice
from tjscan.core.errors import ArmFault, ConfigurationError
from tjscan.core.frames import Array, array_dataclass, pose, readonly_copy
from tjscan.robot.arm import ArmState
from tjscan.robot.deviations import deviate_joint_frames, deviations_of_longer_links
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import JointTrajectory, MotionLimits
from tjscan.robot.planned import PathPlan, PlannedArm
from tjscan.robot.settings import ArmErrorSettings
from tjscan.robot.simulated_following import SimulatedFollowing, WanderingError
from tjscan.robot.sway import SimulatedSway

ARM_ERRORS_RANDOM_STREAM: Final = 3
"""Keeps the random numbers of an arm's make apart from its moves' ones."""


@array_dataclass
class SimulatedArmErrors:
    """The true arm, which differs from the one that its controller plans and reports with.

    Parameters
    ----------
    kinematics : Kinematics
        The true arm while it is cold.
    growth : ndarray, shape (n, 6)
        Deviations of its joints, once it is warm.
    amplitude, phase : ndarray, shape (n,)
        Of each joint's error once a turn, radians.
    backlash : float
        Angle that a joint turns back before it moves the other way, radians.
    warm_up : float
        Seconds after which the growth is there but for 1/e.
    """

    kinematics: Kinematics
    growth: Array
    amplitude: Array
    phase: Array
    backlash: float
    warm_up: float

    @classmethod
    def draw_true_arm(cls, nominal: Kinematics, settings: ArmErrorSettings, seed: int) -> Self:
        """Draw an arm of a kind.

        Parameters
        ----------
        nominal : Kinematics
            What its controller knows.
        settings : ArmErrorSettings
            How much arms of the kind differ from that.
        seed : int
            Decides which one, unless the settings do.
        """
        own = seed if settings.seed is None else settings.seed
        rng = np.random.default_rng([own, ARM_ERRORS_RANDOM_STREAM])
        n = len(nominal.lower)
        deviations = settings.sigmas * rng.standard_normal((n, 6))
        return cls(
            deviate_joint_frames(nominal, deviations),
            settings.growth * deviations_of_longer_links(nominal),
            settings.eccentricity * rng.standard_normal(n),
            rng.uniform(-np.pi, np.pi, n),
            settings.backlash,
            settings.warm_up,
        )

    def flange_pose(self, q: Array, turning: Array, time: float) -> Array:
        """True flange pose ``T_b_f``, shape (4, 4).

        Parameters
        ----------
        q : ndarray, shape (n,)
            Joint angles as the encoders read them, radians.
        turning : ndarray, shape (n,)
            Sign of each joint's last motion, 0 before it moved.
        time : float
            Seconds since it was switched on.
        """
        true_q = q + self.amplitude * np.sin(q + self.phase) - 0.5 * self.backlash * turning
        if not self.growth.any():
            return self.kinematics.forward(true_q)
        warm = 1.0 - np.exp(-max(time, 0.0) / self.warm_up)
        return deviate_joint_frames(self.kinematics, warm * self.growth).forward(true_q)


POSITION_REPEATABILITY: Final = 5e-5
"""Metres, root mean square: assumption, after the ±0.05 mm the maker states for a UR10e."""

ANGULAR_REPEATABILITY: Final = 1e-4
"""Radians, root mean square: assumption, about the above over half a metre of arm."""

FOLLOWING_LAG: Final = 0.05
"""Seconds: assumption, what servoing on a Universal Robots arm was found to lag."""

ERROR_CORRELATION: Final = 0.5
"""Seconds: assumption."""

SIMULATED_MOVE_TICK: Final = 0.01
"""Seconds between the states a move in real time passes through."""

SWAY_TICK: Final = 0.008
"""Seconds for which a moving arm's momentum counts as the same: a fifteenth of a sway of 8 Hz."""


class SimulatedArm(PlannedArm, LocalDevice):
    """An arm that is simulated, behind the `Arm` protocol.

    It reports what its encoders would: exactly the pose it was sent to. The true pose of
    the flange, `true_T_b_f`, differs from that by an error drawn at the end of every move, and
    by the errors of its geometry and gears.

    Parameters
    ----------
    kinematics : Kinematics
        Which arm it is.
    q : array_like, shape (n,)
        Joint angles it starts with, in radians.
    limits : MotionLimits, optional
        How fast it may move.
    repeatability : tuple of float, optional
        Root mean square of the distance (metres) and of the angle (radians) between the true
        pose and the reported one; normal on each axis.
    seed : int, optional
        Seed of these errors. The same seed and moves give the same errors.
    realtime : bool, optional
        Whether moves take their time. If not they end at once; the arm's clock
        advances all the same.
    time : float, optional
        What its clock shows at first, in seconds.
    errors : SimulatedArmErrors, optional
        How the true arm differs from `kinematics`.

    Attributes
    ----------
    lag : float
        Seconds by which it follows a path late.
    wander : float
        Seconds over which its error correlates while it follows one.
    sway : SimulatedSway or None
        How what carries it sways, which no encoder sees.

    Raises
    ------
    ConfigurationError
        If `q` has the wrong number of joints or is beyond a limit.
    """

    not_connected = (ArmFault, "the arm is not connected: use it inside a 'with' block")

    def __init__(
        self,
        kinematics: Kinematics,
        q: Array,
        *,
        limits: MotionLimits | None = None,
        repeatability: tuple[float, float] = (POSITION_REPEATABILITY, ANGULAR_REPEATABILITY),
        seed: int = 0,
        realtime: bool = False,
        time: float = 0.0,
        errors: SimulatedArmErrors | None = None,
    ) -> None:
        _check_start_posture(kinematics, np.asarray(q, dtype=float))
        super().__init__(kinematics, limits)
        self.realtime = realtime
        self._spread = np.repeat(repeatability, 3) / np.sqrt(3)
        self._random = np.random.default_rng(seed)
        self._now = (readonly_copy(q), time)
        self._errors = errors
        self._turning = np.zeros(len(self._now[0]))
        self._error = self._draw_error()
        self.lag, self.wander = FOLLOWING_LAG, ERROR_CORRELATION
        self.sway: SimulatedSway | None = None
        self._following: SimulatedFollowing | None = None

    def __enter__(self) -> Self:
        """Make ready to move."""
        self._latch.clear_stop()
        return super().__enter__()

    def __exit__(self, *error: object) -> None:
        """Stop, and take no more commands."""
        self.stop()
        super().__exit__(*error)

    @property
    def true_T_b_f(self) -> Array:
        """True pose of the flange, shape (4, 4), which no real arm knows."""
        q, now = self._now
        if self._errors is None:
            T_b_f = self.kinematics.forward(q)
        else:
            T_b_f = self._errors.flange_pose(q, self._turning, now)
        turn = Rotation.from_rotvec(self._error[3:]).as_matrix()
        T_b_f = pose(T_b_f[:3, :3] @ turn, T_b_f[:3, 3] + self._error[:3])
        return T_b_f if self.sway is None else self.sway.T_rest_b @ T_b_f

    def state(self) -> ArmState:
        """Joint angles, flange pose and time as the encoders and the arm's clock report them."""
        self.check_connected()
        q, now = self._now
        return ArmState(q, self.kinematics.forward(q), now)

    @contextmanager
    def follow(self) -> Iterator[SimulatedFollowing]:
        """Follow paths that grow, as time is let pass. See `FollowingArm.follow`."""
        self.check_connected()
        with self._latch.hold_for_move():
            error = WanderingError(self._error, self._spread, self.wander, self._random)
            check = self._latch.check_not_stopped
            start = self.state()
            self._following = SimulatedFollowing(self.kinematics, start, self.lag, error, check)
            try:
                yield self._following
            finally:
                self._following = None

    def pass_time(self, seconds: float) -> None:
        """Let time pass on the arm's clock, in which it moves if it follows a path."""
        if self.realtime:
            time.sleep(seconds)
        following, before = self._following, self._now[0]
        if following is None or self._latch.wait_for_stop(0.0):
            self._now = (self._now[0], self._now[1] + seconds)
        else:
            following.advance(seconds)
            self._now = (readonly_copy(following.q), following.time)
            self._error, self._turning = following.error.now, following.turning
        self._sway_through(np.array((before, self._now[0])), seconds)

    def _move(self, plan: PathPlan, T_b_f: Array, *, linear: bool) -> ArmState:
        self.check_connected()
        with self._latch.hold_for_move():
            q, start = self._now
            path = plan(q)
            with self._latch.begin_move_unless_stopped():
                passed = 0.0 if self.realtime else path.duration
            if self.realtime:
                passed = self._move_in_real_time(path, start)
            reached = readonly_copy(path.joint_angles_at(passed))
            last = reached - path.joint_angles_at(max(passed - SIMULATED_MOVE_TICK, 0.0))
            self._turning = np.where(last == 0.0, self._turning, np.sign(last))
            self._now = (reached, start + passed)
            self._error = self._draw_error()
            if self.sway is not None:
                ticks = np.linspace(0.0, passed, ceil(passed / SWAY_TICK) + 1)
                self._sway_through(path.joint_angles_at(ticks), passed)
        if passed < path.duration:
            raise ArmFault(
                f"the arm was stopped after {passed:.2f} s of a move of {path.duration:.2f} s. "
                "See that the way is clear, then move again from where it is."
            )
        return self.state()

    def _move_in_real_time(self, path: JointTrajectory, start: float) -> float:
        """Let a move take its time, and return the seconds of it that passed."""
        began = time.monotonic()
        while (passed := time.monotonic() - began) < path.duration:
            self._now = (readonly_copy(path.joint_angles_at(passed)), start + passed)
            if self._latch.wait_for_stop(min(SIMULATED_MOVE_TICK, path.duration - passed)):
                return min(time.monotonic() - began, path.duration)
        return path.duration

    def _sway_through(self, q: Array, seconds: float) -> None:
        """Let the base sway while the joints go through angles, shape (m, n), evenly in time."""
        if self.sway is None or seconds <= 0:
            return
        tick = seconds / (len(q) - 1)
        for before, after in pairwise(q):
            speeds = (after - before) / tick
            half_way, payload = (before + after) / 2, self.sway.payload
            self.sway.advance(
                tick, self.kinematics.momentum(half_way, speeds, payload) if speeds.any() else None
            )

    def _draw_error(self) -> Array:
        """Metres along the axes of b and a rotation vector in the axes of f, shape (6,)."""
        return np.asarray(self._spread * self._random.standard_normal(6))


def _check_start_posture(kinematics: Kinematics, q: Array) -> None:
    if q.shape != kinematics.lower.shape:
        message = f"{kinematics.name} has {kinematics.lower.size} joints, not {q.size}"
        raise ConfigurationError(message, key="q")
    beyond = kinematics.joint_limit_excess(q)
    if not beyond.max() <= 0:
        i = int(np.nan_to_num(beyond, nan=np.inf).argmax())
        raise ConfigurationError(
            f"{kinematics.joint_names[i]} starts at {np.degrees(q[i]):.1f} deg, which is not "
            f"within {np.degrees(kinematics.lower[i]):.1f} to "
            f"{np.degrees(kinematics.upper[i]):.1f} deg",
            key="q",
        )
