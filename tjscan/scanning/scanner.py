"""Algorithm 1: predict, scan, correct, scan, step by step along the groove."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tjscan.core.errors import (
    ConfigurationError,
    GrooveNotFound,
    JointMoved,
    PoseUnreachable,
    SetPointRefused,
    StartSeesNoGroove,
)
from tjscan.core.frames import Array
from tjscan.groove.section import GrooveSection
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan.robot.arm import Arm, ArmState
from tjscan.scanning.checks.plausible import check_measures
from tjscan.scanning.correction import correct
from tjscan.scanning.correction_criterion import deviation, uncertainty
from tjscan.scanning.events import ScanEvent
from tjscan.scanning.journal import Journal
from tjscan.scanning.method import predictor_of, step_rule_of
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.profile_taker import ProfileTaker
from tjscan.scanning.progress import StopReason, finished, groove_length
from tjscan.scanning.result import InterruptedScan, ScanResult
from tjscan.scanning.retries import climb
from tjscan.scanning.section import ScannedSection, Substep
from tjscan.scanning.set_point import Predictor, SetPoint, StepRule
from tjscan.scanning.step_request import StepRequest
from tjscan.scanning.stopping import StopRequest
from tjscan.scanning.target import Direction


class Scanner:
    """The stepwise scan of Cibicik et al. 2022, Algorithm 1.

    Parameters
    ----------
    arm : Arm
        Carries the laser.
    laser : LineLaser
        Takes the profiles.
    T_f_s : ndarray, shape (4, 4)
        The laser on the hand, from calibration.
    read : callable
        Turns a profile into a groove section, or raises GrooveNotFound.
    plan : ScanPlan
        Step, direction, view and end.
    journal : Journal
        Is told of everything at once.
    predictor : Predictor, optional
        Says where the next section lies; the plan's where left out.
    step_of : StepRule, optional
        Says how far to step; the plan's where left out.
    stop : StopRequest, optional
        Asks for an end before the plan is fulfilled.
    """

    def __init__(
        self,
        arm: Arm,
        laser: LineLaser,
        T_f_s: Array,
        read: Callable[[Profile], GrooveSection],
        plan: ScanPlan,
        journal: Journal,
        predictor: Predictor | None = None,
        step_of: StepRule | None = None,
        stop: StopRequest | None = None,
    ) -> None:
        self._arm, self._plan, self._journal = arm, plan, journal
        self._predict = predictor or predictor_of(plan)
        self._step_of = step_of or step_rule_of(plan)
        self._stop = stop or StopRequest()
        self._hand = ProfileTaker(arm, laser, T_f_s, read, plan, journal, self._stop)
        self._sections: list[ScannedSection] = []

    def run(self, T_b_f_first: Array, T_b_f_second: Array) -> ScanResult:
        """Scan from two taught flange poses until the plan is fulfilled or no step is possible.

        Raises
        ------
        StartSeesNoGroove
            If a taught pose sees no groove.
        PoseUnreachable
            If a taught pose can't be reached.
        ConfigurationError
            If the taught poses don't go the way that the plan asks for.
        ArmFault, LaserFault
            If a device fails; what was measured until then is in the journal.
        Interrupted
            If everything was to stop at once.
        """
        self._finish(self._taught("first", self._arm.move_joint, T_b_f_first))
        self._finish(self._taught("second", self._arm.move_linear, T_b_f_second))
        self._check_direction()
        return self._go_on()

    def resume(self, done: InterruptedScan) -> ScanResult:
        """Go back to the last section of an interrupted scan, see that nothing moved, and go on.

        Parameters
        ----------
        done : InterruptedScan
            What was found before, two sections or more.

        Raises
        ------
        JointMoved
            If it lies elsewhere now, or is not found any more.
        ArmFault, LaserFault, Interrupted
            As `run` does.
        """
        self._sections = list(done.sections)
        self._hand.remember(done.views, done.counts)
        moved = self._return(self._arm.move_joint)
        last = len(self._sections) - 1
        self._hand.note(ScanEvent.RESUMED, f"after section {last}, moved {1e3 * moved:.3f} mm")
        return self._go_on()

    def _go_on(self) -> ScanResult:
        """Step until the plan is fulfilled or no step is possible."""
        while True:
            step = self._step_of(self._sections)
            if (stop := finished(self._plan, self._sections, step)) is not None:
                return self._end(stop)
            self._stop.check()
            if self._stop.wanted:
                self._hand.note(
                    ScanEvent.STOP_REQUESTED, f"after section {len(self._sections) - 1}"
                )
                return self._end(StopReason.REQUESTED)
            try:
                scan = climb(self._step, self._retreat, step, self._hand.note)
            except PoseUnreachable as error:
                return self._end(StopReason.UNREACHABLE, str(error))
            except (GrooveNotFound, JointMoved) as error:
                return self._end(StopReason.LOST, str(error))
            except SetPointRefused as error:
                return self._end(StopReason.REFUSED, str(error))
            self._finish(scan)

    def _step(self, d_st: float) -> ScannedSection:
        """Algorithm 1: from the finished sections to the next one."""
        last = self._sections[-1]

        # Prediction substep
        ahead = self._predict(self._sections, d_st)  # (7)
        request = StepRequest(last, ahead.T_b_t[:3, 3], d_st)
        predicted = self._scan(Substep.PREDICTION, ahead, request)

        # Correction substep
        T_s_t = self._plan.target(predicted.groove.work_angle)  # (14)
        ideal = SetPoint(correct(last.T_b_g, predicted.T_b_g), T_s_t)  # (12)
        if self._is_good_enough(predicted, ideal, ahead, request):
            return predicted
        return self._scan(Substep.CORRECTION, ideal, replace(request, predicted=predicted))

    def _is_good_enough(
        self, predicted: ScannedSection, ideal: SetPoint, ahead: SetPoint, request: StepRequest
    ) -> bool:
        """Whether the prediction view may be the section's: it looks well, and fits the last."""
        skip = self._plan.skip
        if skip is None:
            return False
        sigma = uncertainty(predicted.groove, ahead, request.length, self._plan.direction)
        if not skip.allows(deviation(predicted, ideal), sigma):
            return False
        try:
            check_measures(predicted, request)
        except GrooveNotFound:
            return False
        return True

    def _scan(self, substep: Substep, to: SetPoint, request: StepRequest) -> ScannedSection:
        """Lay frame t on its set-point, take a profile and read it."""
        return self._hand.scan(len(self._sections), substep, to, request, self._sections[-2])

    def _taught(
        self, which: str, move: Callable[[Array], ArmState], T_b_f: Array
    ) -> ScannedSection:
        """Go to a taught pose and read the groove there."""
        state = self._hand.move(move, T_b_f)
        try:
            return self._hand.look(len(self._sections), Substep.TAUGHT, state, self._hand.read)
        except GrooveNotFound as error:
            raise StartSeesNoGroove(which, error) from None

    def _retreat(self) -> None:
        """Go back to the last section on a line, and see that it lies where it lay."""
        self._return(self._arm.move_linear)

    def _return(self, move: Callable[[Array], ArmState]) -> float:
        """Go back to the last section; gives the metres that it seems to have moved since.

        Raises
        ------
        JointMoved
            If they are too many, or it is not found any more.
        """
        last, tolerance = self._sections[-1], self._plan.return_tolerance
        state = self._hand.move(move, last.view.T_b_f)
        try:
            now = self._hand.look(
                len(self._sections) - 1,
                Substep.RESUMED,
                state,
                lambda view: self._hand.read(view, last.T_s_t),
            )
        except GrooveNotFound as error:
            raise JointMoved(f"the last section is not there any more: {error}") from None
        moved = float(np.linalg.norm(now.points_b - last.points_b, axis=1)[1:4].max())
        if moved > tolerance:
            raise JointMoved(
                f"the last section lies {1e3 * moved:.2f} mm from where it was, "
                f"{1e3 * tolerance:.2f} mm are allowed"
            )
        return moved

    def _finish(self, scan: ScannedSection) -> None:
        self._sections.append(scan)
        self._journal.section(scan)

    def _check_direction(self) -> None:
        """Refuse taught poses that coincide or lead the other way round than the plan."""
        first, second = (scan.T_b_g for scan in self._sections)
        forward = float((second[:3, 3] - first[:3, 3]) @ first[:3, 0])
        if self._plan.direction is Direction.CLOCKWISE:
            forward = -forward
        if forward < 0.1 * self._plan.step:
            apart = 1e3 * float(np.linalg.norm(second[:3, 3] - first[:3, 3]))
            raise ConfigurationError(
                f"the second taught section lies {apart:.1f} mm from the first, "
                f"{'behind it' if forward < 0 else 'too close'} for a {self._plan.direction} scan; "
                "teach the second pose about one step further on, or turn the direction",
                key="scan.second",
            )

    def _end(self, stop: StopReason, cause: str = "") -> ScanResult:
        length = 1e3 * groove_length(self._sections[1:])
        detail = f"{stop} after {length:.1f} mm from the second taught section"
        detail = f"{detail}: {cause}" if cause else detail
        self._hand.note(ScanEvent.STOP, detail)
        views = tuple(self._hand.views)
        return ScanResult(tuple(self._sections), views, stop, detail, self._hand.counts)
