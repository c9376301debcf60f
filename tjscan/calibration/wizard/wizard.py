"""The calibration as an operator goes through it: touch, take lines, verify."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from tjscan.calibration.checks import FreshLineVerification, verify_with_fresh_line
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.targets.line import fit_line
from tjscan.calibration.targets.plane import NOT_FLAT_REASON, PlaneTarget, SeenBoard
from tjscan.calibration.targets.target import PosedProfile, fit_profiles
from tjscan.calibration.wizard.logbook import (
    BoardTouch,
    LaserLineTaken,
    Logbook,
    MeasurementsSoFar,
    SkippedPose,
)
from tjscan.calibration.wizard.operator import Operator, Question, TouchProbe
from tjscan.calibration.wizard.session import BoardRectangle, CalibrationPlan, CalibrationProgress
from tjscan.core.errors import CalibrationRefused, PoseUnreachable
from tjscan.core.frames import Array, rotation_angle_between
from tjscan.laser.line_laser import LineLaser
from tjscan.robot.arm import Arm

MAX_RETOUCHES: Final = 3
"""Touches that are taken again before a board counts as not flat."""
MAX_SKIPPED_IN_A_ROW: Final = 5
"""Poses in a row that may see no line before the calibration gives up."""
MAX_TAKEN_LINES_RATIO: Final = 2
"""Times the lines asked for: still more lines cure nothing."""
POSE_REACHED_TOLERANCE: Final = 1e-4
"""Metres and radians; an arm nearer to a pose than this is at the pose."""


@dataclass(frozen=True, slots=True)
class CalibrationWizard:
    """Leads an operator and an arm through a calibration; resumes where its logbook ends.

    Parameters
    ----------
    task : CalibrationPlan
        The plan of the calibration.
    arm, laser, probe
        The devices, connected.
    operator : Operator
        Is asked before every move.
    logbook : Logbook
        Gets every measurement at once; measurements that it holds are not taken again.
    """

    task: CalibrationPlan
    arm: Arm
    laser: LineLaser
    probe: TouchProbe
    operator: Operator
    logbook: Logbook

    @property
    def measurements(self) -> MeasurementsSoFar:
        """All touches and lines measured so far."""
        return self.logbook.measured

    def run(self) -> tuple[HandEyeCalibration, FreshLineVerification]:
        """Run the calibration: touch the board, take lines, verify with a fresh one.

        Raises
        ------
        CalibrationRefused
            If the result could not be trusted; the measurements stay in the logbook.
        TjscanError
            If a device fails.
        """
        target, board = self.touch_board()
        result = self.take_lines(target, board)
        return result, self.verify_calibration(result, target, board)

    def touch_board(self) -> tuple[PlaneTarget, BoardRectangle]:
        """Touch every place not touched yet, and touch again those that don't fit a plane.

        Raises
        ------
        CalibrationRefused
            As `fit_plane` does.
        """
        places = self.task.touch_points
        for k in range(len(places)):
            if k not in self.measurements.touches:
                self._touch_place(k, places[k])
        for _ in range(MAX_RETOUCHES):
            try:
                return self._fit_board()
            except CalibrationRefused as refusal:
                if refusal.reason != NOT_FLAT_REASON:
                    raise
                self.operator.report(str(refusal))
                k = self.task.worst_touch(self.measurements)
                question = Question(f"Touch place {k + 1} again?", True, yes="Redo", no="Finish")
                if not self.operator.confirm(question):
                    raise
                self._touch_place(k, places[k])
        return self._fit_board()

    def take_lines(self, target: PlaneTarget, board: BoardRectangle) -> HandEyeCalibration:
        """Take the lines that are still to be taken, and more if they are wanted.

        Parameters
        ----------
        target : PlaneTarget
            The board as touched.
        board : BoardRectangle
            Its extent.

        Raises
        ------
        CalibrationRefused
            If the lines give nothing to trust, or too few poses see the board.
        """
        shown = -1
        while True:
            progress = self.task.progress(self.measurements, target)
            if len(progress.samples) != shown:
                shown = len(progress.samples)
                self.operator.show_uncertainty(progress)
            if self.measurements.verification_profile is not None or not self._wants_more(progress):
                if progress.result is None:
                    raise progress.refusal or CalibrationRefused("no lines", "none were taken")
                return progress.result
            self._take_line(target, board, progress, fresh=False)

    def verify_calibration(
        self, result: HandEyeCalibration, target: PlaneTarget, board: BoardRectangle
    ) -> FreshLineVerification:
        """Compare the calibration with one more line, taken now unless one was recorded.

        Parameters
        ----------
        result : HandEyeCalibration
            The calibration to verify.
        target : PlaneTarget
            The board as touched.
        board : BoardRectangle
            Its extent.

        Raises
        ------
        CalibrationRefused
            If the line contradicts the result, and the operator does not insist.
        """
        while self.measurements.verification_profile is None:
            progress = self.task.progress(self.measurements, target)
            self._take_line(target, board, progress, fresh=True)
        (fresh,) = self.task.fit_lines([self.measurements.verification_profile])
        lines = self.task.fit_lines(self.measurements.line_profiles)
        found = verify_with_fresh_line(SeenBoard(lines, target, self.task.noise), result, fresh)
        finding = (
            f"a fresh line is {1e3 * found.offset:+.3f} mm and {np.degrees(found.tilt):+.3f}° "
            f"off the board; {found.misfit:.1f} standard deviations, {found.limit:.1f} may be"
        )
        self.operator.report(finding)
        keep = "It contradicts the calibration. Keep that all the same?"
        if not found.line_agrees and not self.operator.confirm(
            Question(keep, False, yes="Finish", no="Redo")
        ):
            raise CalibrationRefused(
                "a fresh line contradicts it",
                f"{finding}; see that board and sensor sit tight, then calibrate again",
            )
        return found

    def _fit_board(self) -> tuple[PlaneTarget, BoardRectangle]:
        target, board = self.task.fit_board(self.measurements)
        off = 1e3 * float(np.sqrt(np.mean(target.residuals**2)))
        self.operator.report(
            f"board touched at {len(target.residuals)} places, {off:.3f} mm RMS off a plane"
        )
        return target, board

    def _touch_place(self, k: int, place_b: Array) -> None:
        x, y, z = 1e3 * place_b
        question = (
            f"{self.probe.touch_question}: place {k + 1} of {self.task.touches}, about "
            f"({x:.0f}, {y:.0f}, {z:.0f}) mm?"
        )
        touched = BoardTouch(k, None)
        if self.operator.confirm(Question(question, True, moves=True)):
            try:
                state = self.probe.touch(place_b)
                touched = BoardTouch(k, state.T_b_f, state.q)
            except PoseUnreachable as error:
                self.operator.report(f"place {k + 1} is passed over: {error}")
        self.logbook.record(touched)

    def _wants_more(self, progress: CalibrationProgress) -> bool:
        count, wanted, refusal = len(progress.samples), progress.wanted, progress.refusal
        if count < wanted:
            return True
        if refusal is not None:
            if count >= MAX_TAKEN_LINES_RATIO * wanted:
                return False
            self.operator.report(str(refusal))
        more = Question("Take one more line?", refusal is not None, no="Finish")
        return self.operator.confirm(more)

    def _take_line(
        self,
        target: PlaneTarget,
        board: BoardRectangle,
        progress: CalibrationProgress,
        *,
        fresh: bool,
    ) -> None:
        """Take the line of the pose with most information; pass over a pose that shows none."""
        if self.measurements.skipped_in_a_row >= MAX_SKIPPED_IN_A_ROW:
            raise CalibrationRefused(
                "no line to be had",
                f"{MAX_SKIPPED_IN_A_ROW} poses in a row were passed over, the last because of: "
                f"{self.measurements.skipped_poses[-1].reason}. Check the place of the "
                "board in the job, and how the laser sits on the flange",
            )
        ready = self._move_to_start()
        reachable = partial(can_reach_and_return, self.arm, ready)
        there = self.task.suggest_line_pose(
            self.measurements, target, board, progress.result, reachable
        )
        what = "the fresh line" if fresh else f"line {len(progress.samples) + 1}"
        way = 1e3 * float(np.linalg.norm(there.T_b_f[:3, 3] - ready[:3, 3]))
        turn = np.degrees(rotation_angle_between(ready, there.T_b_f))
        hope = "" if fresh else f"; certain to {1e3 * there.after.position:.3g} mm after it"
        question = f"Take {what}: move {way:.0f} mm, turn {turn:.0f}°{hope}?"
        if not self.operator.confirm(self._move_question(question, there.T_b_f)):
            self.logbook.record(SkippedPose(there.T_b_f, "declined"))
            return
        reached = self.arm.move_linear(there.T_b_f)
        shot = PosedProfile(what, reached.T_b_f, self.laser.capture(), reached.q)
        samples, refused = fit_profiles([shot], fit_line, self.task.noise)
        if samples:
            self.logbook.record(LaserLineTaken(shot, fresh))
        else:
            reason = refused[what].evidence
            self.operator.report(f"no line there: {reason}")
            self.logbook.record(SkippedPose(there.T_b_f, reason))
        self.arm.move_linear(ready)

    def _move_to_start(self) -> Array:
        """Move to the begin and end of every line: square over the board, clear of it.

        All other poses are reached from here on a straight line that was checked from here.
        """
        state = self.arm.state().T_b_f
        ready = self.task.start_poses(state)
        shift, turn = state[:3, 3] - ready[0][:3, 3], rotation_angle_between(state, ready[0])
        if max(float(np.linalg.norm(shift)), turn) < POSE_REACHED_TOLERANCE:
            return state
        question = "Move the sensor square over the board?"
        if not self.operator.confirm(replace(self._move_question(question, ready[0]), no="Finish")):
            raise CalibrationRefused(
                "the arm may not move", "every line begins square over the board; go on later"
            )
        for T_b_f in ready[:-1]:
            with suppress(PoseUnreachable):
                return self.arm.move_joint_to_pose(T_b_f).T_b_f
        return self.arm.move_joint_to_pose(ready[-1]).T_b_f

    def _move_question(self, text: str, T_b_f: Array) -> Question:
        """Question whether the arm may move to a flange pose."""
        return Question(text, True, moves=True, T_b_f=T_b_f, look=self.laser.capture)


def can_reach_and_return(arm: Arm, ready: Array, T_b_f: Array) -> bool:
    """Whether an arm gets from a flange pose `ready` to another, and back, on a straight line."""
    try:
        arm.check_moves(ready, T_b_f, ready)
    except PoseUnreachable:
        return False
    return True
