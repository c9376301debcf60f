"""The arm's calibration as an operator goes through it: look at a ball from many postures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.calibration.arm.design import BallPlan, PlannedView
from tjscan.calibration.arm.model import ArmModel, SeenTarget
from tjscan.calibration.arm.result import ArmCalibration, calibrate_arm, list_undetermined
from tjscan.calibration.fits.posed_profile import PosedProfile, fit_arc_samples
from tjscan.calibration.fits.samples import ArcSample
from tjscan.calibration.solve.seen import SeenBall
from tjscan.calibration.targets import SphereTarget
from tjscan.calibration.wizard.logbook import Logbook
from tjscan.calibration.wizard.operator import Operator, Question
from tjscan.calibration.wizard.topics import ArmPoseTaken
from tjscan.core.errors import CalibrationRefused, PoseUnreachable
from tjscan.core.frames import Array
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan.robot.arm import Arm
from tjscan.robot.kinematics import Kinematics

NO_PROFILE: Final = Profile(np.empty(0), np.empty(0))
"""Recorded for a posture that the arm does not reach: it is not tried again."""

RADIUS_TOLERANCE: Final = 1e-3
"""Metres by which an arc may be wider than the ball stated: what lies on a wider one is no ball."""


@dataclass(frozen=True, slots=True)
class ArmWizard:
    """Leads an operator and an arm through the postures; resumes where its logbook ends.

    Parameters
    ----------
    plan : BallPlan
        The ball, the sensor, and how often to look.
    views : tuple of PlannedView
        From where, the most telling first; the same each time.
    kinematics : Kinematics
        The arm's model.
    arm, laser
        The devices, connected.
    operator : Operator
        Is asked before every move.
    logbook : Logbook
        Gets every profile at once; what it holds already is not taken again.
    home : ndarray, shape (joints,)
        From where the way to a posture is looked for, if there is none from the last one.
    """

    plan: BallPlan
    views: tuple[PlannedView, ...]
    kinematics: Kinematics
    arm: Arm
    laser: LineLaser
    operator: Operator
    logbook: Logbook
    home: Array

    def run(self) -> tuple[ArmCalibration, tuple[ArcSample, ...]]:
        """Look at the ball from all postures, and calibrate; gives the arcs it rests on too.

        Raises
        ------
        CalibrationRefused
            As `calibrate_arm` does, or if too few postures are reached.
        TjscanError
            If a device fails.
        """
        for held_out, wanted in ((False, self.plan.poses), (True, self.plan.held_out)):
            self._take(held_out=held_out, wanted=wanted)
        used, checking = self._samples(held_out=False), self._samples(held_out=True)
        checks = np.arange(len(used) + len(checking)) >= len(used)
        samples = [*used, *checking]
        found = calibrate_arm(self._model(samples), checks, self.plan.tolerance, self.plan.T_f_s)
        check = found.cross_check
        self.operator.report(
            f"{check.count} postures that took no part: the ball is {1e3 * check.before:.3f} mm "
            f"off (RMS) as the arm's model has it, {1e3 * check.after:.3f} mm with what was found"
        )
        for line in list_undetermined(found.undetermined):
            self.operator.report(line)
        return found, tuple(sample for _, sample in samples)

    def _take(self, *, held_out: bool, wanted: int) -> None:
        """Take profiles until as many show the ball as are wanted; the nearest posture next."""
        what = "to check with" if held_out else "to find the arm's deviations from"
        numbers = [k for k, view in enumerate(self.views) if view.held_out is held_out]
        while (missing := wanted - len(self._samples(held_out=held_out))) > 0:
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
                self._look(k, f"posture {k + 1}, {what} ({done} of {wanted} there)")

    def _look(self, number: int, what: str) -> None:
        view = self.views[number]
        turn = float(np.degrees(np.abs(view.q - self.arm.state().q).max()))
        question = f"Take {what}: joints turn by up to {turn:.0f}°?"
        profile, state = NO_PROFILE, self.arm.state()
        if self.operator.confirm(Question(question, True, moves=True)):
            try:
                self._go(view)
                profile, state = self.laser.capture(), self.arm.state()
            except PoseUnreachable:
                profile = NO_PROFILE
        shot = PosedProfile(f"posture {number + 1}", state.T_b_f, profile)
        self.logbook.record_entry(ArmPoseTaken(number, state.q, shot))

    def _go(self, view: PlannedView) -> None:
        """Go there in joint space, straight or by way of home."""
        try:
            self.arm.move_joint_to_pose(view.T_b_f, near=view.q, direct=True)
        except PoseUnreachable:
            self.arm.move_joint_to_pose(self.kinematics.forward(self.home), near=self.home)
            self.arm.move_joint_to_pose(view.T_b_f, near=view.q, direct=True)

    def _samples(self, *, held_out: bool) -> list[tuple[Array, ArcSample]]:
        """Joint angles and arcs of the postures that show the ball."""
        largest = self.plan.radius + RADIUS_TOLERANCE
        found: list[tuple[Array, ArcSample]] = []
        for number, taken in self.logbook.measured.arm_poses.items():
            if self.views[number].held_out is held_out:
                arcs, _ = fit_arc_samples([taken.posed_profile], self.plan.noise, self.plan.laser)
                found.extend((taken.q, arc) for arc in arcs if arc.fit.radius < largest)
        return found

    def _model(self, samples: list[tuple[Array, ArcSample]]) -> ArmModel:
        q = np.array([q for q, _ in samples])
        ball = SeenBall([arc for _, arc in samples], SphereTarget(), self.plan.noise)
        start = np.append(self.plan.centre_b, self.plan.radius)
        return ArmModel(self.kinematics, (SeenTarget(ball.model, q, ball.T_b_f, start),))
