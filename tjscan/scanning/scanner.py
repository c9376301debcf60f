"""Algorithm 1: predict, scan, correct, scan, step by step along the groove."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from tjscan.core import errors
from tjscan.core.frames import Array
from tjscan.groove.section import GrooveSection
from tjscan.recording.journal import Journal
from tjscan.robot.arm import ArmState
from tjscan.scanning import retries, sections_before
from tjscan.scanning.journal import (
    RecordedScan,
    ScanEvent,
    ScanResult,
    ScanResultsJournal,
    StopReason,
    groove_length,
    plan_is_fulfilled,
    reason_to_stop,
)
from tjscan.scanning.plan import ScanPlan, adaptive_step_rule, view_deviation, view_deviation_sigmas
from tjscan.scanning.profile_taker import ProfileTaker, ScanSetup
from tjscan.scanning.section import (
    ProfileView,
    ScannedSection,
    Sections,
    SetPoint,
    SetPointPredictor,
    StepRequest,
    Substep,
)
from tjscan.scanning.smooth import predictor_for_plan
from tjscan.scanning.stopping import StopRequest
from tjscan.scanning.target import correction_target_pose

MOST_RETURNS: Final = 3
"""Sections, `PLANNING_SPACING` apart, that are looked for before a joint counts as moved."""

LEAST_SHARE_AHEAD: Final = 0.1
"""Of a step, that the second taught section is ahead of the first at least."""


class Scanner:
    """The stepwise scan of Cibicik et al. 2022, Algorithm 1.

    Parameters
    ----------
    setup : ScanSetup
        Arm, laser, how the laser is mounted, and what reads its profiles.
    plan : ScanPlan
        Step, direction, view and end.
    journal : Journal
        Receives everything at once.
    predictor : SetPointPredictor, optional
        Predicts where the next section is; the plan's if left out.
    stop : StopRequest, optional
        Asks for an end before the plan is fulfilled.
    """

    def __init__(
        self,
        setup: ScanSetup,
        plan: ScanPlan,
        journal: Journal,
        predictor: SetPointPredictor | None = None,
        stop: StopRequest | None = None,
    ) -> None:
        self._setup, self._plan = setup, plan
        self._predict = predictor or predictor_for_plan(plan)
        adaptive = None if plan.adaptive is None else adaptive_step_rule(plan.adaptive)
        self._step_length = adaptive or (lambda sections: plan.step)
        self._stop = stop or StopRequest()
        self._log = ScanResultsJournal(journal)
        self._taker = ProfileTaker(setup, self._log, self._stop, plan.settle)

    def run(self, T_b_f_first: Array, T_b_f_second: Array) -> ScanResult:
        """Scan from two taught flange poses until the plan is fulfilled or no step is possible.

        Parameters
        ----------
        T_b_f_first, T_b_f_second : ndarray, shape (4, 4)
            The taught poses, the second about a step further along the groove, metres.

        Raises
        ------
        StartSeesNoGroove
            If no groove is seen from a taught pose.
        StartOnTack
            If a taught pose looks at a tack weld.
        PoseUnreachable
            If a taught pose can't be reached.
        ConfigurationError
            If the taught poses don't lead the way that the plan asks for.
        ArmFault, LaserFault
            If a device fails; what was measured until then is in the journal.
        Interrupted
            If everything was to stop at once.
        """
        self._scan_taught("first", self._taker.move_joint_to_pose(T_b_f_first))
        self._scan_taught("second", self._taker.move_linear(T_b_f_second))
        first, second = (section.T_b_g for section in self._log.sections[:2])
        least = LEAST_SHARE_AHEAD * self._plan.step
        sections_before.check_second_is_ahead(first, second[:3, 3], self._plan.direction, least)
        return self._scan_until_done()

    def resume(self, done: RecordedScan, sections: Sections) -> ScanResult:
        """Go back to the last section of an interrupted scan, check that it is there, and go on.

        Parameters
        ----------
        done : RecordedScan
            What was recorded before.
        sections : sequence of ScannedSection
            Its finished sections, two or more.

        Raises
        ------
        JointMoved
            If the last section is elsewhere now, or is not found any more.
        PoseUnreachable
            Before anything moves, if the arm can't get from where it is into the
            configuration that it scanned in.
        ArmFault, LaserFault, Interrupted
            As `run` does.
        """
        self._log.restore_from_recording(done, sections)
        for view in done.views:
            self._taker.remember_view(view)
        moved = self._return_to_last_section()
        detail = f"after section {len(sections) - 1}, moved {1e3 * moved:.3f} mm"
        self._log.record_event(ScanEvent.RESUMED, detail)
        return self._scan_until_done()

    def _scan_until_done(self) -> ScanResult:
        """Step until the plan is fulfilled or no step is possible."""
        sections = self._log.sections
        while True:
            d_st = self._step_length(sections)
            if (stop := reason_to_stop(self._plan, sections, d_st)) is not None:
                return self._end_scan(stop)
            ended = self._wait_for_permission() or self._make_step(d_st)
            if ended is not None:
                return ended

    def _wait_for_permission(self) -> ScanResult | None:
        """Wait until the scan may go on; the scan's result if it shall end instead."""
        after = f"after section {len(self._log.sections) - 1}"
        self._stop.wait_while_paused(partial(self._log.record_event, ScanEvent.PAUSED, after))
        self._stop.raise_if_stop_now()
        if not self._stop.ends_after_section:
            return None
        self._log.record_event(ScanEvent.STOP_REQUESTED, after)
        return self._end_scan(StopReason.REQUESTED)

    def _make_step(self, d_st: float) -> ScanResult | None:
        """Make a step; the scan's result if none is possible."""
        return self._ended_by(lambda: self._finish_section(self._step_with_retries(d_st)))

    def _ended_by(self, move: Callable[[], object]) -> ScanResult | None:
        """The scan's result if it can't go on because of a move; else nothing."""
        try:
            move()
        except errors.PoseUnreachable as error:
            return self._end_scan(StopReason.UNREACHABLE, str(error))
        except (errors.GrooveNotFound, errors.JointMoved) as error:
            return self._end_scan(StopReason.LOST, str(error))
        except errors.SetPointTooFar as error:
            return self._end_scan(StopReason.REFUSED, str(error))
        return None

    def _finish_section(self, section: ScannedSection) -> None:
        """Finish a section.

        From one on a tack weld the scan steps on: wall and leg, which lead it, are seen there.
        """
        if section.groove.on_tack:
            self._log.record_event(ScanEvent.TACK, f"section {section.view.index}: stepped over")
        self._log.record(section)

    def _step_with_retries(self, d_st: float) -> ScannedSection:
        """Make a step; if it leads to no section, one of `step_retries`.

        Raises
        ------
        GrooveNotFound, SetPointTooFar
            If the groove is not read in any of them.
        JointMoved
            If the last section is not where it was.
        PoseUnreachable
            If the step itself leads out of reach, and the shorter ones do not help.
        """
        lost: errors.GrooveNotFound | errors.SetPointTooFar | errors.PoseUnreachable
        try:
            return self._step(d_st)
        except retries.NotRead as error:
            lost = error
        except errors.PoseUnreachable as error:
            if plan_is_fulfilled(StopReason.UNREACHABLE, self._plan):
                raise
            lost = error
        for retry in retries.step_retries(d_st, past_tacks=isinstance(lost, errors.GrooveNotFound)):
            self._log.record_event(retry.event, retry.describe(lost))
            try:
                if retry.from_last_section:
                    self._return_to_last_section()
                return self._step(retry.length)
            except retries.NotRead as error:
                lost = error
            except errors.PoseUnreachable:
                continue  # of a step on a bend: the next one starts or ends elsewhere
            except errors.JointMoved as moved:
                raise errors.JointMoved(f"after {lost}, {moved.evidence}") from None
        raise lost

    def _step(self, d_st: float) -> ScannedSection:
        """Algorithm 1: from the finished sections to the next one."""
        last = self._log.sections[-1]

        # Prediction substep
        ahead = self._predict(self._log.sections, d_st)  # (7)
        step = StepRequest(last, ahead.T_b_t[:3, 3], d_st)
        predicted = self._read_near_set_point(Substep.PREDICTION, ahead, step)

        # Correction substep
        T_s_t = self._plan.target_pose_in_sensor(predicted.groove.work_angle)  # (14)
        ideal = SetPoint(correction_target_pose(last.T_b_g, predicted.T_b_g), T_s_t)  # (12)
        if self._needs_no_correction(predicted, ideal, ahead, step):
            return predicted
        return self._read_near_set_point(
            Substep.CORRECTION, ideal, replace(step, predicted=predicted)
        )

    def _needs_no_correction(
        self, predicted: ScannedSection, ideal: SetPoint, ahead: SetPoint, step: StepRequest
    ) -> bool:
        """Whether the prediction view may be the section's: near the ideal, clear, plausible."""
        criterion = self._plan.correction_criterion
        if criterion is None:
            return False
        sigma = view_deviation_sigmas(predicted.groove, ahead, step.length, self._plan.direction)
        near = criterion.allows_skipping(view_deviation(predicted, ideal), sigma)
        clear = sections_before.root_is_seen(predicted.groove)
        return near and clear and sections_before.measures_are_plausible(predicted, step)

    def _read_near_set_point(
        self, substep: Substep, to: SetPoint, step: StepRequest
    ) -> ScannedSection:
        """Read the groove from a set-point, or from others near it.

        Raises
        ------
        SetPointTooFar
            Before anything moves, if the set-point does not fit the step.
        GrooveNotFound
            If no section is read that fits the step.
        PoseUnreachable, LaserFault
            As devices do.
        """
        lost: errors.GrooveNotFound | errors.SetPointTooFar
        try:
            return self._read_from_set_point(to, substep, step)
        except retries.NotRead as error:
            lost = error
        before, seen = self._log.sections[-2], self._log.views[-1].profile
        others = retries.fallback_set_points(lost, to, seen, before, step, self._plan.direction)
        for change, other in others:
            where = f"section {len(self._log.sections)}, {substep}"
            self._log.record_event(ScanEvent.NUDGE, f"{where}, {change}: {lost}")
            try:
                return self._read_from_set_point(other, substep, step, once=True)
            except (*retries.NotRead, errors.PoseUnreachable):
                continue
        raise lost

    def _read_from_set_point(
        self, to: SetPoint, substep: Substep, step: StepRequest, *, once: bool = False
    ) -> ScannedSection:
        """Move frame t to a set-point and read the groove there."""
        sections_before.check_set_point(to, step, self._plan)
        state = self._taker.move_to_set_point(to)
        return self._read_until_found(
            state, len(self._log.sections), substep, to.T_s_t, step, once=once
        )

    def _read_until_found(
        self,
        state: ArmState,
        index: int,
        substep: Substep,
        T_s_t: Array | None = None,
        step: StepRequest | None = None,
        *,
        once: bool = False,
    ) -> ScannedSection:
        """Take profiles from where the arm is until one is read; only one of them if `once`.

        A section whose root is not seen counts only if no other profile shows it either.

        Raises
        ------
        GrooveNotFound
            What was wrong with the last one.
        LaserFault
            If no profile comes.
        """
        views = [self._taker.take_view(index, substep, state)]
        rootless: ScannedSection | None = None
        while True:
            try:
                section = self._read_and_check(views[-1], T_s_t, step)
                if once or sections_before.root_is_seen(section.groove):
                    return section
                rootless, why, most = section, "the root is not seen", 1 + retries.REPEATED_PROFILES
            except errors.GrooveNotFound as error:
                lost, why, most = error, str(error), retries.max_profiles_per_pose(error)
            if once or len(views) >= most:
                break
            self._log.record_event(ScanEvent.TAKEN_AGAIN, f"section {index}, {substep}: {why}")
            views.append(self._taker.take_view(index, substep, state))
        # From a prediction view without the root a correction follows, which may show it.
        if rootless:
            merging = substep is not Substep.PREDICTION
        else:
            merging = lost.reason != retries.TOO_FEW_POINTS
        merged = self._taker.take_and_merge_views(views, state) if merging and not once else None
        if merged is not None:
            what = f"section {index}, {substep}, {retries.MERGED_PROFILES} profiles: {why}"
            self._log.record_event(ScanEvent.MERGED, what)
            try:
                return self._read_and_check(merged, T_s_t, step)
            except errors.GrooveNotFound as error:
                lost = error
        if rootless:
            return rootless
        raise lost

    def _read_and_check(
        self, view: ProfileView, T_s_t: Array | None, step: StepRequest | None
    ) -> ScannedSection:
        """Read the groove in a view and check that it fits the step, if there is one.

        Without T_s_t frame t is where the plan wants it for this groove.

        Raises
        ------
        GrooveNotFound
            If no groove is read, or another one than was expected.
        """

        def wanted(groove: GrooveSection) -> Array:
            return self._plan.target_pose_in_sensor(groove.work_angle)

        place = wanted if T_s_t is None else T_s_t
        section = sections_before.read_section(self._setup.read, view, place, self._log.sections)
        sections_before.check_section_orientation(section.groove)
        if step is not None:
            sections_before.check_section_one_step_ahead(section, step)
            if view.substep is Substep.CORRECTION:
                sections_before.check_measures_plausible(section, step)
                sections_before.check_agrees_with_prediction(section, step)
        return section

    def _scan_taught(self, which: str, state: ArmState) -> None:
        """Read the groove at a taught pose, as the next section."""
        try:
            section = self._read_until_found(state, len(self._log.sections), Substep.TAUGHT)
        except errors.GrooveNotFound as error:
            raise errors.StartSeesNoGroove(which, error) from None
        if section.groove.on_tack:
            raise errors.StartOnTack(which)
        self._log.record(section)

    def _return_to_last_section(self) -> float:
        """Go back and see that the joint is where it was; gives the metres it seems to have moved.

        A section in passing may be read in no profile from one place: then those before it tell.

        Raises
        ------
        JointMoved
            If they are too many, or none of the last sections is found any more.
        PoseUnreachable
            If the arm can't get to the last one.
        """
        *before, last = sections_before.planning_sections(self._log.sections)[-MOST_RETURNS:]
        lost = ""
        for section in (last, *reversed(before)):
            view = section.view
            try:
                state = self._taker.move_joint_to_pose(view.T_b_f, near=view.q)
                moved = self._distance_moved(section, state)
            except errors.GrooveNotFound as error:
                lost = lost or str(error)
            except errors.PoseUnreachable:
                if section is last:
                    raise
                break
            else:
                if section is not last:
                    self._taker.move_joint_to_pose(last.view.T_b_f, near=last.view.q)
                return moved
        raise errors.JointMoved(f"the last section is not there any more: {lost}")

    def _distance_moved(self, section: ScannedSection, state: ArmState) -> float:
        """Read a section again; gives the metres that it seems to have moved.

        Raises
        ------
        JointMoved
            If they are too many.
        GrooveNotFound
            If it is not read.
        """
        tolerance, index = self._plan.return_tolerance, len(self._log.sections) - 1
        now = self._read_until_found(state, index, Substep.RESUMED, section.T_s_t)
        apart = np.linalg.norm(now.points_b - section.points_b, axis=1)[1:4]
        known = sections_before.largest_chance_differences(now.groove, section.groove) < tolerance
        moved = float(apart[known].max(initial=apart.min()))
        if moved > tolerance:
            raise errors.JointMoved(
                f"section {section.view.index} is {1e3 * moved:.2f} mm from where it was, "
                f"{1e3 * tolerance:.2f} mm are allowed"
            )
        return moved

    @property
    def _length_gone(self) -> float:
        """Metres of groove from the second taught section on."""
        return groove_length(self._log.sections[1:])

    def _end_scan(self, stop: StopReason, cause: str = "") -> ScanResult:
        log = self._log
        detail = f"{stop} after {1e3 * self._length_gone:.1f} mm from the second taught section"
        detail = f"{detail}: {cause}" if cause else detail
        log.record_event(ScanEvent.STOP, detail)
        return ScanResult(tuple(log.sections), tuple(log.views), stop, detail, log.counts)
