"""The tasks: the one place where the algorithms meet, and what each brings to pages and studies.

The parts of a kind are imported together when one of them is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.live.step import RecordedShow, ShowReader
from tjscan.recording.parts import recording_files
from tjscan.result.chapter import ChapterWriter
from tjscan.result.directory import JOB_FILE
from tjscan.study.trial import StudyBackend

LIVE_PAGE_RECORDINGS: Final = ("measured", "crawl", "scan", "tow")
"""What the names of the recordings begin with that the live page shows."""


@dataclass(frozen=True, slots=True)
class Task:
    """A task by the files of its runs.

    Parameters
    ----------
    name : str
        Of the task.
    recording : str, optional
        Its recording, if the report of a run that has one is a page of its own.
    result : str, optional
        A file by which a directory without job and recording is known to hold its result.
    """

    name: str
    recording: str = ""
    result: str = ""


ALL_TASKS: Final = (
    Task("calibrate", recording="measured.mcap", result="calibration.toml"),
    Task("crawl", recording="crawl.mcap"),
    Task("scan"),
    Task("tow", recording="tow.mcap"),
)


def report_chapters() -> Mapping[str, ChapterWriter]:
    """What makes the chapter of each task in the report on a run."""
    from tjscan.runs.calibration.report import calibration_chapter
    from tjscan.runs.crawl.report import crawl_chapter
    from tjscan.runs.scan.report import scan_chapter
    from tjscan.runs.tow.report import tow_chapter

    chapters = (calibration_chapter, crawl_chapter, scan_chapter, tow_chapter)
    return dict(zip((task.name for task in ALL_TASKS), chapters, strict=True))


def page_of_task(task: Task) -> ChapterWriter:
    """What makes the page of a run that has one of its own: of most tasks it is their chapter."""
    if task.name == "calibrate":
        from tjscan.runs.calibration.report import calibration_page

        return calibration_page
    return report_chapters()[task.name]


def task_with_own_page(directory: Path) -> Task | None:
    """The task that made a run and has a page of its own for it; None if it is a scan's."""
    files = [(task, task.recording) for task in ALL_TASKS]
    if not (directory / JOB_FILE).is_file():  # a run of a job keeps copies of what others found
        files += [(task, task.result) for task in ALL_TASKS]
    return next((task for task, name in files if name and (directory / name).is_file()), None)


def read_recorded_show(directory: Path) -> RecordedShow:
    """Read what a run directory has to show on the live page.

    Parameters
    ----------
    directory : Path
        Of the run, finished or not.

    Raises
    ------
    ConfigurationError
        If it holds no recording that can be shown, or one with nothing in it.
    RecordingError
        If its recording is damaged.
    """
    from tjscan.runs.live.calibration import read_calibration_show
    from tjscan.runs.live.crawl import read_crawl_show
    from tjscan.runs.live.scan import read_scan_show
    from tjscan.runs.live.tow import read_tow_show

    readers: list[ShowReader]
    readers = [read_calibration_show, read_crawl_show, read_scan_show, read_tow_show]
    for recording, read in zip(LIVE_PAGE_RECORDINGS, readers, strict=True):
        if recording_files(directory, recording)[0].is_file():
            show, entries = read(directory)
            if not (steps := tuple(map(show.step, entries))):
                raise ConfigurationError("nothing was recorded in it yet", file=directory)
            return RecordedShow(show.setting, steps)
    raise ConfigurationError(
        "holds no recording that can be shown: give the directory of a scan, a crawl, a tow or a "
        "calibration, or of one station",
        file=directory,
    )


def study_backend_of_task(task: str) -> StudyBackend[Any]:
    """What a study of a task varies, runs and measures.

    Raises
    ------
    ConfigurationError
        If there is no such task, or it can't be studied.
    """
    from tjscan.runs.crawl.study import CRAWL_STUDY
    from tjscan.runs.scan.study import SCAN_STUDY
    from tjscan.runs.tow.study import TOW_STUDY

    backends: dict[str, StudyBackend[Any]]
    backends = {"crawl": CRAWL_STUDY, "scan": SCAN_STUDY, "tow": TOW_STUDY}
    names = [one.name for one in ALL_TASKS]
    if task not in names:
        raise ConfigurationError(
            f"there is no task {task!r}; did you mean: {nearest_word(task, names)}? "
            f"Known: {', '.join(names)}"
        )
    if task not in backends:
        raise ConfigurationError(f"the task {task!r} brings no study")
    return backends[task]
