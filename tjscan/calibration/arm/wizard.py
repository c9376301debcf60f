"""The arm's calibration as an operator goes through it: postures that see a ball, and profiles."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tjscan.calibration.arm.calibrate import (
    ArmCalibration,
    ArmModel,
    TargetInPostures,
    calibrate_arm,
)
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets.ball import (
    CircleFit,
    SeenBall,
    SphereModel,
    SphereTarget,
    fit_circle,
)
from tjscan.calibration.targets.target import PosedFit, PosedProfile, fit_profiles
from tjscan.calibration.wizard.logbook import ArmPoseTaken, Logbook
from tjscan.calibration.wizard.operator import Operator, Question
from tjscan.core.errors import CalibrationRefused, PoseUnreachable
from tjscan.core.frames import Array, array_dataclass, inverse_pose, pose, rot_z, transform_points
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.model import MeasuringRange
from tjscan.laser.profile import Profile
from tjscan.robot.arm import Arm
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance

SENSOR_POSES_DRAWN: Final = 100
"""Ways to look at the ball from which postures are chosen; each has up to eight."""

MAX_VIEW_LEAN_ANGLE: Final = float(np.radians(60.0))
"""Radians from straight above the ball: below, its stand is in the way."""

MAX_OFF_CENTRE_RATIO: Final = 0.6
"""Of the ball's radius: so far, at most, the laser plane passes its centre."""

BALL_RANGE_MARGIN: Final = 5e-3
"""Metres that the ball keeps from the ends of the sensor's range: its place is approximate."""

ARC_SIGMA: Final = 20e-6
"""Metres; of an arc's centre and radius, for the choice of postures alone."""

MOUNT_PRIOR_SIGMAS: Final = (1e-3, float(np.radians(0.2)))
"""Metres and radians; how well the sensor's pose is known before, for that choice."""

BALL_PRIOR_SIGMAS: Final = (1e-2, 1e-3)
"""Metres; how well the ball's place and radius are known before, for that choice."""


@array_dataclass
class PlannedPosture:
    """A posture from which to look at the ball.

    Parameters
    ----------
    q : ndarray, shape (joints,)
        Joint angles, radians.
    T_b_f : ndarray, shape (4, 4)
        Flange pose by the arm's model.
    held_out : bool
        Whether the profile only checks the result.
    """

    q: Array
    T_b_f: Array
    held_out: bool


@array_dataclass
class PosturePlan:
    """Place of a ball, the sensor that looks at it, and the number of postures.

    Parameters
    ----------
    centre_b : ndarray, shape (3,)
        Approximate place of its centre, in metres.
    radius : float
        Approximate radius, in metres.
    T_f_s : ndarray, shape (4, 4)
        How the sensor sits on the flange.
    window : MeasuringRange
        Measuring range of the sensor.
    noise : NoiseModel
        Errors of profiles and poses; of poses, the arm's repeatability.
    tolerance : PlacementTolerance
        Deviations that the maker leaves.
    poses, held_out : int
        How many postures to find the deviations from, and to check them with.
    laser : LaserDeviation, optional
        Possible deviation of the laser.
    """

    centre_b: Array
    radius: float
    T_f_s: Array
    window: MeasuringRange
    noise: NoiseModel
    tolerance: PlacementTolerance
    poses: int
    held_out: int
    laser: LaserDeviation | None = None

    def model_of_arcs(self, kinematics: Kinematics, arcs: SphereModel, q: Array) -> ArmModel:
        """Model of an arm and of arcs on the ball, seen at joint angles q, shape (n, joints)."""
        start = np.append(self.centre_b, self.radius)
        return ArmModel(kinematics, (TargetInPostures(arcs, q, arcs.T_b_f, start),))


def plan_postures(plan: PosturePlan, kinematics: Kinematics) -> tuple[PlannedPosture, ...]:
    """Plan all postures that are worth looking from, the most informative first.

    More than `plan` asks for: the arm may not reach some of them. The profile of each next one
    has the most information about all unknowns (D-optimal); now and then, one only checks.

    Parameters
    ----------
    plan : BallPlan
        The ball and the sensor.
    kinematics : Kinematics
        The arm's model.

    Raises
    ------
    CalibrationRefused
        If too few postures see the ball.
    """
    q = _draw_postures(plan, kinematics)
    wanted = plan.poses + plan.held_out
    if len(q) < wanted:
        raise CalibrationRefused(
            "no postures to look from",
            f"{len(q)} postures see the ball, {wanted} are wanted; put it where the arm gets "
            "round it, half its reach from its base",
        )
    T_b_f = np.array([kinematics.forward(one) for one in q])
    order = _order_by_information(plan, _predict_jacobians(plan, kinematics, q, T_b_f))
    every = wanted / plan.held_out
    checks = {int(every * (k + 0.5)) for k in range(plan.held_out)}
    # Postures that check are not chosen by information: they are taken from the other end.
    views, left = [], deque(order)
    for place in range(len(order)):
        held_out = place % wanted in checks
        at = left.pop() if held_out else left.popleft()
        views.append(PlannedPosture(q[at], T_b_f[at], held_out))
    return tuple(views)


def _draw_postures(plan: PosturePlan, kinematics: Kinematics) -> Array:
    """Joint angles from which the sensor sees the ball, in every configuration, shape (n, joints).

    They are always the same, so that a calibration can be gone on with; each joint is in the turn
    nearest to zero.
    """
    rng, middle = np.random.default_rng(0), np.zeros(len(kinematics.lower))
    near, far = plan.window.near + plan.radius, plan.window.far - BALL_RANGE_MARGIN
    wide = 0.5 * plan.window.near * np.tan(plan.window.half_angle)
    off = MAX_OFF_CENTRE_RATIO * plan.radius
    found: list[Array] = []
    for _ in range(SENSOR_POSES_DRAWN):
        azimuth, yaw = rng.uniform(-np.pi, np.pi, 2)
        axis = np.array((np.cos(azimuth), np.sin(azimuth), 0.0))
        z = -Rotation.from_rotvec(rng.uniform(0, MAX_VIEW_LEAN_ANGLE) * axis).as_matrix()[:, 2]
        x = np.linalg.svd(z[None])[2][1]
        R = np.column_stack((x, np.cross(z, x), z)) @ rot_z(yaw)
        seen_s = rng.uniform((-wide, -off, near + BALL_RANGE_MARGIN), (wide, off, far))
        T_b_f = pose(R, plan.centre_b - R @ seen_s) @ inverse_pose(plan.T_f_s)
        with suppress(PoseUnreachable):
            found.extend(kinematics.all_inverse_solutions(T_b_f, middle))
    return np.array(found).reshape(-1, len(middle))


def _predict_jacobians(plan: PosturePlan, kinematics: Kinematics, q: Array, T_b_f: Array) -> Array:
    """Derivatives of the arcs to expect, over their errors, shape (n, 3, unknowns)."""
    seen_s = np.array(
        [transform_points(inverse_pose(T @ plan.T_f_s), plan.centre_b) for T in T_b_f]
    )
    radii = np.sqrt(plan.radius**2 - seen_s[:, 1] ** 2)
    covariances = np.tile(ARC_SIGMA**2 * np.eye(3), (len(q), 1, 1))
    arcs = SphereModel(T_b_f, seen_s * (1, 0, 1), radii, covariances, SphereTarget(), plan.noise)
    model = plan.model_of_arcs(kinematics, arcs, q)
    stacked = model.linearise(plan.T_f_s, np.zeros((model.joint_count, 6)), model.target_start)
    J = stacked.jacobian.reshape(len(q), 3, -1)
    blocks = stacked.covariance.reshape(len(q), 3, len(q), 3)
    own = blocks[np.arange(len(q)), :, np.arange(len(q))]
    return np.asarray(np.linalg.solve(np.linalg.cholesky(own), J))


def _order_by_information(plan: PosturePlan, rows: Array) -> NDArray[np.intp]:
    """Indices of candidates, each next one the D-optimal addition to those before it.

    Those that are not needed follow in any order: neighbours among them look the same way.
    """
    joints = (rows.shape[2] - 10) // 6
    of_arm, of_ball = np.tile(plan.tolerance.sigmas, joints), np.repeat(BALL_PRIOR_SIGMAS, (3, 1))
    A = rows * np.concatenate((np.repeat(MOUNT_PRIOR_SIGMAS, 3), of_arm, of_ball))
    C = np.eye(A.shape[2])
    left = np.ones(len(A), dtype=bool)
    order = []
    for _ in range(min(len(A), 2 * (plan.poses + plan.held_out))):
        S = np.eye(3) + A @ C @ A.transpose(0, 2, 1)
        gain = np.where(left, np.linalg.slogdet(S)[1], -np.inf)
        k = int(gain.argmax())
        order.append(k)
        left[k] = False
        AC = A[k] @ C
        C = C - AC.T @ np.linalg.solve(S[k], AC)
    rest = np.random.default_rng(0).permutation(np.flatnonzero(left))
    return np.concatenate((np.array(order, dtype=np.intp), rest))


UNREACHED_PROFILE: Final = Profile(np.empty(0), np.empty(0))
"""Recorded for a posture that the arm does not reach: it is not tried again."""

MAX_ARC_RADIUS_EXCESS: Final = 1e-3
"""Metres by which an arc may be wider than the ball stated: a wider one is of another thing."""


@dataclass(frozen=True, slots=True)
class ArmWizard:
    """Leads an operator and an arm through the postures; resumes where its logbook ends.

    Parameters
    ----------
    plan : BallPlan
        The ball, the sensor, and how often to look.
    views : tuple of PlannedView
        The postures, the most informative first; the same each time.
    kinematics : Kinematics
        The arm's model.
    arm, laser
        The devices, connected.
    operator : Operator
        Is asked before every move.
    logbook : Logbook
        Gets every profile at once; profiles that it holds already are not taken again.
    home : ndarray, shape (joints,)
        Start of the path to a posture, if there is none from the last one.
    """

    plan: PosturePlan
    views: tuple[PlannedPosture, ...]
    kinematics: Kinematics
    arm: Arm
    laser: LineLaser
    operator: Operator
    logbook: Logbook
    home: Array

    def run(self) -> tuple[ArmCalibration, tuple[PosedFit[CircleFit], ...]]:
        """Look at the ball from all postures, and calibrate; return the arcs it rests on too.

        Raises
        ------
        CalibrationRefused
            As `calibrate_arm` does, or if too few postures are reached.
        TjscanError
            If a device fails.
        """
        for held_out, wanted in ((False, self.plan.poses), (True, self.plan.held_out)):
            self._take_profiles(held_out=held_out, wanted=wanted)
        used, checking = self._arcs_seen(held_out=False), self._arcs_seen(held_out=True)
        checks = np.arange(len(used) + len(checking)) >= len(used)
        samples = [*used, *checking]
        ball = SeenBall(samples, SphereTarget(), self.plan.noise)
        q = np.array([sample.q for sample in samples])
        model = self.plan.model_of_arcs(self.kinematics, ball.model, q)
        found = calibrate_arm(model, checks, self.plan.tolerance, self.plan.T_f_s)
        for line in found.summary_sentences("postures", "ball is"):
            self.operator.report(line)
        return found, tuple(samples)

    def _take_profiles(self, *, held_out: bool, wanted: int) -> None:
        """Take profiles until as many show the ball as are wanted; the nearest posture next."""
        what = "to check with" if held_out else "to find the arm's deviations from"
        numbers = [k for k, view in enumerate(self.views) if view.held_out is held_out]
        while (missing := wanted - len(self._arcs_seen(held_out=held_out))) > 0:
            left = [k for k in numbers if k not in self.logbook.measured.arm_poses][:missing]
            if not left:
                raise CalibrationRefused(
                    "too few postures are reached",
                    f"{wanted - missing} of {wanted} show the ball, of {len(numbers)} tried; clear "
                    "the way round it, or put it where the arm gets round it",
                )
            while left:
                q = self.arm.state().q
                k = min(left, key=lambda k: float(np.abs(self.views[k].q - q).max()))
                left.remove(k)
                done = wanted - missing
                self._look_from_view(k, f"posture {k + 1}, {what} ({done} of {wanted} there)")

    def _look_from_view(self, number: int, what: str) -> None:
        view = self.views[number]
        turn = float(np.degrees(np.abs(view.q - self.arm.state().q).max()))
        question = f"Take {what}: joints turn by up to {turn:.0f}°?"
        profile, state = UNREACHED_PROFILE, self.arm.state()
        if self.operator.confirm(Question(question, True, moves=True)):
            with suppress(PoseUnreachable):
                self._move_to_view(view)
                profile, state = self.laser.capture(), self.arm.state()
        shot = PosedProfile(f"posture {number + 1}", state.T_b_f, profile)
        self.logbook.record(ArmPoseTaken(number, state.q, shot))

    def _move_to_view(self, view: PlannedPosture) -> None:
        """Go there in joint space, straight or by way of home."""
        try:
            self.arm.move_joint_to_pose(view.T_b_f, near=view.q, direct=True)
        except PoseUnreachable:
            self.arm.move_joint_to_pose(self.kinematics.forward(self.home), near=self.home)
            self.arm.move_joint_to_pose(view.T_b_f, near=view.q, direct=True)

    def _arcs_seen(self, *, held_out: bool) -> list[PosedFit[CircleFit]]:
        """Arcs of the postures that show the ball."""
        shots = [
            replace(taken.posed_profile, q=taken.q)
            for number, taken in self.logbook.measured.arm_poses.items()
            if self.views[number].held_out is held_out
        ]
        arcs, _ = fit_profiles(shots, fit_circle, self.plan.noise, self.plan.laser)
        return [arc for arc in arcs if arc.fit.radius < self.plan.radius + MAX_ARC_RADIUS_EXCESS]
