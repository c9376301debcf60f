"""Run a study: from the plan in its directory to rows as they come, and to the tables of all."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, Final

from tjscan.core import files
from tjscan.core.errors import ComputeClusterFault, ConfigurationError, TjscanError
from tjscan.core.version import program_code
from tjscan.study.plan import StudyPlan, folder_of_files, read_plan, table_cells
from tjscan.study.report import write_study_report
from tjscan.study.rows import StudyRows, write_study_tables
from tjscan.study.schedule import TaskScheduler
from tjscan.study.trial import LOST_WORKER_REASON, BackendOfTask, StudyRow, Trial

PLAN_FILE: Final = "study.json"


def make_study_directory(directory: Path, plan: StudyPlan) -> None:
    """Make a study's directory and write its plan into it.

    Parameters
    ----------
    directory : Path
        To make.
    plan : StudyPlan
        The plan.

    Raises
    ------
    ConfigurationError
        If the directory holds something already.
    RecordingError
        If it can't be written.
    """
    if directory.exists() and any(directory.iterdir()):
        raise ConfigurationError(
            "is not empty; a study never overwrites another. Choose another --out, or go on with "
            "--resume",
            file=directory,
        )
    with files.write_files_atomically(directory) as draft:
        (draft / PLAN_FILE).write_text(f"{plan.to_json()}\n", encoding="utf-8")


def read_study(directory: Path, backend_of: BackendOfTask) -> tuple[StudyPlan, StudyRows]:
    """Read plan and finished rows of a study from its directory.

    Raises
    ------
    ConfigurationError
        If it holds no study.
    RecordingError
        If the rows can't be read.
    """
    plan = read_plan(directory / PLAN_FILE)
    return plan, StudyRows(directory, plan, backend_of(plan.file.task).outcome)


def run_study(
    directory: Path,
    scheduler: TaskScheduler,
    watch: Callable[[StudyRow[Any]], None],
    backend_of: BackendOfTask,
) -> StudyRows:
    """Run what a study's directory still lacks, and write its tables.

    A study that is interrupted leaves tables of what is done, and goes on from there.

    Parameters
    ----------
    directory : Path
        What `make_study_directory` made.
    scheduler : TaskScheduler
        Where the trials run.
    watch : callable
        Receives every row, those on disk first, after it is on disk.
    backend_of : callable
        Gives the backend of the study's task, here and on the scheduler's workers.

    Returns
    -------
    StudyRows
        In the order of the plan.

    Raises
    ------
    ConfigurationError
        If the directory holds no study, or the scheduler can't be had.
    RecordingError
        If the directory can't be written, or another process runs this study.
    """
    with files.lock_and_clean_directory(directory):
        plan, rows = read_study(directory, backend_of)
        kind = backend_of(plan.file.task)
        for row in rows:
            watch(row)
        left = (plan[index] for index in rows.missing)
        work = partial(run_trial, plan=plan, backend_of=backend_of, code=program_code())
        try:
            with (
                rows.open_to_append() as keep,
                closing(scheduler(work, left, len(plan) - len(rows))) as all_ended,
            ):
                for ended in all_ended:
                    lost = kind.outcome(False, LOST_WORKER_REASON, ended.cause_of_crash)
                    row = ended.result or row_of_trial(ended.task, lost)
                    keep(row)
                    watch(row)
        finally:
            if len(rows):
                with files.write_files_atomically(directory) as draft:
                    write_study_tables(draft, rows)
                    write_study_report(draft, kind, rows, planned=len(plan))
    return rows


def run_trial(trial: Trial, plan: StudyPlan, backend_of: BackendOfTask, code: str) -> StudyRow[Any]:
    """Execute one trial and return its row; a failure gives a row too.

    Raises
    ------
    ComputeClusterFault
        If this process has another program than who asks.
    """
    if program_code() != code:
        raise ComputeClusterFault(
            f"a worker has tjscan {program_code()}, this study tjscan {code}: install the same "
            "everywhere, then go on with --resume"
        )
    kind, start = backend_of(plan.file.task), perf_counter()
    followed = {}
    try:
        folder = folder_of_files(frozenset(plan.files.items()))
        resolved = plan.resolve(trial, kind, folder)
        followed = table_cells(resolved.followed)
        outcome = kind.execute_run(resolved.settings)
    except TjscanError as error:
        outcome = kind.outcome(False, type(error).__name__, str(error))
    except Exception as error:
        # A fault of the program: it costs this row and no other, which holds its name.
        outcome = kind.outcome(False, type(error).__name__, f"unexpected: {error}")
    return row_of_trial(trial, outcome, followed, code, perf_counter() - start)


def row_of_trial(
    trial: Trial,
    outcome: Any,
    followed: dict[str, Any] | None = None,
    code: str = "",
    wall_s: float = 0.0,
) -> StudyRow[Any]:
    """Row of a trial, of what came out, and of what followed from its keys."""
    inputs = dict(trial.inputs) | (followed or {})
    return StudyRow(trial.hash_key, trial.index, inputs, outcome, code, wall_s)
