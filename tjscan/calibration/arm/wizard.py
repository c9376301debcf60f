"""The arm's calibration as an operator goes through it: look at a ball from many postures."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.calibration.arm.calibrate import ArmCalibration, calibrate_arm
from tjscan.calibration.arm.design import BallPlan, PlannedView
from tjscan.calibration.arm.model import ArmModel
from tjscan.calibration.targets.ball import CircleFit, SeenBall, SphereTarget, fit_circle
from tjscan.calibration.targets.target import PosedFit, PosedProfile, fit_profiles
from tjscan.calibration.wizard.logbook import ArmPoseTaken, Logbook
from tjscan.calibration.wizard.operator import Operator, Question
from tjscan.core.errors import CalibrationRefused, PoseUnreachable
from tjscan.core.frames import Array
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan.robot.arm import Arm
from tjscan.robot.kinematics import Kinematics

NO_PROFILE: Final = Profile(np.empty(0), np.empty(0))
"""Recorded for a posture that the arm does not reach: it is not tried again."""

MAX_EXTRA_RADIUS: Final = 1e-3
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

    plan: BallPlan
    views: tuple[PlannedView, ...]
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
        found = calibrate_arm(
            self._model_of_samples(samples), checks, self.plan.tolerance, self.plan.T_f_s
        )
        for line in found.lines("postures", "ball is"):
            self.operator.report(line)
        return found, tuple(sample for _, sample in samples)

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
        profile, state = NO_PROFILE, self.arm.state()
        if self.operator.confirm(Question(question, True, moves=True)):
            with suppress(PoseUnreachable):
                self._move_to_view(view)
                profile, state = self.laser.capture(), self.arm.state()
        shot = PosedProfile(f"posture {number + 1}", state.T_b_f, profile)
        self.logbook.record(ArmPoseTaken(number, state.q, shot))

    def _move_to_view(self, view: PlannedView) -> None:
        """Go there in joint space, straight or by way of home."""
        try:
            self.arm.move_joint_to_pose(view.T_b_f, near=view.q, direct=True)
        except PoseUnreachable:
            self.arm.move_joint_to_pose(self.kinematics.forward(self.home), near=self.home)
            self.arm.move_joint_to_pose(view.T_b_f, near=view.q, direct=True)

    def _arcs_seen(self, *, held_out: bool) -> list[tuple[Array, PosedFit[CircleFit]]]:
        """Joint angles and arcs of the postures that show the ball."""
        largest = self.plan.radius + MAX_EXTRA_RADIUS
        found: list[tuple[Array, PosedFit[CircleFit]]] = []
        for number, taken in self.logbook.measured.arm_poses.items():
            if self.views[number].held_out is held_out:
                arcs, _ = fit_profiles(
                    [taken.posed_profile], fit_circle, self.plan.noise, self.plan.laser
                )
                found.extend((taken.q, arc) for arc in arcs if arc.fit.radius < largest)
        return found

    def _model_of_samples(self, samples: list[tuple[Array, PosedFit[CircleFit]]]) -> ArmModel:
        q = np.array([q for q, _ in samples])
        ball = SeenBall([arc for _, arc in samples], SphereTarget(), self.plan.noise)
        return self.plan.model_of_arcs(self.kinematics, ball.model, q)
