"""Lead the torch along a stretch of a bead with the arc burning, cycle by cycle."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic, sleep
from typing import Final, NamedTuple, Protocol

import numpy as np

from tjscan.core.errors import WeldStopped
from tjscan.core.sourced import ABSENT_NUMBER, NumberSource, SourcedNumber, mean_of_numbers
from tjscan.planning.wps import WeldingProcedure
from tjscan.power.height import ArcHeight, ArcHeightSettings
from tjscan.power.sequence import ArcLimits, ArcPhase, ArcSequence
from tjscan.power.source import FEED_STEP, PowerSample, PowerSetting, PowerSource
from tjscan.recording.journal import Journal, RunEvent, event_recorder
from tjscan.runs.weld.journal import (
    ARC_BEGUN_EVENT,
    HEIGHT_EVENT,
    ArcMessage,
    ArcStretchMessage,
    name_of_bead,
)
from tjscan.welding.replan import NextBead

CYCLE_TIME: Final = 0.01
"""Seconds of a cycle."""

STRETCH_LENGTH: Final = 10e-3
"""Metres of an arc that make a row of the log."""

WEAKEST_SOURCES: Final = (
    NumberSource.ABSENT,
    NumberSource.BELIEVED,
    NumberSource.SET,
    NumberSource.SIMULATED,
    NumberSource.MEASURED,
)
"""Of the sources of numbers that make up another, the first says where that comes from."""

SETTLING_TIME: Final = 1.0
"""Seconds for which an arc that was stopped is watched until no current flows."""


class Clock(Protocol):
    """Seconds, and a wait for the next cycle."""

    @property
    def now(self) -> float:
        """Seconds."""

    def wait(self, seconds: float) -> None:
        """Let time go by."""


@dataclass(slots=True)
class SimulatedClock:
    """A clock that goes on as it is told."""

    now: float = 0.0

    def wait(self, seconds: float) -> None:
        """Let time go by at once."""
        self.now += seconds


class WallClock:
    """The clock of this machine, for a power source that is none of a simulation."""

    def __init__(self) -> None:
        self._due = monotonic()

    @property
    def now(self) -> float:
        """Seconds."""
        return monotonic()

    def wait(self, seconds: float) -> None:
        """Wait until the next cycle is due."""
        self._due = max(self._due + seconds, monotonic())
        sleep(self._due - min(self._due, monotonic()))


def left_to_weld(
    span: tuple[float, float], arcs: Sequence[ArcMessage], overlap: float
) -> tuple[float, float] | None:
    """What of a stretch of a bead is still to be welded, metres; None if nothing is.

    Parameters
    ----------
    span : tuple of float
        Begin and end of the stretch.
    arcs : sequence of ArcMessage
        Of that bead, in their order.
    overlap : float
        By which a further arc overlaps what is welded.
    """
    begin, end = span
    at = begin
    for arc in arcs:
        if arc.begin <= at + overlap and at < arc.end <= end + overlap:
            at = arc.end
    if at >= end:
        return None
    return (max(begin, at - overlap) if at > begin else begin), end


class _Moment(NamedTuple):
    """What was seen in a cycle in which the torch moved."""

    s: float
    speed: float
    feed: float
    raised: float
    sample: PowerSample


@dataclass(frozen=True, slots=True, eq=False)
class ArcWelder:
    """Welds stretches of beads with a power source and a torch that follows its orders exactly.

    Parameters
    ----------
    source : PowerSource
        Connected.
    limits : ArcLimits
    wps : WeldingProcedure
        Whose power counts where the source measures none.
    clock : Clock
    journal : Journal
    must_stop : callable
        Whether the operator asked for a stop.
    simulated : bool
        Whether no real metal melts.
    height : ArcHeightSettings, optional
        How the torch's height follows the current.
    raise_torch : callable, optional
        Leads the torch to a height over that of the plan, at a length along the groove; metres.
    station : str, optional
        Where the arm stands.
    """

    source: PowerSource
    limits: ArcLimits
    wps: WeldingProcedure
    clock: Clock
    journal: Journal
    must_stop: Callable[[], bool]
    simulated: bool
    height: ArcHeightSettings | None = None
    raise_torch: Callable[[float, float], None] = lambda s, raised: None
    station: str = ""

    def weld(
        self, bead: NextBead, begin: float, end: float
    ) -> tuple[ArcMessage, WeldStopped | None]:
        """Weld a stretch; returns what was welded, and what stopped it if anything did.

        Parameters
        ----------
        bead : NextBead
        begin, end : float
            Metres along the groove.
        """
        where = f"{name_of_bead(bead.number, self.station)}, from {1e3 * begin:.1f} mm on"
        self.journal.record(RunEvent(ARC_BEGUN_EVENT, where))
        arc = ArcSequence(self.source, self.limits, event_recorder(self.journal))
        seen, failure = list[_Moment](), None
        try:
            reached = self._lead(arc, bead, begin, end, seen)
        except BaseException as error:  # whatever it is: the arc goes out, and what it laid is kept
            failure, reached = error, seen[-1].s if seen else begin
            self._settle(arc)
        fault = "" if failure is None else str(failure) or type(failure).__name__
        message = self._message(bead, begin, reached, seen, fault)
        if failure is None or isinstance(failure, WeldStopped):
            self._record(message, seen)
            return message, failure
        with suppress(OSError):
            self._record(message, seen)
        raise failure

    def _record(self, message: ArcMessage, seen: list[_Moment]) -> None:
        self.journal.record(message)
        for row in self._stretches(message, seen):
            self.journal.record(row)

    def _lead(
        self, arc: ArcSequence, bead: NextBead, begin: float, end: float, seen: list[_Moment]
    ) -> float:
        """Go through the order of events; the torch is where its measured way has brought it."""
        s, speed = begin, 0.0
        height = None if self.height is None else ArcHeight(self.height)
        self.raise_torch(s, 0.0)
        setting = PowerSetting(float(np.interp(s, bead.s, bead.feed)))
        arc.begin(setting, speed)
        while arc.phase is not ArcPhase.DONE:
            self.clock.wait(CYCLE_TIME)
            if self.must_stop():
                arc.stop("by the operator")
            asked = float(np.interp(s, bead.s, bead.speed))
            arc.advance(speed, asked, at_end=s >= end)
            speed = asked if arc.may_move and s < end else 0.0
            s = min(s + speed * CYCLE_TIME, end)
            if arc.phase is ArcPhase.WELDING and speed and arc.sample is not None:
                raised = self._follow_current(height, bead, s, setting, arc.sample)
                seen.append(_Moment(s, speed, setting.feed, raised, arc.sample))
                feed = float(np.interp(s, bead.s, bead.feed))
                if abs(feed - setting.feed) >= FEED_STEP:
                    setting = PowerSetting(feed)
                    arc.set(setting)
        return s

    def _follow_current(
        self,
        height: ArcHeight | None,
        bead: NextBead,
        s: float,
        setting: PowerSetting,
        sample: PowerSample,
    ) -> float:
        """Lead the torch to the height that the current asks for; says once where it may not."""
        raised = 0.0 if height is None else height.raised
        if height is not None and sample.current.value is not None:
            before = height.at_bound
            raised = height.update(sample.time, setting.feed, sample.current.value)
            if height.at_bound and not before:
                asked = f"the current asks for more than {1e3 * raised:+.1f} mm over the plan"
                why = "the look has the surface elsewhere, or wire slips (3 % are 1.1 mm)"
                where = f"{name_of_bead(bead.number, self.station)} at {1e3 * s:.1f} mm"
                self.journal.record(RunEvent(HEIGHT_EVENT, f"{where}: {asked}: {why}"))
        self.raise_torch(s, raised)
        return raised

    def _settle(self, arc: ArcSequence) -> None:
        """Put an arc out, and watch it until no current flows; raises no error."""
        with suppress(Exception):
            if arc.phase is not ArcPhase.FAILED:
                arc.stop("the program failed")
        until = self.clock.now + SETTLING_TIME
        while self.clock.now < until:  # a dead link makes each cycle as long as its timeout
            self.clock.wait(CYCLE_TIME)
            try:
                arc.advance(0.0, 0.0)
            except Exception:
                self.source.quench()
            if arc.may_retract:
                return
        with suppress(OSError):
            event_recorder(self.journal)(
                "retract",
                "current flows or the wire sticks: free the torch by hand before it moves",
            )

    def _message(
        self, bead: NextBead, begin: float, reached: float, seen: list[_Moment], fault: str
    ) -> ArcMessage:
        s, speed, fed = np.array([one[:3] for one in seen]).reshape(-1, 3).T
        power = self.wps.arc.power_at(fed)
        for k, (*_, sample) in enumerate(seen):  # what was measured counts instead
            fed[k] = fed[k] if sample.feed.value is None else sample.feed.value
            if sample.current.value is not None and sample.voltage.value is not None:
                power[k] = sample.current.value * sample.voltage.value
        return ArcMessage(
            bead.number,
            begin,
            reached,
            seen[-1].sample.time - seen[0].sample.time if seen else 0.0,
            fault,
            self.simulated,
            s,
            speed,
            fed,
            self.wps.arc.thermal_efficiency * power / speed,
            self.station,
        )

    def _stretches(self, arc: ArcMessage, seen: list[_Moment]) -> Iterator[ArcStretchMessage]:
        """Rows of the log: what was measured of each stretch, and from where it comes."""
        if not len(arc.s):
            return
        row_of = ((arc.s - arc.begin) / STRETCH_LENGTH).astype(int)
        for row in np.unique(row_of):
            on = np.flatnonzero(row_of == row)
            samples = [seen[i].sample for i in on]
            current = [one.current for one in samples]
            mean = mean_of_numbers(current)
            voltage = mean_of_numbers([one.voltage for one in samples])
            fed = mean_of_numbers([one.feed for one in samples])
            if fed.value is None:
                fed = SourcedNumber(float(np.mean([seen[i].feed for i in on])), NumberSource.SET)
            moved = NumberSource.SIMULATED if self.simulated else NumberSource.MEASURED
            sources = {mean.source, voltage.source, moved}
            weakest = next(one for one in WEAKEST_SOURCES if one in sources)
            source = NumberSource.BELIEVED if weakest is NumberSource.ABSENT else weakest
            yield ArcStretchMessage(
                number=arc.number,
                begin=arc.begin + row * STRETCH_LENGTH,
                end=min(arc.begin + (row + 1) * STRETCH_LENGTH, arc.end),
                current=mean,
                current_least=mean_of_numbers(current, min),
                current_most=mean_of_numbers(current, max),
                voltage=voltage,
                feed=fed,
                gas=mean_of_numbers([one.gas for one in samples]),
                speed=SourcedNumber(float(arc.speed[on].mean()), moved),
                heat_input=SourcedNumber(float(arc.heat_input[on].mean()), source),
                station=self.station,
                raised=ABSENT_NUMBER
                if self.height is None
                else SourcedNumber(float(np.mean([seen[i].raised for i in on])), NumberSource.SET),
            )
