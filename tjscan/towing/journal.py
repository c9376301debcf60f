"""What a tow reports while it runs, to whoever writes it down or shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from tjscan.core.frames import Array
from tjscan.towing.shape.plan import TowingPlan

WELDED: Final = "welded"
"""Name of the event that says that the whole seam was welded."""


@dataclass(frozen=True, slots=True, eq=False)
class TowCycle:
    """One cycle of the loop: what was measured, believed, planned and asked for.

    Parameters
    ----------
    time : float
        On the team's clock, seconds.
    along : float
        Where the welder is to be along the seam at the cycle's end, metres.
    pace : float
        Share of the welding speed at which it goes, 0 where it waits.
    seen : ndarray, shape (vehicles, 3)
        Poses as measured since the last cycle: x, y, metres, heading, radians; NaN where none came.
    poses : ndarray, shape (vehicles, 3)
        Poses as believed.
    sigmas : ndarray, shape (vehicles, 2)
        Standard deviations of position and heading, metres and radians.
    targets : ndarray, shape (vehicles, 3)
        Where the vehicles were sent to.
    asked : ndarray, shape (vehicles, 3)
        Twists asked for: speed, turn rate, sideways; m/s and rad/s.
    obstacles : ndarray, shape (obstacles, 5)
        x, y, radius, metres, and velocity along x and y, m/s.
    plan : TowingPlan
    seconds : float
        Of a processor that the plan took.
    host : float
        Seconds of a processor that the program took since the loop began.
    wait : str
        Why the welder waits, in a sentence; empty where it welds.
    stopped : tuple of int
        Vehicles that stand for good, by number from 0 at the root.
    """

    time: float
    along: float
    pace: float
    seen: Array
    poses: Array
    sigmas: Array
    targets: Array
    asked: Array
    obstacles: Array
    plan: TowingPlan
    seconds: float
    host: float
    wait: str = ""
    stopped: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class TowTruth:
    """What a simulation knows of cable and vehicles; no algorithm sees it.

    Parameters
    ----------
    time : float
        Seconds.
    line : ndarray, shape (N + 1, 2)
        Of the cable's links, from the root to the tip, metres.
    poses : ndarray, shape (vehicles, 3)
        Of the vehicles.
    welder_force : ndarray, shape (3,)
        Of the cable on the welder: newton along x and y, and N m.
    vehicle_forces : ndarray, shape (vehicles,)
        With which each vehicle pulls at the floor, newton.
    passers_by : ndarray, shape (obstacles, 3)
        x, y and radius of what moves, metres.
    touches : tuple of str
        What touched what since the last record, in words.
    """

    time: float
    line: Array
    poses: Array
    welder_force: Array
    vehicle_forces: Array
    passers_by: Array
    touches: tuple[str, ...] = ()


class TowJournal(Protocol):
    """Receives everything of a tow at once, in the order it happens."""

    def record_cycle(self, cycle: TowCycle) -> None:
        """Note a cycle."""
        ...

    def record_event(self, name: str, detail: str) -> None:
        """Note that something happened, in a word and in a sentence."""
        ...


class CombinedTowJournal:
    """Passes everything on to several journals, in their order.

    Parameters
    ----------
    journals : sequence of TowJournal
        The one that writes to disk comes first.
    """

    def __init__(self, journals: Sequence[TowJournal] = ()) -> None:
        self._journals = tuple(journals)

    def record_cycle(self, cycle: TowCycle) -> None:
        """Pass a cycle on."""
        for journal in self._journals:
            journal.record_cycle(cycle)

    def record_event(self, name: str, detail: str) -> None:
        """Pass an event on."""
        for journal in self._journals:
            journal.record_event(name, detail)
