"""Arcs that fail at a drawn state, over the loopback power source, and are gone on with."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from _arc import LIMITS, loopback_power_source

from tjscan.core.errors import PowerFault
from tjscan.planning.wps import read_wps
from tjscan.power.modbus.registers import ModbusPowerSettings
from tjscan.power.modbus.source import ModbusPowerSource
from tjscan.power.sequence import ArcFault, ArcPhase
from tjscan.recording.journal import RunEvent
from tjscan.runs.weld.arc import ArcWelder, WallClock, left_to_weld
from tjscan.runs.weld.journal import ArcMessage
from tjscan.welding.replan import NextBead
from tjscan_loopback.process import PowerLoopbackProcess

WPS: Final = Path(__file__).parents[1] / "examples" / "wps.toml"
LENGTH: Final = 6e-3
SPEED: Final = 10e-3
OVERLAP: Final = 2e-3
PATIENCE: Final = 1.0
"""Seconds for a link that was dead to answer again, on a busy machine."""

MOST_ARCS: Final = 4
"""Arcs for a stretch; the first has the fault, and a second one ends it."""

SOURCES, FIRST_HOST = 4, 10
"""Sources at the same time, and the last number of the first one's address."""

STATES: Final = tuple(
    one for one in ArcPhase if one not in (ArcPhase.IDLE, ArcPhase.DONE, ArcPhase.FAILED)
)


class OrderedFault(StrEnum):
    """What goes wrong."""

    NO_IGNITION = "no-ignition"
    ARC_LOST = "arc-lost"
    WIRE_STUCK = "wire-stuck"
    NO_GAS = "no-gas"
    ERROR = "error"
    LINK_DEAD = "link-dead"
    FROZEN = "register-frozen"
    STOP = "stop"
    JOURNAL = "journal"
    """The recording can't be written, once."""


@dataclass(slots=True)
class FaultJournal:
    """Lets something go wrong once an arc is in a state, after some cycles more.

    Parameters
    ----------
    process : PowerLoopbackProcess
    state : ArcPhase
    fault : OrderedFault
    wait : int
        Cycles from the state on.
    """

    process: PowerLoopbackProcess
    state: ArcPhase
    fault: OrderedFault
    wait: int
    reached: bool = False
    stopped: bool = False
    done: bool = False

    def record(self, message: object) -> None:
        """Take in a message of the weld."""
        self.reached |= isinstance(message, RunEvent) and message.name == self.state
        if self.reached and self.fault is OrderedFault.JOURNAL and not self.done:
            self.done = True
            raise OSError("no space left")

    def must_stop(self) -> bool:
        """Count a cycle; whether the operator asks for a stop."""
        self.wait -= self.reached
        if self.reached and self.wait < 0 and not self.done:
            self.done = True
            if self.fault is OrderedFault.STOP:
                self.stopped = True
            elif self.fault is not OrderedFault.JOURNAL:
                self.process.write_line(self.fault)
        return self.stopped


@dataclass(frozen=True, slots=True)
class FaultOutcome:
    """What became of a stretch.

    Parameters
    ----------
    what : str
        State and fault.
    ended : bool
        Whether it ended an arc: gas that is missing once the arc is out does not.
    named : bool
        Each arc that did not end as it should says why, by a fault of `ArcFault` or an error's
        own words.
    off : bool
        No current flowed after the first arc.
    whole : bool
        The stretch was welded in the end.
    twice : float
        Length that was welded twice beyond one overlap for each further arc, metres.
    """

    what: str
    ended: bool
    named: bool
    off: bool
    whole: bool
    twice: float


def draw_faults(settings: ModbusPowerSettings, count: int, seed: int) -> list[FaultOutcome]:
    """Weld stretches, with a fault in each; every state comes equally often.

    They are waits for the most part, so a few sources are welded with at the same time.
    """
    rng, drawn = np.random.default_rng(seed), list[tuple[ArcPhase, OrderedFault, int]]()
    for k in range(count):
        fault = OrderedFault(rng.choice(list(OrderedFault)))
        drawn.append((STATES[k % len(STATES)], fault, int(rng.integers(0, 12))))
    with ProcessPoolExecutor(SOURCES) as pool:
        parts = [drawn[k::SOURCES] for k in range(SOURCES)]
        found = pool.map(partial(_weld_with_faults, settings), range(SOURCES), parts)
        return [one for part in found for one in part]


def _weld_with_faults(
    settings: ModbusPowerSettings, number: int, drawn: list[tuple[ArcPhase, OrderedFault, int]]
) -> list[FaultOutcome]:
    """Weld one stretch after the other with one source."""
    with loopback_power_source(settings, f"127.0.0.{FIRST_HOST + number}") as (process, reached):
        return [weld_with_fault(process, reached, *one) for one in drawn]


def weld_with_fault(
    process: PowerLoopbackProcess,
    settings: ModbusPowerSettings,
    state: ArcPhase,
    fault: OrderedFault,
    wait: int,
) -> FaultOutcome:
    """Weld a stretch with a fault, and go on until it is whole."""
    s = np.array((0.0, LENGTH))
    one, none, pair = np.ones(2), np.zeros(2), np.zeros((2, 2))
    feed = 9 / 60 * one
    bead = NextBead(0, 0, s, pair, pair, one, one, SPEED * one, feed, none, one, none)
    arcs, named, off = list[ArcMessage](), True, True
    journal = FaultJournal(process, state, fault, wait)
    for _ in range(MOST_ARCS):
        left = left_to_weld((0.0, LENGTH), arcs, OVERLAP)
        if left is None:
            break
        process.schedule_fault("clear")
        process.unread_output()
        caught = _Caught()
        with suppress(PowerFault), ModbusPowerSource(settings) as source:
            source.reset()
            welder = ArcWelder(
                source, LIMITS, read_wps(WPS), WallClock(), caught, journal.must_stop, True
            )
            caught.journal = journal
            try:
                _, stopped = welder.weld(bead, *left)
                named &= stopped is None or stopped.fault in set(ArcFault)
            except OSError as error:
                named &= "no space" in str(error)
        arcs += caught.arcs
        journal.stopped = False
        process.schedule_fault("clear")
        with ModbusPowerSource(replace(settings, timeout=PATIENCE)) as source:
            off &= not source.state().flow
    welded = sum(arc.end - arc.begin for arc in arcs)
    begun = sum(arc.end > arc.begin for arc in arcs)
    whole = left_to_weld((0.0, LENGTH), arcs, OVERLAP) is None
    twice = max(welded - LENGTH - OVERLAP * (begun - 1), 0.0)
    return FaultOutcome(
        f"{fault} in {state}", any(arc.fault for arc in arcs), named, off, whole, twice
    )


class _Caught:
    """Hands messages on, and keeps the arcs that were written."""

    def __init__(self) -> None:
        self.journal: FaultJournal | None = None
        self.arcs = list[ArcMessage]()

    def record(self, message: object) -> None:
        if self.journal is not None:
            self.journal.record(message)
        if isinstance(message, ArcMessage):
            self.arcs.append(message)
