"""What ``tjscan scan`` and ``tjscan reprocess`` print."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.progress import Progress

from tjscan.cli.output.console import print_fields, print_message, progress_bars
from tjscan.recording.journal import RunEvent
from tjscan.result.summary import ScanSummary, summary_in_words, summary_to_json
from tjscan.scanning.events import ScanEvent
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import ProfileView, ScannedSection


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
def scan_progress_bar(plan: ScanPlan, title: str = "sections") -> Iterator[ProgressJournal]:
    """Show a scan's progress bar while the block runs; gives the journal that moves it on."""
    total = plan.sections
    if total is None and plan.length is not None:
        total = 2 + round(plan.length / plan.step)
    with progress_bars() as progress:
        yield ProgressJournal(progress, title, total)


def print_scan_summary(summary: ScanSummary, directory: Path, *, json: bool) -> None:
    """Print the summary of a finished scan: a table on stderr, or JSON on stdout."""
    if json:
        print(summary_to_json(summary))
        return
    print_fields(summary_in_words(summary))
    print_message(f"written to {directory}; see report.html, and sections.csv for the numbers")
