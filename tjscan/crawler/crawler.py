"""Follow a joint and weld it, pass by pass: the loop of Kermorgant (2018), figure 2."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import cos, nan, pi
from typing import Final, Protocol

from tjscan.core.errors import CrawlStopped
from tjscan.crawler.guards import Guards
from tjscan.crawler.joint_sensor import JointReader, JointSensor
from tjscan.crawler.journal import CrawlCycle, CrawlJournal
from tjscan.crawler.last_view import LastView
from tjscan.crawler.method import FollowingMethod
from tjscan.crawler.phases import Event, Phase, next_phase
from tjscan.crawler.plan import AlignmentSettings, WeldSettings
from tjscan.crawler.torch_axes import TorchAxes
from tjscan.crawler.torch_path import PassSettings
from tjscan.laser.line_laser import LineLaser
from tjscan.vehicle.vehicle import REST, Twist, Vehicle

TURN_BACK: Final = 0.5
"""Metres before a reversal from which the vehicle makes room for it."""

WAVE: Final = 0.05
"""1/m: curvature of the waves of a shuttle, which show how well the vehicle turns."""

STANDS: Final = 30
"""Cycles for which it stands before it turns back."""

RUN_UPS: Final = 6
"""How often it runs up to a weld until it knows well enough where the torch is."""

WAVELENGTH: Final = 0.4
"""Metres of a wave."""

PATIENCE: Final = 5.0
"""Seconds after which it says what it waits for before anything moves."""

LONGEST_PERIOD: Final = 2.0
"""Seconds from one state of the vehicle to the next, beyond which nobody knows where it went."""


class WeldOperator(Protocol):
    """Who says that a pass may be welded."""

    def confirm_weld(self, number: int) -> bool:
        """Whether gas, wire and current are ready for a pass, and nobody is in the way."""
        ...


@dataclass(frozen=True, slots=True)
class CrawlDevices:
    """What a crawl works with.

    Parameters
    ----------
    vehicle : Vehicle
    laser : LineLaser
    torch : TorchAxes
    reader : JointReader
    clock : callable, optional
        Gives the seconds on the clock that the laser's profiles are dated by.
    """

    vehicle: Vehicle
    laser: LineLaser
    torch: TorchAxes
    reader: JointReader
    clock: Callable[[], float] | None = None


@dataclass(frozen=True, slots=True)
class CrawlPlan:
    """What is to be done.

    Parameters
    ----------
    alignment : AlignmentSettings
    weld : WeldSettings
    passes : tuple of PassSettings
        In their order.
    """

    alignment: AlignmentSettings
    weld: WeldSettings
    passes: tuple[PassSettings, ...]


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
        Of the joint, where the vehicle must still stand; not looked at where left out.
    """

    passes_done: int = 0
    travel: float = 0.0
    arc_from: float = 0.0
    last_view: LastView | None = None


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
    journal : CrawlJournal
    """

    def __init__(
        self,
        devices: CrawlDevices,
        plan: CrawlPlan,
        method: FollowingMethod,
        guards: Guards,
        operator: WeldOperator,
        journal: CrawlJournal,
    ) -> None:
        self._devices, self._plan, self._method = devices, plan, method
        self._guards, self._operator, self._journal = guards, operator, journal
        self._joint = JointSensor(devices.laser, devices.reader, devices.clock, journal)
        self._phase, self._all_welded = Phase.MANUAL, False
        self._number, self._travel, self._arc = 0, 0.0, False
        self._time: float | None = None
        self._deviation = 0.0

    def run(self, start: CrawlStart | None = None) -> None:
        """Align, and weld every pass that is left.

        Parameters
        ----------
        start : CrawlStart, optional
            Where an interrupted crawl left off; from the beginning where left out.

        Raises
        ------
        CrawlStopped
            If a guard stopped it. The vehicle stands and takes no command any more.
        VehicleFault, LaserFault
            If a device fails; likewise.
        """
        with self._stopped_by_errors():
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
        with self._stopped_by_errors():
            self._wait_for_joint()
            self._enter(Event.JOINT_IN_VIEW, "a shuttle begins")
            for _ in range(times):
                self._come_to_rest()
                while self._travel < length:
                    self._drive_in_waves(self._plan.alignment.speed)
                self._come_to_rest()
                while self._travel > 0:
                    self._drive_in_waves(-self._plan.alignment.return_speed)
            self._cycle(REST)

    @contextmanager
    def _stopped_by_errors(self) -> Iterator[None]:
        """End the arc and stop the vehicle for good where the block raises, whatever it raises."""
        try:
            yield
        except BaseException as error:
            try:
                self._devices.torch.set_arc(burning=False)
            finally:
                self._devices.vehicle.stop()
            interrupted = isinstance(error, KeyboardInterrupt)
            reason = "interrupted" if interrupted else str(error) or type(error).__name__
            self._enter(Event.DANGER, reason)
            raise

    def _drive_in_waves(self, speed: float) -> None:
        """Drive one cycle along the joint, with a wave on top that the encoders see too."""
        wave = WAVE * speed * cos(2 * pi * self._travel / WAVELENGTH)
        self._cycle(Twist(speed, self._method.turn_rate(speed) + wave))

    def _weld_all(self, start: CrawlStart | None) -> None:
        home = -self._plan.weld.run_up
        self._travel = home if start is None else start.travel
        self._wait_for_joint()
        if start is None:
            self._enter(Event.JOINT_IN_VIEW, "the joint is in view, with steel all round")
            self._align_forward(home)
            self._enter(Event.ALIGNED, "the torch is above the joint")
            self._go_back(home)
            self._enter(Event.AT_START, "back at the start")
        else:
            if start.last_view is not None:
                start.last_view.check(self._joint.seen)
            told = "the operator says" if start.last_view is None else "the laser does not gainsay"
            self._journal.record_event(
                "place", f"the torch is at {1e3 * start.travel:.1f} mm, as {told}"
            )
            self._phase = Phase.RETURN  # what was interrupted goes on from the way back
            self._go_back(start.arc_from - self._plan.weld.run_up)
            where = f"pass {start.passes_done + 1} goes on at {1e3 * start.arc_from:.0f} mm"
            self._enter(Event.PASSES_LEFT, where)
        done = 0 if start is None else start.passes_done
        for number in range(done + 1, len(self._plan.passes) + 1):
            arc_from = 0.0 if start is None or number > done + 1 else start.arc_from
            self._weld_pass(number, arc_from)
            self._all_welded = number == len(self._plan.passes)
            self._go_back(home)
            left = len(self._plan.passes) - number
            self._enter(
                Event.PASSES_LEFT if left else Event.ALL_WELDED,
                f"back at the start, {left or 'no'} {'pass' if left == 1 else 'passes'} left",
            )

    def _wait_for_joint(self) -> None:
        """Stand until the joint was seen for long enough and there is steel all round."""
        seen, limit, waited = 0.0, self._plan.alignment.in_view, 0.0
        while seen < limit or not self._guards.stands_on_steel:
            period, found = self._cycle(REST)
            seen = seen + period if found else 0.0
            if waited <= PATIENCE < waited + period:
                missing = "steel below every corner" if seen >= limit else "the joint in view"
                self._journal.record_event(str(self._phase), f"waits for {missing}")
            waited += period

    def _align_forward(self, home: float) -> None:
        """Go forward until the torch is above the joint, and known to be."""
        alignment = self._plan.alignment
        while True:
            out, torch = self._travel - home, self._method.torch
            aligned = (
                abs(torch.offset) <= alignment.offset and torch.sigma <= alignment.offset_sigma
            )
            if out >= alignment.length and aligned:
                return
            if out >= alignment.longest:
                raise CrawlStopped(
                    "not aligned",
                    f"after {out:.2f} m the torch is {1e3 * abs(torch.offset):.1f} mm off the "
                    f"joint, known to {1e3 * torch.sigma:.1f} mm",
                )
            self._drive(alignment.speed)

    def _come_to_rest(self, path: float = 0.0, height: float = 0.0) -> None:
        """Stand before the way is turned: what pads and drives do meanwhile, no model knows."""
        for _ in range(STANDS):
            self._cycle(REST, path, height)

    def _go_back(self, place: float) -> None:
        """Go backward to a place along the joint."""
        self._come_to_rest()
        while (left := self._travel - place) > 0:
            self._drive(-self._plan.alignment.return_speed, turns_back=left < TURN_BACK)

    def _weld_pass(self, number: int, arc_from: float) -> None:
        """Go along the joint with the arc burning where the weld is."""
        one, end = self._plan.passes[number - 1], self._plan.weld.length
        self._number = number
        self._run_up(one, arc_from)
        burning = 0.0
        while self._travel < end:
            self._guards.watch_weld(self._deviation, self._method.torch.sigma)
            if not self._arc:
                self._set_arc(True)
            burning += self._drive(one.speed, one.offset_at(burning), one.height)
        self._set_arc(False)
        self._enter(Event.PASS_WELDED, f"pass {number} is welded")

    def _run_up(self, one: PassSettings, arc_from: float) -> None:
        """Come to where the arc is to be struck; once more where the torch is not known there.

        What is not known is the crab, which only a reversal shows. It goes on without the arc
        first: each reversal puts the vehicle aside, and takes some way to make up for.
        """
        for left in reversed(range(RUN_UPS)):
            self._come_to_rest()  # an operator takes his time, and nobody looks meanwhile
            while not self._operator.confirm_weld(self._number):
                self._cycle(REST)
            self._come_to_rest(one.offset, one.height)
            self._enter(Event.WELD_CONFIRMED, f"pass {self._number} at {1e3 * one.speed:g} mm/s")
            while self._travel < arc_from:
                self._drive(one.speed, one.offset, one.height)
            sigma = self._method.torch.sigma
            if self._guards.knows_torch(sigma) or not left:
                return
            beyond = min(arc_from + self._plan.alignment.length, self._plan.weld.length)
            while self._travel < beyond:
                self._drive(self._plan.alignment.speed)
            self._enter(Event.TORCH_NOT_KNOWN, f"the torch was known to {1e3 * sigma:.2f} mm")
            self._go_back(arc_from - self._plan.weld.run_up)
            self._enter(Event.PASSES_LEFT, f"pass {self._number} once more")

    def _set_arc(self, burning: bool) -> None:
        self._devices.torch.set_arc(burning=burning)
        self._arc = burning
        where = f"pass {self._number} at {1e3 * self._travel:.1f} mm"
        self._journal.record_event("arc on" if burning else "arc off", where)

    def _drive(
        self, speed: float, path: float = 0.0, height: float = 0.0, *, turns_back: bool = False
    ) -> float:
        """Drive for one cycle, steered along the joint; returns its seconds."""
        turn = self._method.turn_rate(speed, turns_back=turns_back)
        return self._cycle(Twist(speed, turn), path, height)[0]

    def _cycle(self, twist: Twist, path: float = 0.0, height: float = 0.0) -> tuple[float, bool]:
        """Command, measure, estimate, guard; returns the seconds, and if the joint was read."""
        devices, method = self._devices, self._method
        self._guards.check_command(twist)
        devices.vehicle.command(twist)
        state = devices.vehicle.next_state()
        period = self._period_until(state.time)
        self._guards.watch_vehicle(state, period)
        self._guards.watch_progress(twist.speed, state.odometry.speed, period)
        if period > 0:
            method.move(state.odometry, period, twist)
        self._travel += state.odometry.speed * period

        profile, reading = self._joint.look(self._travel)
        d = d_sigma = None
        if reading is not None:
            d, d_sigma = -reading.centre, reading.centre_sigma
            method.read(d, d_sigma)
        torch = method.torch
        torch_y = devices.torch.move(path - torch.offset, height, period)
        self._deviation = torch.offset + torch_y - path
        self._journal.record_cycle(
            CrawlCycle(
                self._phase,
                self._number,
                self._travel,
                state,
                twist,
                torch,
                torch_y,
                path,
                self._arc,
                nan if d is None else d,
                nan if d_sigma is None else d_sigma,
                method.slip,
            ),
            profile,
        )
        if self._phase is not Phase.MANUAL:
            believed = method.laser if self._all_welded else None
            self._guards.watch_joint(d, state.odometry.speed, period, believed=believed)
        return period, d is not None

    def _period_until(self, time: float) -> float:
        """Seconds since the last state; none where it stood, and an operator was waited for."""
        period = 0.0 if self._time is None else time - self._time
        if self._phase in (Phase.MANUAL, Phase.READY) and period > LONGEST_PERIOD:
            period = 0.0
        if not 0 <= period <= LONGEST_PERIOD:
            raise CrawlStopped(
                "clock",
                f"the vehicle's clock went on by {period:.3f} s from one state to the next",
            )
        self._time = time
        return period

    def _enter(self, event: Event, detail: str) -> None:
        self._phase = next_phase(self._phase, event)
        self._journal.record_event(str(self._phase), detail)
