"""What a tow leaves behind: ``tow.csv``, a row a plan, and ``tow.json``, its figures."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.files import read_small_file, write_files_atomically
from tjscan.core.manifest import check_as_written
from tjscan.core.provenance import Provenance
from tjscan.job.tow.job import TowJob
from tjscan.recording.event import RecordedEvent
from tjscan.result.directory import job_label_of_run
from tjscan.runs.tow.figures import TowFigures, figures_of_tow
from tjscan.towing.journal import WELDED, TowCycle, TowTruth
from tjscan.towing.topics import read_tow

PLANS_FILE: Final = "tow.csv"
MOST_BYTES: Final = 10_000_000
"""A larger file holds no figures of a tow."""

FIGURES_FILE: Final = "tow.json"

PLAN_COLUMNS: Final = (
    "time_s",
    "along_mm",
    "pace",
    "bend",
    "obstacle",
    "change",
    "pace_term",
    "constraint",
    "bend_deg",
    "plan_ms",
    "asked_mm_s",
    "force_n",
    "wait",
)


@dataclass(frozen=True, slots=True)
class RecordedTow:
    """What a tow recorded, sorted.

    Parameters
    ----------
    cycles : tuple of TowCycle
    truths : tuple of TowTruth
        One for each cycle, or none.
    events : tuple of RecordedEvent
    """

    cycles: tuple[TowCycle, ...]
    truths: tuple[TowTruth, ...]
    events: tuple[RecordedEvent, ...]

    @property
    def complete(self) -> bool:
        """Whether the whole seam was welded."""
        return any(event.name == WELDED for event in self.events)

    def figures(self, job: TowJob) -> TowFigures | None:
        """Figures of the tow; None where not even one cycle was recorded."""
        if not self.cycles:
            return None
        return figures_of_tow(job, self.cycles, self.truths, complete=self.complete)


def read_recorded_tow(directory: Path) -> RecordedTow:
    """Read what a tow recorded, over all its parts; raises as `read_tow` does."""
    cycles: list[TowCycle] = []
    truths: list[TowTruth] = []
    events: list[RecordedEvent] = []
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
    head = Provenance.for_file_written_now(job_label_of_run(directory), "w")
    content = {
        "job": job_label_of_run(directory),
        "figures": None if figures is None else figures.as_numbers,
        "events": [[event.name, event.detail] for event in recorded.events],
    }
    with write_files_atomically(directory) as draft:
        (draft / PLANS_FILE).write_text(
            head.comment_lines("#") + _table(recorded), encoding="utf-8", newline=""
        )
        (draft / FIGURES_FILE).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def read_tow_figures(directory: Path) -> dict[str, Any]:
    """Figures of a run, by name; empty where nothing was towed.

    Raises
    ------
    ConfigurationError
        If the directory holds none.
    """
    file = directory / FIGURES_FILE
    check_as_written(file)
    try:
        content = json.loads(read_small_file(file, MOST_BYTES, "the figures of a tow"))
        figures = dict(content["figures"] or {})
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        raise ConfigurationError(
            f"can't be read: {error}. A tow's run directory holds it", file=file
        ) from None
    return figures


def _table(recorded: RecordedTow) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(PLAN_COLUMNS)
    for k, cycle in enumerate(recorded.cycles):
        terms = cycle.plan.terms
        force = np.nan
        if recorded.truths:
            force = float(np.hypot(*recorded.truths[k].welder_force[:2]))
        asked = 1e3 * np.hypot(cycle.asked[:-1, 0], cycle.asked[:-1, 2]).max(initial=0.0)
        writer.writerow(
            (
                f"{cycle.time:.3f}",
                f"{1e3 * cycle.along:.2f}",
                f"{cycle.pace:.3f}",
                f"{terms.bend:.5f}",
                f"{terms.obstacle:.5f}",
                f"{terms.change:.5f}",
                f"{terms.pace:.5f}",
                f"{cycle.plan.constraint:.2e}",
                f"{np.degrees(np.abs(cycle.plan.angles).max()):.3f}",
                f"{1e3 * cycle.seconds:.3f}",
                f"{asked:.2f}",
                "" if isnan(force) else f"{force:.2f}",
                cycle.wait,
            )
        )
    return stream.getvalue()
