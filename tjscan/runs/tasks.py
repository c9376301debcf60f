"""The tasks: the one table in which the algorithms meet, with all that each contributes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, Final, Literal

from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.live.step import RecordedShow
from tjscan.result.directory import CALIBRATION_FILE, JOB_FILE
from tjscan.study.trial import StudyBackend


@dataclass(frozen=True, slots=True)
class Task:
    """A task: the files of its runs, and what it contributes to pages and studies.

    What it contributes is imported when it is asked for: the report needs no live page, and a study
    no report.

    Parameters
    ----------
    name : str
        Of the task.
    room : str
        Room of `tjscan.runs` that has its chapter in the report of a scan, a `ChapterWriter`, and
        name of the module of `tjscan.runs.live` that has its `ReplayReader`.
    recording : str
        Kind of its recording, as `tjscan.recording.parts.recording_files` has it.
    page : str, optional
        The `ChapterWriter` of its run's report, if that is a page of its own.
    study : str, optional
        The `StudyBackend` of its studies, if it can be studied.
    result : str, optional
        A file by which a directory without job and recording is known to hold its result.
    """

    name: str
    room: str
    recording: str
    page: str = ""
    study: str = ""
    result: str = ""

    def load(self, contribution: Literal["chapter", "show", "page", "study"]) -> Any:
        """Import a contribution of the task that it has."""
        room = self.room
        names = {
            "chapter": f"{room}.report:{room}_chapter",
            "show": f"live.{room}:read_{room}_show",
            "page": f"{room}.report:{self.page}",
            "study": f"{room}.study:{self.study}",
        }
        return resolve_name(f"tjscan.runs.{names[contribution]}")


ALL_TASKS: Final = (
    Task("calibrate", "calibration", "measured", "calibration_page", result=CALIBRATION_FILE),
    Task("crawl", "crawl", "crawl", page="crawl_chapter", study="CRAWL_STUDY"),
    Task("scan", "scan", "scan", study="SCAN_STUDY"),
    Task("tow", "tow", "tow", page="tow_chapter", study="TOW_STUDY"),
    Task("weld", "weld", "weld", page="weld_chapter"),
)


def recorded_tasks(directory: Path) -> list[Task]:
    """The tasks whose recordings are in a run directory."""
    return [task for task in ALL_TASKS if (directory / f"{task.recording}.mcap").is_file()]


def task_with_own_page(directory: Path) -> Task | None:
    """The task that made a run and has a page of its own for it; None if it is a scan's."""
    found = recorded_tasks(directory)
    if not (directory / JOB_FILE).is_file():  # a run of a job keeps copies of what others found
        found += [task for task in ALL_TASKS if task.result and (directory / task.result).is_file()]
    return next((task for task in found if task.page), None)


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
    for task in recorded_tasks(directory):
        show, entries = task.load("show")(directory)
        if not (steps := tuple(map(show.step_of_entry, entries))):
            raise ConfigurationError("nothing was recorded in it yet", file=directory)
        return RecordedShow(show.setting, steps)
    raise ConfigurationError(
        "holds no recording that can be shown: give the directory of a scan, a crawl, a tow or a "
        "calibration, or of one station",
        file=directory,
    )


def study_backend_of_task(name: str) -> StudyBackend[Any]:
    """What a study of a task varies, runs and measures.

    Raises
    ------
    ConfigurationError
        If there is no such task, or it can't be studied.
    """
    tasks = {task.name: task for task in ALL_TASKS}
    if name not in tasks:
        raise ConfigurationError(
            f"there is no task {name!r}; did you mean: {nearest_word(name, list(tasks))}? "
            f"Known: {', '.join(tasks)}"
        )
    if not tasks[name].study:
        raise ConfigurationError(f"the task {name!r} brings no study")
    backend: StudyBackend[Any] = tasks[name].load("study")
    return backend
