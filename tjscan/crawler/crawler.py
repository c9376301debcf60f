"""Follow a joint and weld it, pass by pass: the loop of Kermorgant (2018), figure 2."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from math import cos, inf, pi
from typing import Final, Protocol

import numpy as np

from tjscan.core.bead_segments import BeadSegments
from tjscan.core.errors import CrawlStopped
from tjscan.crawler.arc import CrawlArc
from tjscan.crawler.control_cycle import (
    ControlCycle,
    CrawlDevices,
    HandDrive,
    JointLook,
    drive_by_hand,
)
from tjscan.crawler.guards import Guards
from tjscan.crawler.joint_sections import LastView
from tjscan.crawler.journal import SET_DOWN_EVENT, WARNING_EVENT, PlannedPass
from tjscan.crawler.method import FollowingMethod
from tjscan.crawler.phases import Event, Phase
from tjscan.crawler.plan import AlignmentSettings, PassSettings, WeldSettings, with_rows
from tjscan.recording.journal import Journal, RunEvent, event_recorder
from tjscan.vehicle.vehicle import AT_REST, Twist

TURN_BACK_WAY: Final = 0.5
"""Metres before a reversal from which the vehicle makes room for it."""

WAVE_CURVATURE: Final = 0.05
"""1/m: curvature of the waves of a shuttle, which show how well the vehicle turns."""

MOST_RUN_UPS: Final = 6
"""How often it runs up to a weld until it knows well enough where the torch is."""

STRIKING_SHARE, GAINING_SHARE = 0.25, 0.8
"""Share of the standard deviation at which a weld is stopped to which the torch is known before it
begins, unless another run-up left more than the other share of what it was: 0.15 of 0.6 mm."""

LONGEST_UNREAD_STRETCH: Final = 20e-3
"""Metres of a weld that no profile shows, from which a pass is not planned but looked for again."""

MOST_OFFSET_AT_REVERSAL: Final = 3e-3
"""Metres that the torch is off the joint at most where only a reversal can show more."""

SHUTTLE_WAVE_LENGTH: Final = 0.4
"""Metres of a wave."""

TORCH_AT_REST: Final = 0.2e-3
"""An axis at rest stands no farther beside where it was sent, metres."""

REPORTED_WAIT: Final = 5.0
"""Seconds after which it reports what it waits for before anything moves."""

UNREAD_HERE: Final = (
    ": it is not read here. If the weld hides its edges, stop, set the vehicle where they show and "
    "state with --place where the torch is"
)
"""What a person can do where a weld goes on."""


class WeldOperator(Protocol):
    """Decides whether a pass may be welded."""

    def confirm_weld(self, number: int, assumed: str, *, looks: bool = False) -> bool:
        """Whether gas, wire and current are ready for a pass, no one is in the way, and it is so.

        What is assumed of the joint is empty if that is nothing.
        Of one that `looks`, with the arc out, before that pass: whether no one is in the way.
        """

    def confirm_torch(self) -> bool:
        """Whether the torch, as it was jogged, points at the middle of the joint."""


class PassPlanner(JointLook, Protocol):
    """Plans each pass at *ready* from what the way back showed."""

    def unread_stretch(self) -> float:
        """The longest stretch of the weld that was not read since the last pass, metres."""

    def plan_pass(self, number: int) -> PlannedPass:
        """Plan a pass from what was seen since the one before.

        Raises
        ------
        LookRefused
            If that can't be this joint as it is now.
        """

    def finish(self, laid: int) -> RunEvent:
        """Event that says what was seen since the last pass, of so many, that was laid."""


@dataclass(frozen=True, slots=True)
class CrawlPlan:
    """What is to be done.

    Parameters
    ----------
    alignment : AlignmentSettings
    weld : WeldSettings
    passes : tuple of PassSettings
        In their order.
    planner : PassPlanner, optional
        Of the passes' rows; without, they are as stated.
    """

    alignment: AlignmentSettings
    weld: WeldSettings
    passes: tuple[PassSettings, ...]
    planner: PassPlanner | None = None


@dataclass(frozen=True, slots=True)
class CrawlStart:
    """Where a crawl begins.

    Parameters
    ----------
    passes_done : int
        How many passes are welded already.
    travel : float
        Where the torch is along the joint, from where the weld begins, metres.
    arc_from : float
        Where the arc of the next pass is struck, metres: further on if it was cut short.
    last_view : LastView, optional
        Of the joint, where the vehicle must still be; not looked at if left out.
    was_set_down : bool, optional
        Whether the operator set the vehicle down again, and states where.
    """

    passes_done: int = 0
    travel: float = 0.0
    arc_from: float = 0.0
    last_view: LastView | None = None
    was_set_down: bool = False


class Crawler:
    """One crawl over one joint.

    Parameters
    ----------
    devices : CrawlDevices
        Connected.
    plan : CrawlPlan
    method : FollowingMethod
        Which estimates and steers.
    guards : Guards
    operator : WeldOperator
    journal : Journal
    hand : HandDrive, optional
        Drives by hand before a crawl that begins at its start; none if left out.
    """

    def __init__(
        self,
        devices: CrawlDevices,
        plan: CrawlPlan,
        method: FollowingMethod,
        guards: Guards,
        operator: WeldOperator,
        journal: Journal,
        hand: HandDrive | None = None,
    ) -> None:
        self._devices, self._plan, self._method = devices, plan, method
        self._guards, self._operator, self._hand = guards, operator, hand
        self._report, self._told_bends = event_recorder(journal), -1
        self._cycle = ControlCycle(devices, method, guards, journal, plan.planner)
        power, weld, self._journal = devices.power, plan.weld, journal
        self._arc = CrawlArc(self._cycle, devices.torch, power, weld.arc, journal, weld.height)

    def run(self, start: CrawlStart | None = None) -> None:
        """Align, and weld every pass that is left.

        Parameters
        ----------
        start : CrawlStart, optional
            Where an interrupted crawl left off; from the beginning if left out.

        Raises
        ------
        CrawlStopped
            If a guard stopped it. The vehicle is at rest and takes no command any more.
        VehicleFault, LaserFault
            If a device fails; likewise.
        """
        with self._stopping_if_block_raises():
            self._weld_all(start)

    def shuttle(self, length: float, times: int) -> None:
        """Go out and back along the joint, in gentle waves, so that slip shows; weld nothing.

        Parameters
        ----------
        length : float
            Of the way out, metres.
        times : int
            How often.

        Raises
        ------
        CrawlStopped, VehicleFault, LaserFault
            As `run` does.
        """
        with self._stopping_if_block_raises():
            self._wait_for_joint()
            self._cycle.enter(Event.JOINT_IN_VIEW, "a shuttle begins")
            for _ in range(times):
                self._cycle.come_to_rest()
                while self._cycle.travel < length:
                    self._drive_in_waves(self._plan.alignment.speed)
                self._cycle.come_to_rest()
                while self._cycle.travel > 0:
                    self._drive_in_waves(-self._plan.alignment.return_speed)
            self._cycle.run(AT_REST)

    def rest_until_registered(self, height: float) -> None:
        """Rest behind a shuttle, with the torch over the joint, until a person has put it there.

        Parameters
        ----------
        height : float
            Of the torch over the hull, metres.

        Raises
        ------
        CrawlStopped, VehicleFault, LaserFault
            As `run` does.
        """
        with self._stopping_if_block_raises():
            self._cycle.enter(Event.ALIGNED, "the torch is above the joint")
            self._cycle.enter(Event.AT_START, "put the torch over the middle of the joint")
            self._cycle.come_to_rest(0.0, height)
            while not self._operator.confirm_torch():
                self._cycle.come_to_rest(0.0, height)
            if abs(off := self._cycle.deviation) > TORCH_AT_REST:
                reason = f"the torch's axis stands {1e3 * off:.1f} mm beside where it was jogged to"
                raise CrawlStopped("torch", reason)

    @contextmanager
    def _stopping_if_block_raises(self) -> Iterator[None]:
        """End the arc and stop the vehicle for good if the block raises, whatever it raises."""
        try:
            yield
        except BaseException as error:
            interrupted = isinstance(error, KeyboardInterrupt)
            reason = "interrupted" if interrupted else str(error) or type(error).__name__
            with ExitStack() as stack:  # each is done, whatever the others raise
                stack.callback(self._cycle.enter, Event.DANGER, reason)
                stack.callback(self._devices.vehicle.stop)
                stack.callback(self._arc.put_out)
            raise

    def _drive_in_waves(self, speed: float) -> None:
        """Drive one cycle along the joint, with a wave on top that the encoders see too."""
        wave = WAVE_CURVATURE * speed * cos(2 * pi * self._cycle.travel / SHUTTLE_WAVE_LENGTH)
        self._cycle.run(Twist(speed, self._method.turn_rate(speed) + wave))

    def _weld_all(self, resumed: CrawlStart | None) -> None:
        home, cycle = -self._plan.weld.run_up, self._cycle
        start = resumed or CrawlStart(travel=home)
        cycle.travel = start.travel
        if resumed is None and self._hand is not None:
            self._report(str(cycle.phase), "waits for the start")
            drive_by_hand(self._hand, self._devices.vehicle, cycle, self._guards)
            cycle.come_to_rest()
            cycle.travel = home  # what it rolled on for
        at = f"the torch is at {1e3 * cycle.travel:.1f} mm"
        # Reported before it waits, which may be cut off.
        if start.was_set_down:
            self._report(SET_DOWN_EVENT, f"{at}, as the operator states")
        self._wait_for_joint(goes_on=resumed is not None)
        if resumed is None:
            cycle.enter(Event.JOINT_IN_VIEW, "the joint is in view, with steel all round")
            try:
                self._align(home)
            except CrawlStopped as stop:
                if not cycle.bends:
                    raise
                reason = f"{stop.reason}. It was assumed that {cycle.assumed}"
                raise CrawlStopped(stop.guard, reason) from stop
            cycle.enter(Event.AT_START, "back at the start")
        else:
            if start.last_view is not None:
                start.last_view.check(tuple(cycle.joint.seen))
                self._report("place", f"{at}, which the laser does not contradict")
            cycle.phase = Phase.RETURN  # what was interrupted goes on from the way back
            self._go_back(start.arc_from - self._plan.weld.run_up)
            where = f"pass {start.passes_done + 1} goes on at {1e3 * start.arc_from:.0f} mm"
            cycle.enter(Event.PASSES_LEFT, where)
        for number in range(start.passes_done + 1, len(self._plan.passes) + 1):
            cycle.number = number
            goes_on = start.arc_from if number == start.passes_done + 1 else 0.0
            self._weld_pass(self._plan_pass(number, cut_short=goes_on > 0), goes_on)
            left = len(self._plan.passes) - number
            cycle.all_welded = not left
            self._go_back(home)
            if self._plan.planner is not None and not left:
                cycle.come_to_rest()
                self._journal.record(self._plan.planner.finish(number))
            cycle.enter(
                Event.PASSES_LEFT if left else Event.ALL_WELDED,
                f"back at the start, {left or 'no'} {'pass' if left == 1 else 'passes'} left",
            )

    def _wait_for_joint(self, *, goes_on: bool = False) -> None:
        """Wait at rest until the joint was seen for long enough and there is steel all round."""
        joint = f"the joint in view{UNREAD_HERE if goes_on else ''}"
        seen, limit, waited = 0.0, self._plan.alignment.in_view, 0.0
        while seen < limit or not self._guards.is_on_steel:
            period, found = self._cycle.run(AT_REST)
            seen = seen + period if found else 0.0
            if waited <= REPORTED_WAIT < waited + period:
                missing = "steel below every corner" if seen >= limit else joint
                self._report(str(self._cycle.phase), f"waits for {missing}")
            waited += period

    def _align(self, home: float) -> None:
        """Go out and back; again where the way back shows that the joint bends.

        A bend is only one if all readings since it was found fit a joint that bends there.
        """
        cycle = self._cycle
        while True:
            self._align_forward(home)
            known = len(cycle.bends)
            cycle.enter(Event.ALIGNED, "the torch is above the joint")
            cycle.come_to_rest()
            while cycle.travel > home and len(cycle.bends) == known:
                self._drive_back(home)
            if len(cycle.bends) == known:
                return
            cycle.enter(Event.JOINT_BENDS, "the joint bends")
            cycle.come_to_rest()

    def _align_forward(self, home: float) -> None:
        """Go forward until the torch is above the joint, and known to be."""
        alignment = self._plan.alignment
        while True:
            out, torch = self._cycle.travel - home, self._method.torch
            since = self._cycle.travel - max([home, *self._cycle.bends[-1:]])
            is_long = since >= alignment.longest  # then only a reversal can show more
            doubt = min(2 * torch.sigma, MOST_OFFSET_AT_REVERSAL) * is_long
            known = torch.sigma <= alignment.offset_sigma
            off = abs(torch.offset)
            if out >= alignment.length and off <= max(alignment.offset, doubt) and known:
                if off > alignment.offset:
                    where = f"goes back with the torch {1e3 * off:.1f} mm off the joint"
                    self._report(str(self._cycle.phase), where)
                return
            if is_long:
                raise CrawlStopped(
                    "not aligned",
                    f"after {out:.2f} m the torch is {1e3 * off:.1f} mm off the "
                    f"joint, known to {1e3 * torch.sigma:.1f} mm",
                )
            self._cycle.drive(alignment.speed)

    def _go_back(self, place: float) -> None:
        """Go backward to a place along the joint."""
        self._cycle.come_to_rest()
        while self._cycle.travel > place:
            self._drive_back(place)

    def _drive_back(self, place: float) -> None:
        """Drive one cycle backward, towards a place at which it turns."""
        turns_back = self._cycle.travel - place < TURN_BACK_WAY
        self._cycle.drive(-self._plan.alignment.return_speed, turns_back=turns_back)

    def _plan_pass(self, number: int, *, cut_short: bool) -> PassSettings:
        """A pass as it is to be welded: planned from what was seen, or as it is stated.

        One that was cut short goes on as it was begun.
        """
        one, planner = self._plan.passes[number - 1], self._plan.planner
        if planner is None or cut_short:
            return one
        self._cycle.come_to_rest()  # seconds without a cycle follow
        if (unread := planner.unread_stretch()) > LONGEST_UNREAD_STRETCH:
            self._look_along(number)
            self._cycle.come_to_rest()
            unread = planner.unread_stretch()
        if unread > LONGEST_UNREAD_STRETCH:
            raise CrawlStopped(
                "not seen", f"{1e3 * unread:.0f} mm of the weld were not read, and not planned"
            )
        planned = planner.plan_pass(number)
        self._journal.record(planned)
        self._report("planned", planned.text)
        return with_rows(one, planned.table)

    def _look_along(self, number: int) -> None:
        """Go along the weld and back with the arc out, to see it all."""
        self._confirm_weld(looks=True)
        self._cycle.enter(Event.WELD_CONFIRMED, f"looks at the whole weld before pass {number}")
        while self._cycle.travel < self._plan.weld.length:
            self._cycle.drive(self._plan.alignment.speed)
        self._cycle.enter(Event.JOINT_NOT_SEEN, "goes back, to see the weld")
        self._go_back(-self._plan.weld.run_up)
        self._cycle.enter(Event.PASSES_LEFT, f"back at the start, before pass {number}")

    def _weld_pass(self, one: PassSettings, arc_from: float) -> None:
        """Go along the joint with the arc burning where the weld is."""
        end, table = self._plan.weld.length, one.table
        first = table.at(np.array(arc_from))
        self._run_up_to_strike(first, arc_from)
        self._guards.watch_weld(self._cycle.deviation, self._method.torch.sigma)
        self._method.check_slip()
        self._arc.strike(first)
        burning = 0.0
        while self._cycle.travel < end:
            cycle, sigma = self._cycle, self._method.torch.sigma
            self._guards.watch_weld(cycle.deviation, sigma, burning=cycle.arc)
            here = table.at(np.array(cycle.travel))
            swing = float(here.weave)
            if one.edge_gap is not None:
                width = cycle.joint.width_at(cycle.travel)
                swing = max(width / 2 - one.edge_gap, 0.0)
            path = float(here.offset) + swing * one.swing(burning)
            height = float(here.height) + self._arc.advance(here)
            burning += cycle.drive(float(here.speed), path, height)
        self._arc.end(table.at(np.array(end)))
        self._cycle.enter(Event.PASS_WELDED, f"pass {self._cycle.number} is welded")

    def _confirm_weld(self, path: float = 0.0, height: float = 0.0, *, looks: bool = False) -> None:
        """Wait for the operator at rest: he takes his time, and no guard looks meanwhile."""
        (cycle := self._cycle).come_to_rest()
        while True:  # what is assumed may be another thing after each wait
            if (assumed := cycle.assumed) and self._told_bends != len(cycle.bends):
                self._told_bends = len(cycle.bends)
                self._report(WARNING_EVENT, f"it is assumed that {assumed}")
            if self._operator.confirm_weld(cycle.number, assumed, looks=looks):
                return
            cycle.come_to_rest(path, height)

    def _run_up_to_strike(self, first: BeadSegments, arc_from: float) -> None:
        """Come to where the arc is to be struck; again if the torch is not known there.

        What is not known is the crab, which only a reversal shows. It goes on without the arc
        first: each reversal puts the vehicle aside, and takes some way to make up for.
        """
        speed, path, height = (float(x) for x in (first.speed, first.offset, first.height))
        before = inf
        for left in reversed(range(MOST_RUN_UPS)):
            self._confirm_weld(path, height)
            self._cycle.come_to_rest(path, height)
            self._cycle.enter(
                Event.WELD_CONFIRMED, f"pass {self._cycle.number} at {1e3 * speed:g} mm/s"
            )
            while self._cycle.travel < arc_from:
                self._cycle.drive(speed, path, height)
            sigma = self._method.torch.sigma
            gains_nothing = self._guards.knows_torch(sigma) and sigma > GAINING_SHARE * before
            if self._guards.knows_torch(sigma / STRIKING_SHARE) or gains_nothing or not left:
                return
            before = sigma
            beyond = min(arc_from + self._plan.alignment.length, self._plan.weld.length)
            while self._cycle.travel < beyond:
                self._cycle.drive(self._plan.alignment.speed)
            self._cycle.enter(Event.TORCH_NOT_KNOWN, f"the torch was known to {1e3 * sigma:.2f} mm")
            self._go_back(arc_from - self._plan.weld.run_up)
            self._cycle.enter(Event.PASSES_LEFT, f"pass {self._cycle.number} again")
