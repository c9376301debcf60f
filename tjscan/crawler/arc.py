"""The arc of a crawl by a power source: struck and ended at rest, and guarded in every cycle."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Final

from tjscan.core.bead_segments import BeadSegments
from tjscan.crawler.control_cycle import ControlCycle
from tjscan.crawler.journal import ArcReading
from tjscan.crawler.torch_axes import TorchAxes
from tjscan.power.height import ArcHeight, ArcHeightSettings
from tjscan.power.sequence import ArcLimits, ArcPhase, ArcSequence
from tjscan.power.source import FEED_STEP, PowerSetting, PowerSource
from tjscan.recording.journal import Journal, RunEvent
from tjscan.vehicle.vehicle import AT_REST

ARC_EVENT: Final = "arc"
"""Name of the events of a power source's arc: its phases have names of phases of a crawl."""

CYCLES_PER_READING: Final = 10
"""Cycles of an arc of which one's readings are recorded."""


@dataclass(slots=True)
class CrawlArc:
    """The arc of one pass after another.

    Parameters
    ----------
    cycle : ControlCycle
    torch : TorchAxes
        Whose enable lets current flow.
    source : PowerSource or None
        Connected; without, the torch has an arc of its own, which burns as soon as it is let.
    limits : ArcLimits
    journal : Journal
    height : ArcHeightSettings, optional
        How the torch's height follows the current.
    """

    cycle: ControlCycle
    torch: TorchAxes
    source: PowerSource | None
    limits: ArcLimits
    journal: Journal
    height: ArcHeightSettings | None = None
    _sequence: ArcSequence | None = None
    _feed: float = 0.0
    _follower: ArcHeight | None = None
    _readings: int = 0

    def strike(self, here: BeadSegments) -> None:
        """Strike it above the bead's begin; with a source the vehicle rests meanwhile.

        Raises
        ------
        WeldStopped
            If a guard of the order of events puts it out.
        """
        if self.source is not None:
            path, height, self._feed = (float(x) for x in (here.offset, here.height, here.feed))
            self.cycle.come_to_rest(path, height)
            sequence = ArcSequence(self.source, self.limits, self._report)
            sequence.begin(PowerSetting(self._feed), self.cycle.speed)
            self.cycle.set_arc(burning=True)
            self._rest_until(sequence, lambda: sequence.may_move, path, height)
            self._sequence = sequence
            self._follower = None if self.height is None else ArcHeight(self.height)
            return
        self.cycle.set_arc(burning=True)

    def advance(self, here: BeadSegments) -> float:
        """Go on by a cycle; returns by how much the torch is to be over the plan, metres.

        Raises
        ------
        WeldStopped
            As `strike` does.
        """
        sequence = self._sequence
        if sequence is None:
            return 0.0
        sequence.advance(self.cycle.speed, float(here.speed))
        if abs(float(here.feed) - self._feed) >= FEED_STEP:
            self._feed = float(here.feed)
            sequence.set(PowerSetting(self._feed))
        sample, raised = sequence.sample, 0.0
        if sample is None or sequence.phase is not ArcPhase.WELDING:
            return raised
        if self._follower is not None and sample.current.value is not None:
            raised = self._follower.update(sample.time, self._feed, sample.current.value)
        self._readings += 1
        if self._readings % CYCLES_PER_READING == 0:
            numbers = sample.current, sample.voltage, sample.feed, sample.gas
            at = self.cycle.number, self.cycle.travel, raised
            self.journal.record(ArcReading(*at, *numbers))
        return raised

    def end(self, here: BeadSegments) -> None:
        """Fill the crater and end it, at rest; raises as `strike` does."""
        if (sequence := self._sequence) is not None:
            path, height = float(here.offset), float(here.height)
            if sequence.phase is not ArcPhase.WELDING:
                sequence.stop("the pass ended before the torch moved")
            sequence.advance(self.cycle.speed, 0.0, at_end=True)
            self._rest_until(sequence, lambda: sequence.phase is ArcPhase.AFTER_GAS, path, height)
            self.cycle.set_arc(burning=False)
            self._rest_until(sequence, lambda: sequence.phase is ArcPhase.DONE, path, height)
            self._sequence = None
            return
        self.cycle.set_arc(burning=False)

    def put_out(self) -> None:
        """Put it out at once, whatever is the matter."""
        with ExitStack() as stack:  # each is done, whatever the others raise
            stack.callback(self.torch.set_arc, burning=False)
            if self.source is not None:
                stack.callback(self.source.quench)
        self._sequence = None

    def _report(self, phase: str, detail: str) -> None:
        self.journal.record(RunEvent(ARC_EVENT, f"{phase}: {detail}"))

    def _rest_until(
        self, sequence: ArcSequence, done: Callable[[], bool], path: float, height: float
    ) -> None:
        while not done():
            self.cycle.run(AT_REST, path, height)
            sequence.advance(self.cycle.speed, 0.0)
