"""``overview.html``: all runs of a folder on one page, each with its verdict and its report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tjscan.core.errors import TjscanError
from tjscan.core.files import write_files_atomically
from tjscan.core.provenance import Provenance
from tjscan.report.clock import EventClock
from tjscan.report.findings import summary_headline
from tjscan.report.picture import load_template
from tjscan.report.write import REPORT_FILE
from tjscan.result.chapter import HeadlineNumber
from tjscan.result.directory import SUMMARY_FILE
from tjscan.result.summary import read_summary
from tjscan.runs.tasks import recorded_tasks, task_with_own_page

OVERVIEW_PAGE: Final = "overview.html"


@dataclass(frozen=True, slots=True)
class ListedRun:
    """A run of the overview.

    Parameters
    ----------
    name, task, began : str
        Of its directory; what it did; and when, empty if nothing tells it.
    headline : tuple of HeadlineNumber
        As its report has them.
    report : str
        Its address from the overview; empty without one.
    """

    name: str
    task: str
    began: str
    headline: tuple[HeadlineNumber, ...]
    report: str


def runs_in_folder(folder: Path) -> list[Path]:
    """Run directories in a folder; none if it is a run itself."""

    def is_run(directory: Path) -> bool:
        known = recorded_tasks(directory) or task_with_own_page(directory)
        return bool(known) or (directory / SUMMARY_FILE).is_file()

    if not folder.is_dir() or is_run(folder):
        return []
    return [one for one in sorted(folder.iterdir()) if one.is_dir() and is_run(one)]


def write_overview(folder: Path, runs: list[Path]) -> Path:
    """Write ``overview.html`` of the runs in a folder, and return it; their reports stay.

    Raises
    ------
    RecordingError
        If it can't be written.
    """
    page = load_template("overview.html.jinja").render(
        name=folder.resolve().name,
        runs=[_listed_run(run) for run in runs],
        provenance=Provenance.for_file_written_now("", "w").header_entries,
    )
    with write_files_atomically(folder) as draft:
        (draft / OVERVIEW_PAGE).write_text(page, encoding="utf-8")
    return folder / OVERVIEW_PAGE


def _listed_run(run: Path) -> ListedRun:
    task = task_with_own_page(run)
    try:
        headline = tuple(_headline_of(run))
    except TjscanError as error:  # the others are listed all the same
        headline = (HeadlineNumber("not finished", str(error), "bad"),)
    clock = EventClock.of_run(run, ())
    began = f"{clock.began:%Y-%m-%d %H:%M}" if clock.began.year > 1 else ""
    there = (run / REPORT_FILE).is_file()
    name = "scan" if task is None else task.name
    return ListedRun(run.name, name, began, headline, f"{run.name}/{REPORT_FILE}" * there)


def _headline_of(run: Path) -> Iterator[HeadlineNumber]:
    if (task := task_with_own_page(run)) is not None:
        yield from task.load("page")(run).headline
    else:
        yield from summary_headline(read_summary(run / SUMMARY_FILE))
