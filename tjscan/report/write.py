"""Write a run's report."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tjscan.comparison.sidecar import StatedUnitAndFrame
from tjscan.core.files import write_files_atomically
from tjscan.core.registry import TASKS, TaskPlugin
from tjscan.report.chapter_page import render_chapter_page
from tjscan.report.data import read_report_data
from tjscan.report.page import render_report_page
from tjscan.result.chapter import ChapterWriter

REPORT: Final = "report.html"


def write_run_report(
    directory: Path,
    reference: Path | None = None,
    tolerance: float | None = None,
    options: StatedUnitAndFrame | None = None,
) -> Path:
    """Write ``report.html`` into a run directory, and return it.

    Parameters
    ----------
    directory : Path
        A finished run, of one scan or stitched.
    reference : Path, optional
        What to compare it with, in place of the joint that the run names.
    tolerance : float, optional
        Of that comparison, metres.
    options : StatedUnitAndFrame, optional
        Unit and frame of a reference that does not state them.

    Raises
    ------
    ConfigurationError
        If there is no finished run, or the reference can't be read or compared with.
    ComparisonRefused
        If the reference does not fit.
    RecordingError
        If a recording is damaged, or the report can't be written.
    """
    if (task := task_with_own_page(directory)) is not None:
        write_chapter: ChapterWriter = task.load_part("report")
        page = render_chapter_page(write_chapter(directory), task.name.capitalize(), directory)
    else:
        page = render_report_page(read_report_data(directory, reference, tolerance, options))
    with write_files_atomically(directory) as draft:
        (draft / REPORT).write_text(page, encoding="utf-8")
    return directory / REPORT


def task_with_own_page(directory: Path) -> TaskPlugin | None:
    """The task that made a run and has a page of its own for it; None where it is a scan's."""
    tasks = map(TASKS.load, TASKS.names)
    return next((t for t in tasks if t.recording and (directory / t.recording).is_file()), None)
