"""Write a run's report."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tjscan.comparison.sidecar import StatedUnitAndFrame
from tjscan.core.files import write_files_atomically
from tjscan.core.provenance import Provenance
from tjscan.core.registry import TASKS, TaskPlugin
from tjscan.report.chapter_page import draw_sheet_picture, render_chapter_page
from tjscan.report.data import read_report_data
from tjscan.report.page import render_report_page
from tjscan.result.chapter import ChapterWriter, ReportSheet
from tjscan.result.directory import JOB, job_label_of_run
from tjscan.result.picture import write_png

REPORT: Final = "report.html"


def write_run_report(
    directory: Path,
    reference: Path | None = None,
    tolerance: float | None = None,
    options: StatedUnitAndFrame | None = None,
) -> Path:
    """Write ``report.html`` into a run directory, with the picture of a sheet, and return it.

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
    sheet: ReportSheet | None = None
    if (task := task_with_own_page(directory)) is not None:
        write_chapter: ChapterWriter = task.load_part("page" if task.page else "report")
        chapter = write_chapter(directory)
        sheet = chapter.sheet
        page = render_chapter_page(chapter, task.name.capitalize(), directory)
    else:
        page = render_report_page(read_report_data(directory, reference, tolerance, options))
    with write_files_atomically(directory) as draft:
        (draft / REPORT).write_text(page, encoding="utf-8")
        if sheet is not None:
            head = Provenance.for_file_written_now(job_label_of_run(directory), sheet.frame)
            write_png(draft / sheet.picture, draw_sheet_picture(chapter), head)
    return directory / REPORT


def task_with_own_page(directory: Path) -> TaskPlugin | None:
    """The task that made a run and has a page of its own for it; None where it is a scan's."""
    tasks = [TASKS.load(name) for name in TASKS.names]
    left = [(task, task.recording) for task in tasks]
    if not (directory / JOB).is_file():  # a run of a job keeps copies of what others found
        left += [(task, task.result) for task in tasks]
    return next((task for task, name in left if name and (directory / name).is_file()), None)
