"""One cycle of a crawl: command, measure, estimate, guard, record; and cycles driven by hand."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import floor, isfinite, nan
from typing import Final, Protocol

import numpy as np

from tjscan.core.errors import CrawlStopped, GrooveNotFound
from tjscan.crawler.contradiction import ContradictionWatch
from tjscan.crawler.guards import Guards
from tjscan.crawler.joint_sections import shows_filled_joint
from tjscan.crawler.joint_tracking.registration import JointPlacement
from tjscan.crawler.journal import BEND_EVENT, TORCH_EVENT, CrawlCycle, is_by_hand
from tjscan.crawler.method import FollowingMethod
from tjscan.crawler.phases import Event, Phase, next_phase
from tjscan.crawler.torch_axes import TorchAxes, TorchJog
from tjscan.crawler.torch_trace import TRACED_PHASES, TorchTracer
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan.power.source import PowerSource
from tjscan.recording.journal import Journal, RunEvent
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import AT_REST, Twist, Vehicle

CYCLES_AT_REST: Final = 30
"""Cycles for which it rests before it turns back."""

LONGEST_PERIOD: Final = 2.0
"""Seconds from one state of the vehicle to the next, beyond which its way is not known."""

MOST_STATES_AT_ONE_TIME: Final = 25
"""States in a row that the vehicle may date alike: half a second of a usual one. Without time no
way is added up, and none of the limits that are on way or time is ever reached."""

MOST_PROFILE_AGE: Final = 0.1
"""Seconds before now, or after it by a clock gone wrong, from which on a profile is not read: ten
of a sensor's periods, in which a vehicle that turns at 40 mm/s goes on by 4 mm."""

MOST_KEPT_PROFILES: Final = 10
"""Profiles that are kept."""

MOST_BENDS: Final = 3
"""How often the joint may be found to bend: what bends on and on has a radius, which the job must
state, or is no joint that bends."""

WIDTH_STATION_LENGTH: Final = 5e-3
"""Metres of the joint for which one mean width is kept."""


class JointReader(Protocol):
    """Finds the joint in profiles, one after another."""

    def read(self, profile: Profile, travel: float) -> JointPlacement:
        """Find the joint in a profile.

        Parameters
        ----------
        profile : Profile
        travel : float
            Where the torch is along the joint, metres.

        Raises
        ------
        GrooveNotFound
            If it does not show it.
        """


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
    tracks : TrackGeometry, optional
        Of the vehicle: by it its twist shows what each track does.
    jog : TorchJog, optional
        What a person adds to the torch's path; nothing if left out.
    laser_to_torch : float, optional
        How far the laser's line is ahead of the torch, metres.
    power : PowerSource, optional
        Of the arc; without, the torch has one of its own.
    torch_aside : float, optional
        How far the torch is to the right of the laser's zero where its axis is at zero, metres.
    """

    vehicle: Vehicle
    laser: LineLaser
    torch: TorchAxes
    reader: JointReader
    clock: Callable[[], float] | None = None
    tracks: TrackGeometry = field(default_factory=TrackGeometry)
    jog: TorchJog = field(default_factory=lambda: TorchJog(0.0))
    laser_to_torch: float = 0.5
    power: PowerSource | None = None
    torch_aside: float = 0.0


class JointSensor:
    """A laser with its reader, which takes no profile of another time.

    Parameters
    ----------
    devices : CrawlDevices
        Its laser, its reader and its clock; without a clock profiles of any time are read.
    journal : Journal
        Receives an event if profiles are not read for their age.
    look : JointLook, optional
        Knows how far the joint has closed; not at all if left out.
    """

    def __init__(
        self, devices: CrawlDevices, journal: Journal, look: JointLook | None = None
    ) -> None:
        self._devices, self._journal, self._late = devices, journal, False
        self._look = look
        self.seen: deque[tuple[float, Profile]] = deque(maxlen=MOST_KEPT_PROFILES)
        """The last profiles that were read, with laser minus bare joint in each, metres."""
        self._widths: dict[int, tuple[float, int]] = {}
        self.at_bead_end = False
        """Whether the laser is where beads end: nothing is read there, nor told by the picture."""

    def look(self, travel: float) -> tuple[Profile, JointPlacement | None]:
        """Take a profile, and find the joint in it, if it shows it and is of now.

        Parameters
        ----------
        travel : float
            Where the torch is along the joint, metres.

        Raises
        ------
        LaserFault
            If no profile comes.
        """
        profile = self._devices.laser.capture()
        off = self._profile_age(profile)
        was_late, self._late = self._late, off > MOST_PROFILE_AGE
        if self._late:
            if not was_late:
                detail = f"a profile of the laser is dated {off:.2f} s off the clock, and not read"
                self._journal.record(RunEvent("old profile", detail))
            return profile, None
        at = travel + self._devices.laser_to_torch
        self.at_bead_end = self._look is not None and self._look.at_bead_end(at)
        if self.at_bead_end:
            return profile, None
        try:
            reading = self._devices.reader.read(profile, travel)
        except GrooveNotFound:
            return profile, None
        moved = 0.0 if self._look is None else self._look.middle_moved(at)
        self.seen.append((moved - reading.centre, profile))
        if isfinite(reading.width):
            station = floor(at / WIDTH_STATION_LENGTH)
            mean, count = self._widths.get(station, (0.0, 0))
            self._widths[station] = mean + (reading.width - mean) / (count + 1), count + 1
        return profile, reading

    def width_at(self, travel: float) -> float:
        """Width between the joint's top edges as these were read at a place along it, metres.

        Between places it is linear; before the first and behind the last one it holds on.

        Raises
        ------
        CrawlStopped
            If the edges were read nowhere.
        """
        if not self._widths:
            raise CrawlStopped(
                "edges", "the joint's edges were read nowhere: state weave_mm, and no edge_gap_mm"
            )
        stations = sorted(self._widths)
        widths = [self._widths[station][0] for station in stations]
        return float(np.interp(travel / WIDTH_STATION_LENGTH - 0.5, stations, widths))

    def _profile_age(self, profile: Profile) -> float:
        """Seconds between a profile and now, at the least; none if the laser dates nothing."""
        clock = self._devices.clock
        if clock is None or profile.time == 0.0:
            return 0.0
        return abs(clock() - profile.time) - profile.time_uncertainty


class JointLook(Protocol):
    """Receives what the laser shows of the joint."""

    def see(self, cycle: CrawlCycle, placement: JointPlacement) -> None:
        """Take in a cycle, and where the joint is in its profile."""

    def middle_moved(self, at: float) -> float:
        """How far to the right the middle between the edges has moved since the joint was bare.

        Metres, at a place along the joint: where it closes as it is welded it no longer runs as it
        did, and what is steered along is the bare joint.
        """

    def at_bead_end(self, at: float) -> bool:
        """Whether beads end about a place along the joint, metres.

        Edges and outlines there are of neither of two sections: a bead's end looks like an edge.
        """


class ControlCycle:
    """The cycles of one crawl, and what they go on from.

    Parameters
    ----------
    devices : CrawlDevices
        Connected.
    method : FollowingMethod
        Which estimates and steers.
    guards : Guards
    journal : Journal
    look : JointLook, optional
        Receives every profile in which the joint was read.

    Attributes
    ----------
    joint : JointSensor
        What reads the joint.
    phase : Phase
        What the crawler does.
    number : int
        Of the pass, from 1; 0 before the first.
    travel : float
        Along the joint from where the weld begins, by the encoders, metres. What is driven by hand
        is no way along it.
    arc : bool
        Whether the arc burns.
    speed : float
        Along the joint as last measured, m/s.
    deviation : float
        Of the torch from its path, as estimated, metres.
    bends : list of float
        Where the torch was when the joint was found to bend ahead, as `travel`.
    all_welded : bool
        Whether nothing is left to weld: the joint need not be seen then.
    """

    def __init__(
        self,
        devices: CrawlDevices,
        method: FollowingMethod,
        guards: Guards,
        journal: Journal,
        look: JointLook | None = None,
    ) -> None:
        self._devices, self._method, self._guards = devices, method, guards
        self._journal, self._look, self.speed = journal, look, 0.0
        self.joint = JointSensor(devices, journal, look)
        self._watch, self._tracer = ContradictionWatch(devices.tracks), TorchTracer(method)
        self._time: float | None = None
        self._states_at_one_time = 0
        self.phase, self.number, self.travel = Phase.MANUAL, 0, 0.0
        self.arc, self.deviation, self.all_welded = False, 0.0, False
        self.bends: list[float] = []

    def come_to_rest(self, path: float = 0.0, height: float = 0.0) -> None:
        """Rest before the way is turned: what pads and drives do meanwhile, no model knows."""
        for _ in range(CYCLES_AT_REST):
            self.run(AT_REST, path, height)

    def set_arc(self, *, burning: bool) -> None:
        """Strike the arc, or end it."""
        self._devices.torch.set_arc(burning=burning)
        self.arc = burning
        where = f"pass {self.number} at {1e3 * self.travel:.1f} mm"
        if jog := self._devices.jog.offset:
            where += f", the torch jogged by {1e3 * jog:+.2f} mm"
        name = "arc" if self._devices.power is None else "enable"  # then the source strikes it
        self._journal.record(RunEvent(f"{name} {'on' if burning else 'off'}", where))

    def drive(
        self, speed: float, path: float = 0.0, height: float = 0.0, *, turns_back: bool = False
    ) -> float:
        """Drive for one cycle, steered along the joint; returns its seconds.

        Parameters
        ----------
        speed : float
            Forward, m/s.
        path, height : float, optional
            Of the torch beside the joint and out of the hull, metres.
        turns_back : bool, optional
            Whether it is about to turn back.
        """
        turn = self._method.turn_rate(speed, turns_back=turns_back)
        return self.run(Twist(speed, turn), path, height)[0]

    def run(
        self, twist: Twist, path: float = 0.0, height: float = 0.0, *, stopped: bool = False
    ) -> tuple[float, bool]:
        """Command, measure, estimate, guard.

        Parameters
        ----------
        twist : Twist
            To be commanded.
        path, height : float, optional
            Of the torch beside the joint and out of the hull, metres.
        stopped : bool, optional
            Whether the vehicle was stopped, and takes no command.

        Returns
        -------
        period : float
            Seconds since the last state.
        read : bool
            Whether the joint was read.

        Raises
        ------
        CrawlStopped, VehicleFault, LaserFault
            If a guard sees danger, or a device fails; nothing is stopped here.
        """
        devices, method = self._devices, self._method
        self._guards.check_command(twist)
        if not stopped:
            devices.vehicle.command(twist)
        state = devices.vehicle.next_state()
        period = self._period_until(state.time)
        self._guards.watch_vehicle(state, period)
        self._guards.watch_progress(twist.speed, state.odometry.speed, period)
        misfits = (0.0, 0.0)
        if is_by_hand(self.phase, twist):
            method.forget_place()
        else:
            if period > 0:
                misfits = method.move(state, period, twist)
            self.travel += state.odometry.speed * period
        self.speed = state.odometry.speed

        profile, reading = self.joint.look(self.travel)
        d, d_sigma, misfit = nan, nan, None
        if reading is not None:
            d, d_sigma = self.joint.seen[-1][0], reading.centre_sigma
            misfit = method.read(d, d_sigma)
        torch, jog = method.torch, devices.jog.offset
        path += jog
        aside = devices.torch_aside
        torch_y = devices.torch.move(path - torch.offset - aside, height, period) + aside
        cycle = CrawlCycle(
            self.phase,
            self.number,
            self.travel,
            state,
            twist,
            torch,
            torch_y,
            path,
            self.arc,
            d,
            d_sigma,
            method.slip,
            profile,
            jog,
            *method.laser_to_centre,
        )
        self.deviation = cycle.deviation
        self._journal.record(cycle)
        if self._look is not None and reading is not None:
            self._look.see(cycle, reading)
        if self.arc:
            self._tracer.add(self.number, self.travel, torch_y - path)
        unread_in_view = reading is None and self._guards.surely_in_view(method.laser)
        filled = unread_in_view and shows_filled_joint(profile)
        if self.phase is Phase.MANUAL or self.all_welded:
            self._watch.begin_again()
        else:
            aligns = self.phase in (Phase.FORWARD_ALIGNMENT, Phase.BACKWARD_ALIGNMENT)
            self._watch.add(
                twist,
                state.odometry,
                period,
                profile,
                misfit,
                sigma=0.0 if reading is None else reading.lone_sigma,
                filled=filled or self.joint.at_bead_end,
                follow_bend=self._follow_bend if aligns and twist != AT_REST else None,
            )
            self._watch.inertial.add(state, misfits, period)
        if self.phase is not Phase.MANUAL and not self.joint.at_bead_end:  # a few mm, or at rest
            self._guards.watch_joint(
                None if reading is None else d,
                state.odometry.speed,
                period,
                estimated=method.laser if self.all_welded else None,
                filled=filled,
            )
        return period, reading is not None

    def _follow_bend(self) -> bool:
        """Let the method take the joint for one that bends here; see `FollowingMethod`."""
        if len(self.bends) == MOST_BENDS or not self._method.follow_bend():
            return False
        self.bends.append(self.travel)
        ahead = self.travel + self._devices.laser_to_torch
        where = f"the joint may bend about {1e3 * ahead:.0f} mm: it aligns again"
        self._journal.record(RunEvent(BEND_EVENT, where))
        return True

    @property
    def assumed(self) -> str:
        """What is assumed of the joint because readings contradict a straight one."""
        slip, told = self._method.slip, []
        for start, end, aside, sigma in slip.bends if slip is not None else ():
            where = [f"{1e3 * (self.travel + place):.0f}" for place in (start, end)]
            by = f"{1e3 * abs(aside):.1f} ± {1e3 * sigma:.1f} mm"
            side = "right" if aside > 0 else "left"
            told.append(f"by {by} to the {side} from {' to '.join(where)} mm")
        return f"the joint bends {' and '.join(told)}, and no track slips there" if told else ""

    def _period_until(self, time: float) -> float:
        """Seconds since the last state; none if it was at rest, and an operator was waited for."""
        period = 0.0 if self._time is None else time - self._time
        if self.phase in (Phase.MANUAL, Phase.READY) and period > LONGEST_PERIOD:
            period = 0.0
        if not 0 <= period <= LONGEST_PERIOD:
            off = f"the vehicle's clock went on by {period:.3f} s from one state to the next"
            raise CrawlStopped("clock", off)
        self._states_at_one_time = self._states_at_one_time + 1 if time == self._time else 0
        if self._states_at_one_time > MOST_STATES_AT_ONE_TIME:
            still = f"the vehicle's clock stands still at {time:.3f} s: look at its driver"
            raise CrawlStopped("clock", still)
        self._time = time
        return period

    def enter(self, event: Event, detail: str) -> None:
        """Go on to the phase that an event leads to."""
        phase = next_phase(self.phase, event)
        if phase in TRACED_PHASES and (trace := self._tracer.finish()) is not None:
            self._journal.record(trace)
            self._journal.record(RunEvent(TORCH_EVENT, trace.text))
        self.phase = phase
        self._journal.record(RunEvent(str(self.phase), detail))


class HandDrive(Protocol):
    """Drives the crawler to its joint by hand, and decides when the crawl begins."""

    def order(self) -> Twist | None:
        """Return the twist asked for at this moment; None once the crawl may begin.

        It is asked for in every cycle, and is `tjscan.vehicle.vehicle.AT_REST` if no one has
        asked for any lately: who drives by hand must go on saying so.
        """


def drive_by_hand(hand: HandDrive, vehicle: Vehicle, cycle: ControlCycle, guards: Guards) -> None:
    """Drive as a person asks, until he lets the crawl begin.

    If nothing is asked for, or a way towards an edge, the vehicle is stopped, not only commanded
    to rest: it brakes as hard as it can.

    Parameters
    ----------
    hand : HandDrive
    vehicle : Vehicle
        That of the cycle.
    cycle : ControlCycle
    guards : Guards

    Raises
    ------
    CrawlStopped, VehicleFault, LaserFault
        As `ControlCycle.run` does.
    """
    vehicle.stop()
    stopped = True
    while (twist := hand.order()) is not None:
        stays = twist == AT_REST or guards.leads_off_steel(twist)
        if stays and not stopped:
            vehicle.stop()
        elif stopped and not stays:
            vehicle.accept_commands_again()
        stopped = stays
        cycle.run(AT_REST if stays else twist, stopped=stopped)
    vehicle.accept_commands_again()
