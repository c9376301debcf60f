"""What the live page shows of a weld's recording: its surface, its beads, look by look."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from tjscan.live.step import Measure, PlaneCurve, Sample, SceneSetup, Step
from tjscan.recording.journal import RunEvent
from tjscan.runs.weld.journal import (
    ArcMessage,
    ArcStretchMessage,
    LookMessage,
    PlannedBeadMessage,
    name_of_bead,
    read_weld,
)
from tjscan.runs.weld.results import SIMULATED_WELD_NOTE

CURRENT_MEASURE: Final = Measure("current", "A")
SPEED_MEASURE: Final = Measure("travel speed", "mm/min")
BEAD_TABLE_HEAD: Final = ("bead", "layer", "welded / mm", "arc / s")


class WeldShow:
    """Turns what a weld's journal receives into steps of the page.

    Parameters
    ----------
    title : str
        Of the run.
    """

    def __init__(self, title: str) -> None:
        self.setting = SceneSetup(title, (CURRENT_MEASURE, SPEED_MEASURE), "along the groove / mm")
        self._layers: dict[str, int] = {}
        self._welded: dict[str, tuple[float, float]] = {}

    def step_of_entry(self, entry: object) -> Step:
        """What an entry changes: nothing if it is of an unknown type."""
        match entry:
            case PlannedBeadMessage():
                self._layers[entry.name] = entry.layer
                return Step(entry.name, facts={"weld": SIMULATED_WELD_NOTE})
            case ArcStretchMessage():
                pairs = ((CURRENT_MEASURE, entry.current, 1.0), (SPEED_MEASURE, entry.speed, 60e3))
                values = {m.name: k * one.value for m, one, k in pairs if one.value is not None}
                return Step(samples=(Sample(1e3 * entry.begin, values),))
            case ArcMessage():
                name = name_of_bead(entry.number, entry.station)
                length, time = self._welded.get(name, (0.0, 0.0))
                self._welded[name] = length + entry.end - entry.begin, time + entry.seconds
                return Step(f"{name} welded", table=self._table())
            case LookMessage():
                middle = entry.seen.w[len(entry.seen.w) // 2]
                facts = {"look": f"{entry.name}, {100 * entry.read.mean():.0f} % read"}
                curve = PlaneCurve(1e3 * entry.u, 1e3 * middle)
                return Step(f"look {entry.name}", facts=facts, profile=curve)
            case RunEvent():
                return Step(events=((entry.name, entry.detail),))
        return Step()

    def _table(self) -> list[tuple[str, ...]]:
        rows = [
            (
                name.removeprefix("bead "),
                str(self._layers.get(name, 0) + 1),
                f"{1e3 * length:.0f}",
                f"{time:.0f}",
            )
            for name, (length, time) in self._welded.items()
        ]
        return [BEAD_TABLE_HEAD, *rows]


def read_weld_show(directory: Path) -> tuple[WeldShow, Iterable[object]]:
    """Read what a weld's recording has to show; see `tjscan.live.step.ReplayReader`."""
    return WeldShow(directory.resolve().name), read_weld(directory)
