"""What the commands say: progress and words on stderr, results on stdout."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table

from tjscan.result.readings import Reading, measures
from tjscan.result.summary import Summary, to_json
from tjscan.scanning.events import ScanEvent
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import ScannedSection, View

stderr = Console(stderr=True, highlight=False)


def say(message: str) -> None:
    """Tell the user something."""
    stderr.print(message, markup=False)


class ProgressJournal:
    """Shows a scan as it goes.

    Parameters
    ----------
    progress : Progress
        The display.
    task : TaskID
        The bar in it.
    """

    def __init__(self, progress: Progress, task: TaskID) -> None:
        self._progress, self._task = progress, task

    def view(self, view: View) -> None:
        """Show nothing: a profile is not yet a section."""

    def section(self, scan: ScannedSection) -> None:
        """Move the bar on."""
        self._progress.advance(self._task)

    def event(self, name: str, detail: str) -> None:
        """Print what happened above the bar; how the scan ended is told at its end."""
        if name not in (ScanEvent.STOP, ScanEvent.FAILED, ScanEvent.INTERRUPTED):
            self._progress.console.print(f"{name}: {detail}", markup=False)


@contextmanager
def watching(plan: ScanPlan, title: str = "sections") -> Iterator[ProgressJournal]:
    """Give a journal that shows a progress bar while the block runs."""
    total = plan.sections
    if total is None and plan.length is not None:
        total = 2 + round(plan.length / plan.step)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=stderr) as progress:
        yield ProgressJournal(progress, progress.add_task(title, total=total))


def report(summary: Summary, directory: Path, *, json: bool) -> None:
    """Print a finished scan: a table for people, or JSON on stdout."""
    if json:
        print(to_json(summary))
        return
    table = Table(show_header=False, box=None, pad_edge=False)
    for name, value in _lines(summary):
        table.add_row(name, value)
    stderr.print(table)
    say(f"written to {directory}: report.html tells all of it, sections.csv holds the numbers")


def show_readings(readings: Sequence[Reading]) -> None:
    """Print a line per profile on stdout: measures with standard deviations, then the corners."""
    for reading in readings:
        if reading.refusal is not None:
            print(f"{reading.name}: {reading.refusal}")
            continue
        told = [] if reading.section is None else measures(reading.section)
        words = [f"{name} {value:.3f} ± {sigma:.3f}" for name, value, sigma in told]
        corners = "  ".join(f"({x:.3f}, {z:.3f})" for x, _, z in 1e3 * reading.points_s)
        print(f"{reading.name}: {', '.join([*words, f'x, z in mm {corners}'])}")


def _lines(summary: Summary) -> Iterator[tuple[str, str]]:
    step, error = summary.step_mm, summary.corner_error_mm
    yield "stopped because", summary.detail
    yield "sections", f"{summary.sections} from {summary.scans} profiles"
    yield "groove length", f"{summary.groove_length_mm:.1f} mm"
    if step.mean is not None:
        spread = "" if step.std is None else f" ± {step.std:.2f}"
        yield "step", f"{step.mean:.2f}{spread} mm, {step.nominal:g} mm asked"
    yield "flange", f"{summary.flange_travel_mm:.0f} mm, {summary.flange_rotation_deg:.0f}°"
    yield "motion time", f"{summary.motion_time_s:.1f} s"
    if error is not None:
        yield "corner error", f"{error.mean:.3f} mm mean, {error.p95:.3f} p95, {error.max:.3f} max"
