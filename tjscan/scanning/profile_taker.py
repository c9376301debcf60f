"""The arm with the laser on it: goes where it is told, and looks until it can read."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

from tjscan.core.errors import GrooveNotFound, LaserFault, PoseUnreachable, SetPointRefused
from tjscan.core.frames import Array, inverse
from tjscan.groove.section import GrooveSection
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan.robot.arm import Arm, ArmState
from tjscan.scanning.checks.frozen_profile import FrozenProfileCheck
from tjscan.scanning.checks.guard import check_set_point
from tjscan.scanning.checks.plausible import check_agreement, check_measures, check_side, check_step
from tjscan.scanning.events import EventCounts, ScanEvent
from tjscan.scanning.journal import Journal
from tjscan.scanning.merged import merge
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.retries import FEW, MERGED, MISSING, others, takes
from tjscan.scanning.section import ScannedSection, Substep, View
from tjscan.scanning.set_point import SetPoint
from tjscan.scanning.step_request import StepRequest
from tjscan.scanning.stopping import StopRequest


class ProfileTaker:
    """Takes views and reads them, by remedies where a profile is bad; see `remedies`.

    Parameters
    ----------
    arm, laser, T_f_s, read, plan, journal, stop
        As `Scanner` has them.
    """

    def __init__(
        self,
        arm: Arm,
        laser: LineLaser,
        T_f_s: Array,
        read: Callable[[Profile], GrooveSection],
        plan: ScanPlan,
        journal: Journal,
        stop: StopRequest,
    ) -> None:
        self._arm, self._laser, self._T_f_s = arm, laser, T_f_s
        self._read, self._plan, self._journal, self._stop = read, plan, journal, stop
        self._seen = FrozenProfileCheck()
        self.views: list[View] = []
        self.counts = EventCounts()

    def remember(self, views: Iterable[View], counts: EventCounts) -> None:
        """Go on from what was done before."""
        self.views, self.counts = list(views), counts
        for view in self.views:
            self._seen.add(view)

    def note(self, event: ScanEvent, detail: str) -> None:
        """Tell the journal of an event, and count it."""
        self.counts = self.counts.counting(event)
        self._journal.event(event, detail)

    def move(self, by: Callable[[Array], ArmState], T_b_f: Array) -> ArmState:
        """Move the arm, unless everything is to stop."""
        self._stop.check()
        return by(T_b_f)

    def look(
        self,
        index: int,
        substep: Substep,
        state: ArmState,
        read: Callable[[View], ScannedSection],
        *,
        again: bool = True,
    ) -> ScannedSection:
        """Take profiles where the arm stands until one is read, a bounded number of times.

        Without `again` only the first one is read.

        Raises
        ------
        GrooveNotFound
            What was wrong with the last one.
        LaserFault
            If no profile comes.
        """
        views: list[View] = []
        while True:
            views.append(self._take(index, substep, state))
            try:
                return read(views[-1])
            except GrooveNotFound as error:
                lost = error
            if not again or len(views) >= takes(lost):
                break
            self.note(ScanEvent.TAKEN_AGAIN, f"section {index}, {substep}: {lost}")
        if again and lost.reason != FEW and (merged := self._merged(views, state)) is not None:
            self.note(ScanEvent.MERGED, f"section {index}, {substep}, {MERGED} profiles: {lost}")
            return read(merged)
        raise lost

    def read(self, view: View, T_s_t: Array | None = None) -> ScannedSection:
        """Read the groove in a view; without T_s_t frame t is laid as the plan lays it."""
        groove = self._read(view.profile)
        check_side(groove)
        return ScannedSection(
            view, groove, self._plan.target(groove.work_angle) if T_s_t is None else T_s_t
        )

    def scan(
        self,
        index: int,
        substep: Substep,
        to: SetPoint,
        request: StepRequest,
        before: ScannedSection,
    ) -> ScannedSection:
        """Lay frame t on a set-point and read the groove, from a little beside if need be.

        Parameters
        ----------
        index, substep
            As in `View`.
        to : SetPoint
            Where.
        request : StepRequest
            The step under way, which the set-point and the section have to fit.
        before : ScannedSection
            The section before the one that the step starts from.

        Raises
        ------
        SetPointRefused
            Before anything moves, if the set-point does not fit.
        GrooveNotFound
            If none is read that fits.
        PoseUnreachable, LaserFault
            As devices do.
        """
        try:
            return self._lay(index, substep, to, request)
        except (GrooveNotFound, SetPointRefused) as error:
            lost = error
        seen = self.views[-1].profile
        for words, other in others(lost, to, seen, before, request, self._plan.direction):
            self.note(ScanEvent.NUDGE, f"section {index}, {substep}, {words}: {lost}")
            try:
                return self._lay(index, substep, other, request, again=False)
            except (GrooveNotFound, SetPointRefused, PoseUnreachable):
                continue
        raise lost

    def _lay(
        self,
        index: int,
        substep: Substep,
        to: SetPoint,
        request: StepRequest,
        *,
        again: bool = True,
    ) -> ScannedSection:
        """Lay frame t on a set-point and look."""
        check_set_point(to, request, self._plan)
        state = self._go(to)

        def read(view: View) -> ScannedSection:
            found = self.read(view, to.T_s_t)
            check_step(found, request)
            if substep is Substep.CORRECTION:
                check_measures(found, request)
                check_agreement(found, request)
            return found

        return self.look(index, substep, state, read, again=again)

    def _go(self, to: SetPoint) -> ArmState:
        """Go to a set-point, on a line where that is wanted or the joints' way is not clear."""
        T_b_f = to.T_b_t @ inverse(self._T_f_s @ to.T_s_t)
        if not to.straight:
            try:
                # As it stands, or not at all: on its way round a joint no arm changes sides.
                return self.move(partial(self._arm.move_joint, near=self._arm.state().q), T_b_f)
            except PoseUnreachable as error:
                self.note(ScanEvent.STRAIGHT, str(error))
        return self.move(self._arm.move_linear, T_b_f)

    def _merged(self, views: list[View], state: ArmState) -> View | None:
        """Merge profiles of where the arm stands, where they hold different points."""
        first = views[0]
        while len(views) < MERGED:
            views.append(self._take(first.index, first.substep, state))
        profile = merge([view.profile for view in views])
        return None if profile is None else self._keep(replace(first, profile=profile))

    def _take(self, index: int, substep: Substep, state: ArmState) -> View:
        """Take a profile that shows what is before the sensor now."""
        profile = self._capture(index, substep, state)
        T_b_s = state.T_b_f @ self._T_f_s
        view = View(index, substep, state.T_b_f, T_b_s, profile, state.time, state.q)
        self._seen.add(view)
        return self._keep(view)

    def _keep(self, view: View) -> View:
        self.views.append(view)
        self._journal.view(view)
        return view

    def _capture(self, index: int, substep: Substep, state: ArmState) -> Profile:
        """Take a profile, again while it is missing, late or frozen."""
        missed = 0
        while True:
            self._stop.check()
            try:
                profile = self._laser.capture()
                self._seen.check(profile, state)
                return profile
            except LaserFault as error:
                missed += 1
                if missed > MISSING:
                    raise LaserFault(
                        f"{missed} profiles in a row were no good, the last one because: {error}"
                    ) from error
                self.note(ScanEvent.TAKEN_AGAIN, f"section {index}, {substep}: {error}")
