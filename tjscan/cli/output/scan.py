"""What ``tjscan scan``, ``tjscan reprocess`` and ``tjscan stitch`` print."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from rich.progress import Progress

from tjscan.cli.output.console import print_fields, print_json, print_message, progress_bars
from tjscan.recording.journal import RunEvent
from tjscan.result import summary as results
from tjscan.runs.stations.stitch import StitchedRun
from tjscan.scanning.journal import ScanEvent
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import ProfileView, ScannedSection

SMALLEST_OUT_OF_ROUND_MM: Final = 0.05
"""Tubes less out of round than this are not reported."""


class ProgressJournal:
    """Journal that shows a scan's progress on the terminal: a bar from its first profile on.

    Parameters
    ----------
    progress : Progress
        The progress bars.
    title : str
        What the bar of this scan is called.
    total : int or None
        Sections to scan, where that is known.
    """

    def __init__(self, progress: Progress, title: str, total: int | None) -> None:
        self._progress = progress
        self._task = progress.add_task(title, total=total, visible=False)

    def record(self, message: object) -> None:
        """Move the bar on to a finished section, whether or not those before were scanned earlier.

        What happened is printed above the bar; the reason for the end follows with the summary.
        """
        match message:
            case ProfileView():  # not yet a section
                self._progress.update(self._task, visible=True)
            case ScannedSection():
                self._progress.update(self._task, completed=message.view.index + 1)
            case RunEvent(name, detail):
                if name in (ScanEvent.STOP, ScanEvent.COMPLETE):
                    self._progress.console.print("writing the results and the report …")
                if name not in (ScanEvent.STOP, ScanEvent.FAILED, ScanEvent.INTERRUPTED):
                    self._progress.console.print(f"{name}: {detail}", markup=False)


@contextmanager
def scan_progress_bar(title: str, plan: ScanPlan) -> Iterator[ProgressJournal]:
    """Show a scan's progress bar while the block runs; gives the journal that moves it on."""
    total = plan.sections
    if total is None and plan.length is not None:
        total = 2 + round(plan.length / plan.step)
    with progress_bars() as progress:
        yield ProgressJournal(progress, title, total)


def print_scan_summary(summary: results.ScanSummary, directory: Path, *, json: bool) -> None:
    """Print the summary of a finished scan: a table on stderr, or JSON on stdout."""
    if json:
        print(results.summary_to_json(summary))
        return
    print_fields(results.summary_in_words(summary))
    print_message(f"written to {directory}; see report.html, and sections.csv for the numbers")


def print_stitched_groove(done: StitchedRun, directory: Path, *, json: bool) -> None:
    """Print a stitched groove on stderr: stations, overlaps, totals; or JSON on stdout."""
    if json:
        print_json({"summary": done.summary, "stitching": done.report})
        return
    print_fields(_stitching_rows(done.summary, done.report))
    print_message(
        f"written to {directory}; see report.html, and stations.json for how it was stitched"
    )


def _stitching_rows(
    summary: results.ScanSummary, report: results.StitchingReport
) -> Iterator[tuple[str, str]]:
    first = report.stations[0]
    for one in report.stations:
        start, end = one.azimuth_deg
        off = (
            f"; seen from {first.name}, its base is {one.nominal_off_mm:.0f} mm and "
            f"{one.nominal_off_deg:.1f}° from where it was meant to"
        )
        yield (
            f"station {one.name}",
            f"{one.sections} sections from {start:.0f}° to {end:.0f}°, groove placed to "
            f"{one.sigma_groove_mm:.3f} mm{'' if one is first else off}",
        )
    for edge in report.overlaps:
        yield (
            f"overlap {' + '.join(edge.stations)}",
            f"{edge.arc_deg:.0f}° at {edge.azimuth_deg:.0f}°: residuals {edge.residual_rms_mm:.3f} "
            f"mm, gap {edge.gap_mm:.3f} mm",
        )
    before, after = report.loop_gap_before_mm, report.loop_gap_after_mm
    if before is not None and after is not None:
        yield "loop gap", f"{before:.3f} mm, closed {after:.3f} mm"
    else:
        yield "loop", results.LOOP_OPEN_TEXT
    yield "covered", f"{report.covered_deg:.0f}°, {summary.sections} sections"
    yield (
        "diameters",
        f"brace {report.brace_diameter_mm:.2f} ± {report.sigma_brace_diameter_mm:.2f} mm, "
        f"leg {report.leg_diameter_mm:.2f} ± {report.sigma_leg_diameter_mm:.2f} mm",
    )
    if report.out_of_round_mm > SMALLEST_OUT_OF_ROUND_MM:
        yield (
            "out of round",
            f"tubes bulge by some {report.out_of_round_mm:.2f} mm: frame j is that uncertain, the "
            "overlaps hold the stations together",
        )
    if (error := summary.corner_error_mm) is not None:
        yield "corner error", f"{error.mean:.3f} mm mean, {error.p95:.3f} p95, {error.max:.3f} max"
    yield from results.uncertainty_lines(summary)
