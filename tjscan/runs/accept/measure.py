"""What an acceptance measures: the arm moves, and the laser looks at a certified ball."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.calibration.arm.wizard import PlannedPosture, PosturePlan, plan_postures
from tjscan.calibration.targets.ball import fit_circle
from tjscan.calibration.targets.target import PosedProfile
from tjscan.calibration.wizard.logbook import ArmPoseTaken, messages_of_entry
from tjscan.calibration.wizard.operator import Operator, Question
from tjscan.core.errors import (
    AcceptanceRefused,
    ArmFault,
    CalibrationRefused,
    ConfigurationError,
    LaserFault,
    PoseUnreachable,
)
from tjscan.core.frames import Array, inverse_pose, pose
from tjscan.job.cell import Cell
from tjscan.laser.profile import Profile, ProfileRepeats
from tjscan.recording.journal import RecordingWriter
from tjscan.robot.arm import Arm, ArmState
from tjscan.robot.path import MotionLimits
from tjscan.robot.settings import PlacementTolerance
from tjscan.runs.accept.judge import StatedErrors
from tjscan.scanning.continuous.clocks import ShuttleViews, clock_offset
from tjscan.scanning.continuous.path_ahead import PathAhead
from tjscan.scanning.continuous.poses import ActualPoses
from tjscan.scanning.continuous.stream import PlacedProfiles, devices_that_follow

BESIDE_MIDDLE: Final = 0.4
"""Of the ball's radius: so far beside its middle the laser's plane crosses it, either way."""

RETURN_BESIDE_MIDDLE: Final = 0.6
"""The same for returns: the radius of the arc shows how the arm errs across the plane."""

RANGE_MARGIN: Final = 5e-3
"""Metres that the ball keeps from the ends of the laser's range."""

LEANS_FROM_ABOVE: Final = (0, 15, 30, 45)
"""Degrees from straight above, of views that the arm may get to."""

ARC_SHARE_IN_FAN: Final = 0.75
"""Of the radius on either side of the middle is within the laser's fan."""

RETREAT_DISTANCE: Final = 0.15
"""Metres by which the sensor is drawn back between returns, and before a stop."""

STATE_PAUSE: Final = 0.002
"""Seconds between two looks at the arm's state while it stops."""

STATES_AT_REST: Final = 150
"""States in a row, some 0.3 s, in which the flange stays where it is once it rests."""

REST_DISTANCE: Final = 2e-5
"""Metres that it may move within them."""

STOP_TIMEOUT: Final = 10.0
"""Seconds within which an arm that was stopped has to rest."""

SETTLING_TIME: Final = 0.2
"""Seconds of profiles after a shuttle."""

READ_EVERY: Final = 4
"""Of the profiles of a shuttle one in so many is read."""


@dataclass(eq=False)
class ArtefactViewer:
    """Moves the arm to looks at the artefact, each with the operator's consent.

    Parameters
    ----------
    cell : Cell
        Connected.
    stated : StatedErrors
        Of the cell.
    radius : float
        Of the ball, metres.
    operator : Operator
        Is asked before every move.
    recording : RecordingWriter
        Receives each look at once.
    """

    cell: Cell
    stated: StatedErrors
    radius: float
    operator: Operator
    recording: RecordingWriter
    count: int = 0
    clock_fault: LaserFault | None = None

    def window_places(self) -> Iterator[Array]:
        """Where the ball is to be seen, in the sensor frame, metres; the middle of the range first.

        Middle, near and far; middle, left and right; on either side of the ball's middle.
        """
        window, R = self.stated.window, self.radius
        near, far = window.near + R + RANGE_MARGIN, window.far - RANGE_MARGIN
        for z, side in product((0.5 * (near + far), near, far), (0, -1, 1)):
            wide = (z - 0.5 * R - window.apex_z) * np.tan(window.half_angle)
            x = side * max(wide - ARC_SHARE_IN_FAN * R, 0.0)
            for beside in (-BESIDE_MIDDLE, BESIDE_MIDDLE):
                yield np.array((x, beside * R, z))

    def flange_poses(self, R_b_s: Array, centre_b: Array, seen_s: Iterable[Array]) -> list[Array]:
        """Flange poses in which the ball is seen at places of the sensor frame."""
        T_s_f = inverse_pose(self.cell.T_f_s)
        return [pose(R_b_s, centre_b - R_b_s @ place) @ T_s_f for place in seen_s]

    def plan_views(self, centre_b: Array, wanted: int) -> tuple[PlannedPosture, ...]:
        """Postures that see the ball, the most informative first; see `plan_postures`."""
        what = self.cell.T_f_s, self.stated.window, self.stated.noise, PlacementTolerance()
        plan = PosturePlan(centre_b, self.radius, *what, wanted - 1, 1)
        return plan_postures(plan, self.stated.kinematics)

    def steepest_view(self, centre_b: Array) -> Array:
        """Orientation of the sensor, shape (3, 3), from which the arm gets to all window places.

        The steepest from above: the ball's stand is below.

        Raises
        ------
        AcceptanceRefused
            If it does from none.
        """
        reason = ""
        for R in _views_from_above():
            places = self.flange_poses(R, centre_b, self.window_places())
            try:
                self.cell.arm.check_moves(self._drawn_back(places[0]), *places)
            except PoseUnreachable as error:
                reason = str(error)
            else:
                return R
        raise AcceptanceRefused("the arm can't look at the ball from everywhere", reason)

    def look(self, name: str, *T_b_f: Array, near: Array | None = None) -> PosedProfile | None:
        """Move through poses, straight, or in joint space near joint angles; look at the last.

        None if the operator passes over it.
        """
        arm, question = self.cell.arm, f"Move to look at the ball: {name}?"
        if not self.operator.confirm(Question(question, True, moves=True, T_b_f=T_b_f[-1])):
            return None
        for T in T_b_f:
            if near is None:
                arm.move_linear(T)
            else:
                arm.move_joint_to_pose(T, near=near, direct=True)
        profile, state = self.cell.laser.capture(), arm.state()
        shot = PosedProfile(name, state.T_b_f, profile, state.q)
        self.count, now = self.count + 1, time.time_ns()
        entry = ArmPoseTaken(self.count, state.q, shot)
        self.recording.write(now, *messages_of_entry(now, entry))
        return shot

    def begin(self, T_b_f: Array) -> None:
        """Move in joint space to where the sensor is drawn back from a pose.

        Raises
        ------
        AcceptanceRefused
            If the operator does not agree.
        """
        back = self._drawn_back(T_b_f)
        question = Question("Move the sensor over the ball?", True, moves=True, T_b_f=back)
        if not self.operator.confirm(question):
            raise AcceptanceRefused("not begun", "the sensor has to be over the ball")
        self.cell.arm.move_joint_to_pose(back)

    def look_from_each(self, what: str, T_b_f: Iterable[Array]) -> list[PosedProfile]:
        """Look at the ball from flange poses, one after the other on straight lines."""
        looks = [self.look(f"{what} {k}", T) for k, T in enumerate(T_b_f, 1)]
        return [look for look in looks if look is not None]

    def return_to(self, T_b_f: Array, times: int) -> list[PosedProfile]:
        """Return to one pose, each time from where the sensor is drawn back."""
        back = self._drawn_back(T_b_f)
        looks = [self.look(f"return {k}", back, T_b_f) for k in range(1, times + 1)]
        return [look for look in looks if look is not None]

    def look_from_postures(
        self, views: tuple[PlannedPosture, ...], wanted: int
    ) -> list[PosedProfile]:
        """Look from as many postures as are wanted, the nearest next; those in the way are left."""
        left, looks, home = list(views), list[PosedProfile](), self.cell.arm.state()
        while len(looks) < wanted and left:
            q = self.cell.arm.state().q
            view = min(left[: wanted - len(looks)], key=lambda v: float(np.abs(v.q - q).max()))
            left = [other for other in left if other is not view]
            with suppress(PoseUnreachable):
                try:
                    look = self.look(f"posture {len(looks) + 1}", view.T_b_f, near=view.q)
                except PoseUnreachable:
                    self.cell.arm.move_joint_to_pose(home.T_b_f, near=home.q)
                    look = self.look(f"posture {len(looks) + 1}", view.T_b_f, near=view.q)
                if look is not None:
                    looks.append(look)
        return looks

    def lay_clock(self, limits: MotionLimits) -> list[tuple[float, float, float]]:
        """Move to and fro across the ball, and lay the laser's clock on the arm's.

        Returns
        -------
        list of tuple of float
            A stamp of the laser, by how much the arm's clock is ahead there, and its standard
            deviation, seconds; none if arm or laser do not state times, it is passed over, or no
            offset lets the ball stand still: see `clock_fault`.
        """
        try:
            follows, streams = devices_that_follow(self.cell.arm, self.cell.laser)
        except ConfigurationError:
            self.operator.report("the clocks are not compared: no stamps while the arm moves")
            return []
        if not self.operator.confirm(Question("Move 4 mm to and fro?", True, moves=True)):
            return []
        kinematics = self.stated.kinematics
        poses, start = ActualPoses(kinematics), self.cell.arm.state()
        placed = PlacedProfiles(streams, poses, ProfileRepeats())
        planner = PathAhead(kinematics, limits, limits.tcp_speed, self.cell.T_f_s, np.zeros(3))
        path, profiles, quickest = planner.shuttle(start.q, start.time), list[Profile](), np.inf
        with follows.follow() as following:
            stream = placed.profiles(following)
            next(stream)
            path = path.begun_from_rest(self.cell.arm.state().time)
            following.replace(path.motion)
            for profile in stream:
                behind = poses.latest - following.now
                if profile is not None:
                    profiles.append(profile)
                    quickest = min(quickest, placed.heard - profile.time)
                if poses.latest > path.end + behind + SETTLING_TIME:
                    break
        stamps, centres = [], []
        for profile in profiles[::READ_EVERY]:
            with suppress(CalibrationRefused):
                centres.append(fit_circle(profile, self.stated.noise).centre_s[[0, 2]])
                stamps.append(profile.time)
        views = ShuttleViews(np.array(stamps), np.array(centres).reshape(-1, 1, 2))
        try:
            offset, sigma = clock_offset(views, poses, self.cell.T_f_s, quickest)
        except LaserFault as fault:  # of the laser, or of an arm that does not repeat
            self.clock_fault = fault
            self.operator.report(str(fault))
            return []
        return [(profiles[len(profiles) // 2].time, offset, sigma)]

    def stop_on_the_way(self, T_b_f: Array) -> tuple[list[ArmState], int]:
        """Draw the sensor back from a pose at the job's speed, and stop half-way.

        Returns
        -------
        states : list of ArmState
            Until the arm rests; empty if it was passed over, or the move ended before.
        ordered : int
            The one that was read last before the stop.
        """
        back = self._drawn_back(T_b_f)
        question = "Move back at the job's speed, and stop on the way?"
        if not self.operator.confirm(Question(question, True, moves=True, T_b_f=back)):
            return [], 0
        states, ordered = stop_half_way(self.cell.arm, back)
        if not states:
            self.operator.report(
                "the stopping distance is not measured: the move ended before the arm was stopped "
                "(a simulated arm's moves take their time with simulation.arm.realtime)"
            )
        return states, ordered

    def _drawn_back(self, T_b_f: Array) -> Array:
        T = np.array(T_b_f)
        T[:3, 3] -= RETREAT_DISTANCE * (T_b_f @ self.cell.T_f_s)[:3, 2]
        return T


def _views_from_above() -> Iterator[Array]:
    """Orientations of the sensor in b, the steepest first."""
    for lean, azimuth, yaw in product(LEANS_FROM_ABOVE, range(0, 360, 90), range(0, 360, 45)):
        turns = Rotation.from_euler("ZYZ", (azimuth, 180 - lean, yaw), degrees=True)
        yield np.asarray(turns.as_matrix())


def stop_half_way(arm: Arm, T_b_f: Array) -> tuple[list[ArmState], int]:
    """Move on a line and stop half-way; see `ArtefactViewer.stop_on_the_way`."""
    states, ended = [arm.state()], threading.Event()

    def move() -> None:
        with suppress(ArmFault):
            arm.move_linear(T_b_f)
        ended.set()

    start, mover = states[0].T_b_f[:3, 3], threading.Thread(target=move)
    half = 0.5 * float(np.linalg.norm(T_b_f[:3, 3] - start))
    mover.start()
    try:
        while not ended.is_set() and np.linalg.norm(states[-1].T_b_f[:3, 3] - start) < half:
            time.sleep(STATE_PAUSE)
            states.append(arm.state())
        there = np.linalg.norm(states[-1].T_b_f[:3, 3] - T_b_f[:3, 3]) < REST_DISTANCE
        late, ordered, stopped = there or ended.is_set(), len(states) - 1, time.monotonic()
    finally:
        arm.stop()
    while not _rests(states) and time.monotonic() - stopped < STOP_TIMEOUT:
        time.sleep(STATE_PAUSE)
        states.append(arm.state())
    mover.join()
    arm.accept_moves_again()
    return ([], 0) if late else (states, ordered)


def _rests(states: list[ArmState]) -> bool:
    """Whether the flange stayed where it is in the last states."""
    before = states[-min(len(states), STATES_AT_REST)].T_b_f
    moved = float(np.linalg.norm(states[-1].T_b_f[:3, 3] - before[:3, 3]))
    return len(states) > STATES_AT_REST and moved < REST_DISTANCE
