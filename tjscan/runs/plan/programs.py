"""Part a plan among the stations of a run by what they reach, and write a program for each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError, PoseUnreachable
from tjscan.core.units import MM
from tjscan.groove.measured import MeasuredSection
from tjscan.planning.document import LengthEntry, StationEntry
from tjscan.planning.plan import WeldPlan
from tjscan.planning.stops import StationStretch
from tjscan.planning.urscript import StationWay
from tjscan.runs.plan.reach import StationReach, find_station_reach, groove_surface
from tjscan.runs.plan.welding_station import ARM, WeldingStation

Replan = Callable[[tuple[StationStretch, ...]], WeldPlan]


@dataclass(frozen=True, slots=True, eq=False)
class PartedPlan:
    """A plan parted among stations, and how each leads the torch.

    Parameters
    ----------
    plan : WeldPlan
        Its beads, in parts.
    stations : tuple of StationEntry
        As they stand in ``plan.json``.
    ways : dict of str to StationWay
        Of each station that has a program, by the program's file.
    """

    plan: WeldPlan
    stations: tuple[StationEntry, ...]
    ways: dict[str, StationWay]


def part_plan(
    arms: Sequence[WeldingStation],
    plan: WeldPlan,
    sections: Sequence[MeasuredSection],
    replan: Replan,
) -> PartedPlan:
    """Part a plan among the stations from which a run was scanned.

    Parameters
    ----------
    arms : sequence of WeldingStation
        In the order in which they weld.
    plan : WeldPlan
        Its beads whole.
    sections : sequence of MeasuredSection
        Along the groove.
    replan : callable
        Makes the same plan anew, parted among stretches.

    Raises
    ------
    ConfigurationError
        If the torch reaches nothing, or an arm is not of the Universal Robots type.
    """
    groove = groove_surface(plan.edges, np.array([section.points for section in sections]))
    reaches = []
    for arm in arms:
        with add_file_to_errors(arm.job_file):
            reaches.append(find_station_reach(arm, plan, groove))
    stretches = tuple(stretch for reach in reaches if (stretch := reach.stretch) is not None)
    if not stretches:
        raise ConfigurationError(
            "no station reaches any of the groove with this torch: "
            + "; ".join(f"{reach.station.name}: {_mostly(reach)}" for reach in reaches),
            key="torch",
        )
    parted, ways, entries = replan(stretches), dict[str, StationWay](), []
    for reach in reaches:
        name, problem, file = reach.station.name, "", ""
        if any(bead.station == name for bead in parted.beads):
            file = program_name(name)
            try:
                ways[file] = reach.lead_torch(parted)
            except PoseUnreachable as error:
                file, problem = "", error.reason
        entries.append(_entry(reach, file, problem))
    return PartedPlan(parted, tuple(entries), ways)


def program_name(station: str) -> str:
    """Name of the file that holds a station's program."""
    return "plan.urscript" if station == ARM else f"plan-{station}.urscript"


def _entry(reach: StationReach, file: str, problem: str) -> StationEntry:
    stretch = reach.stretch
    return StationEntry(
        name=reach.station.name,
        reached_mm=None if stretch is None else (_mm(stretch.begin), _mm(stretch.end)),
        unreached=tuple(
            LengthEntry(begin_mm=_mm(one.begin), end_mm=_mm(one.end), reason=one.reason)
            for one in reach.unreached
        ),
        program=file,
        without_program=problem,
    )


def _mostly(reach: StationReach) -> str:
    return Counter(reason for reason in reach.holds.hindrances).most_common(1)[0][0]


def _mm(value: float) -> float:
    return round(value / MM.factor, 1)
