"""What a tow leaves behind: ``tow.csv``, a row a plan, and ``tow.json``, its figures."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.core.files import write_files_atomically
from tjscan.job.tow.job import TowJob
from tjscan.recording.journal import RunEvent
from tjscan.result.directory import job_label_of_run
from tjscan.runs.run import read_result_file, table_to_csv
from tjscan.runs.tow.figures import TowFigures, figures_of_tow
from tjscan.towing.journal import WELDED_EVENT, TowCycle, TowTruth, read_tow

PLANS_FILE: Final = "tow.csv"
FIGURES_FILE: Final = "tow.json"

PlannedCycle = tuple[TowCycle, TowTruth | None]

PLAN_COLUMNS: Final[dict[str, Callable[[PlannedCycle], str]]] = {
    "time_s": lambda row: f"{row[0].time:.3f}",
    "along_mm": lambda row: f"{1e3 * row[0].along:.2f}",
    "pace": lambda row: f"{row[0].pace:.3f}",
    "bend": lambda row: f"{row[0].plan.terms.bend:.5f}",
    "obstacle": lambda row: f"{row[0].plan.terms.obstacle:.5f}",
    "change": lambda row: f"{row[0].plan.terms.change:.5f}",
    "pace_term": lambda row: f"{row[0].plan.terms.pace:.5f}",
    "constraint": lambda row: f"{row[0].plan.constraint:.2e}",
    "bend_deg": lambda row: f"{np.degrees(np.abs(row[0].plan.angles).max()):.3f}",
    "plan_ms": lambda row: f"{1e3 * row[0].seconds:.3f}",
    "asked_mm_s": lambda row: f"{fastest_asked(row[0]):.2f}",
    "force_n": lambda row: "" if row[1] is None else f"{np.hypot(*row[1].welder_force[:2]):.2f}",
    "wait": lambda row: row[0].wait,
}
"""Columns of ``tow.csv``, and their cells of a cycle and of what a simulation knows then."""


def fastest_asked(cycle: TowCycle) -> float:
    """Fastest speed that was asked of a towing vehicle in a cycle, mm/s."""
    asked = cycle.asked[:-1]
    return float(1e3 * np.hypot(asked[:, 0], asked[:, 2]).max(initial=0.0))


@dataclass(frozen=True, slots=True)
class RecordedTow:
    """What a tow recorded, sorted.

    Parameters
    ----------
    cycles : tuple of TowCycle
    truths : tuple of TowTruth
        One for each cycle, or none.
    events : tuple of RunEvent
    """

    cycles: tuple[TowCycle, ...]
    truths: tuple[TowTruth, ...]
    events: tuple[RunEvent, ...]

    @property
    def complete(self) -> bool:
        """Whether the whole seam was welded."""
        return any(event.name == WELDED_EVENT for event in self.events)

    def figures(self, job: TowJob) -> TowFigures | None:
        """Figures of the tow; None where not even one cycle was recorded."""
        if not self.cycles:
            return None
        return figures_of_tow(job, self.cycles, self.truths, complete=self.complete)


def read_recorded_tow(directory: Path) -> RecordedTow:
    """Read what a tow recorded, over all its parts; raises as `read_tow` does."""
    cycles: list[TowCycle] = []
    truths: list[TowTruth] = []
    events: list[RunEvent] = []
    for entry in read_tow(directory):
        if isinstance(entry, TowCycle):
            cycles.append(entry)
        elif isinstance(entry, TowTruth):
            truths.append(entry)
        else:
            events.append(entry)
    known = tuple(truths) if len(truths) == len(cycles) else ()
    return RecordedTow(tuple(cycles), known, tuple(events))


def write_tow_results(directory: Path, job: TowJob) -> None:
    """Write the results of a tow from its recording, whole or cut off.

    Raises
    ------
    RecordingError
        If a file can't be written, or the recording is damaged.
    """
    recorded = read_recorded_tow(directory)
    figures = recorded.figures(job)
    truths = recorded.truths or [None] * len(recorded.cycles)
    rows = zip(recorded.cycles, truths, strict=True)
    table = table_to_csv(directory, PLAN_COLUMNS, rows)
    content = {
        "job": job_label_of_run(directory),
        "figures": None if figures is None else figures.as_numbers,
        "events": [[event.name, event.detail] for event in recorded.events],
    }
    with write_files_atomically(directory) as draft:
        (draft / PLANS_FILE).write_text(table, encoding="utf-8", newline="")
        (draft / FIGURES_FILE).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def read_tow_figures(directory: Path) -> dict[str, Any]:
    """Figures of a run, by name; empty where nothing was towed.

    Raises
    ------
    ConfigurationError
        If the directory holds none.
    """
    return read_result_file(
        directory / FIGURES_FILE,
        "the figures of a tow",
        lambda text: dict(json.loads(text)["figures"] or {}),
    )
