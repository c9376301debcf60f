"""Algorithm 1: predict, scan, correct, scan, step by step along the groove."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tjscan.errors import (
    ConfigurationError,
    GrooveNotFound,
    JointMoved,
    PoseUnreachable,
    StartSeesNoGroove,
)
from tjscan.frames import Array, inverse, unit
from tjscan.groove.section import GrooveSection
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan.robot.arm import Arm, ArmState
from tjscan.scanning.correction import correct
from tjscan.scanning.journal import Journal
from tjscan.scanning.method import predictor_of, step_rule_of
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.plausible import check_step
from tjscan.scanning.progress import StopReason, finished, groove_length
from tjscan.scanning.scan import Scan, Substep, View
from tjscan.scanning.set_point import Predictor, SetPoint, StepRule
from tjscan.scanning.target import Direction


@dataclass(frozen=True, slots=True, eq=False)
class ScanResult:
    """What a scan found.

    Parameters
    ----------
    sections : tuple of Scan
        The finished sections in order, the two taught ones first.
    views : tuple of View
        Every profile taken, in order.
    stop : StopReason
        Why it ended.
    detail : str
        The same in one sentence, with numbers.
    half_steps : int
        How often a section was not found and tried again at half the step.
    """

    sections: tuple[Scan, ...]
    views: tuple[View, ...]
    stop: StopReason
    detail: str
    half_steps: int


@dataclass(frozen=True, slots=True, eq=False)
class Progress:
    """What an interrupted scan had found.

    Parameters
    ----------
    sections, views : tuple
        As in `ScanResult`.
    half_steps : int
        As in `ScanResult`.
    """

    sections: tuple[Scan, ...]
    views: tuple[View, ...]
    half_steps: int


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
    ) -> None:
        self._arm, self._laser, self._T_f_s = arm, laser, T_f_s
        self._read, self._plan, self._journal = read, plan, journal
        self._predict = predictor or predictor_of(plan)
        self._step_of = step_of or step_rule_of(plan)
        self._views: list[View] = []
        self._sections: list[Scan] = []
        self._half_steps = 0

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
        """
        self._finish(self._taught("first", self._arm.move_joint, T_b_f_first))
        self._finish(self._taught("second", self._arm.move_linear, T_b_f_second))
        self._check_direction()
        return self._go_on()

    def resume(self, done: Progress, tolerance: float) -> ScanResult:
        """Go back to the last section of an interrupted scan, see that nothing moved, and go on.

        Parameters
        ----------
        done : Progress
            What was found before, two sections or more.
        tolerance : float
            How far the last section may seem to have moved, metres.

        Raises
        ------
        JointMoved
            If it lies elsewhere now, or is not found any more.
        ArmFault, LaserFault
            As `run` does.
        """
        self._sections, self._views = list(done.sections), list(done.views)
        self._half_steps = done.half_steps
        last = self._sections[-1]
        view = self._look(Substep.RESUMED, self._arm.move_joint(last.view.T_b_f))
        try:
            now = Scan(view, self._read(view.profile), last.T_s_t)
        except GrooveNotFound as error:
            raise JointMoved(f"the last section is not there any more: {error}") from None
        moved = float(np.linalg.norm(now.points_b - last.points_b, axis=1)[1:4].max())
        if moved > tolerance:
            raise JointMoved(
                f"the last section lies {1e3 * moved:.2f} mm from where it was, "
                f"{1e3 * tolerance:.2f} mm are allowed"
            )
        self._journal.event("resumed", f"after section {view.index}, moved {1e3 * moved:.3f} mm")
        return self._go_on()

    def _go_on(self) -> ScanResult:
        """Step until the plan is fulfilled or no step is possible."""
        while True:
            step = self._step_of(self._sections)
            if (stop := finished(self._plan, self._sections, step)) is not None:
                return self._end(stop)
            try:
                scan = self._step_or_half_step(step)
            except PoseUnreachable as error:
                return self._end(StopReason.UNREACHABLE, str(error))
            except GrooveNotFound as error:
                return self._end(StopReason.LOST, str(error))
            self._finish(scan)

    def _step_or_half_step(self, step: float) -> Scan:
        """One step of that length, or of half of it where the groove is not found."""
        try:
            return self._step(step)
        except GrooveNotFound as error:
            self._half_steps += 1
            self._journal.event("half step", f"section {len(self._sections)}: {error}")
            return self._step(step / 2)

    def _step(self, d_st: float) -> Scan:
        """Algorithm 1: from the last two sections to the next one."""
        last = self._sections[-1]

        # Prediction substep
        ahead = self._predict(self._sections, d_st)  # (7)
        direction_b = unit(ahead.T_b_t[:3, 3] - last.T_b_t[:3, 3])
        predicted = self._scan(Substep.PREDICTION, ahead)
        check_step(last.T_b_g[:3, 3], predicted.T_b_g[:3, 3], direction_b, d_st)

        # Correction substep
        T_s_t = self._plan.target(predicted.groove.work_angle)  # (14)
        T_b_t = correct(last.T_b_g, predicted.T_b_g)  # (12)
        corrected = self._scan(Substep.CORRECTION, SetPoint(T_b_t, T_s_t))
        check_step(last.T_b_g[:3, 3], corrected.T_b_g[:3, 3], direction_b, d_st)
        return corrected

    def _scan(self, substep: Substep, to: SetPoint) -> Scan:
        """Lay frame t on its set-point, take a profile and read it."""
        state = self._arm.move_linear(to.T_b_t @ inverse(self._T_f_s @ to.T_s_t))
        view = self._look(substep, state)
        return Scan(view, self._read(view.profile), to.T_s_t)

    def _taught(self, which: str, move: Callable[[Array], ArmState], T_b_f: Array) -> Scan:
        """Go to a taught pose and read the groove there."""
        view = self._look(Substep.TAUGHT, move(T_b_f))
        try:
            groove = self._read(view.profile)
        except GrooveNotFound as error:
            raise StartSeesNoGroove(which, error) from None
        return Scan(view, groove, self._plan.target(groove.work_angle))

    def _look(self, substep: Substep, state: ArmState) -> View:
        profile = self._laser.capture()
        T_b_s = state.T_b_f @ self._T_f_s
        resumed = substep is Substep.RESUMED  # looks at the last section once more
        index = len(self._sections) - resumed
        view = View(index, substep, state.T_b_f, T_b_s, profile, state.time, state.q)
        self._views.append(view)
        self._journal.view(view)
        return view

    def _finish(self, scan: Scan) -> None:
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
        self._journal.event("stop", detail)
        sections, views = tuple(self._sections), tuple(self._views)
        return ScanResult(sections, views, stop, detail, self._half_steps)
