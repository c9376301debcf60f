"""Run a study: from its plan to its tables, now or later."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

from tjscan.core.errors import TjscanError
from tjscan.core.files import lock_and_clean_directory, write_files_atomically
from tjscan.study.backend import BackendOfTask
from tjscan.study.report import write_study_report
from tjscan.study.schedule import TaskScheduler
from tjscan.study.store import open_row_writer, read_rows, read_trials, write_study_tables
from tjscan.study.trial import LOST_WORKER, StudyRow, Trial


def run_study(
    directory: Path,
    scheduler: TaskScheduler,
    watch: Callable[[StudyRow[Any]], None],
    backend_of: BackendOfTask,
) -> tuple[StudyRow[Any], ...]:
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
    tuple of StudyRow
        In the order of the plan.

    Raises
    ------
    ConfigurationError
        If the directory holds no study, or the scheduler can't be had.
    RecordingError
        If the directory can't be written, or another process runs this study.
    """
    trials = read_trials(directory)
    with lock_and_clean_directory(directory):
        rows = read_rows(directory, trials, backend_of)
        for row in rows.values():
            watch(row)
        left = [trial for trial in trials if trial.hash_key not in rows]
        try:
            with (
                open_row_writer(directory) as keep,
                closing(scheduler(partial(run_trial, backend_of=backend_of), left)) as all_ended,
            ):
                for ended in all_ended:
                    lost = backend_of(ended.task.task).outcome
                    outcome = lost(False, LOST_WORKER, ended.cause_of_crash)
                    row = ended.result or StudyRow.from_trial(ended.task, outcome)
                    keep(row)
                    rows[row.key] = row
                    watch(row)
        finally:
            done = tuple(rows[trial.hash_key] for trial in trials if trial.hash_key in rows)
            if done:
                kind = backend_of(trials[0].task)
                with write_files_atomically(directory) as draft:
                    write_study_tables(draft, done)
                    write_study_report(draft, kind, done, planned=len(trials))
    return done


def run_trial(trial: Trial, backend_of: BackendOfTask) -> StudyRow[Any]:
    """Execute one trial and return its row; a failure gives a row too."""
    kind, start = backend_of(trial.task), perf_counter()
    try:
        outcome = kind.execute_run(trial.settings)
    except TjscanError as error:
        outcome = kind.outcome(False, type(error).__name__, str(error))
    except Exception as error:
        # A fault of the program: it costs this row and no other, which holds its name.
        outcome = kind.outcome(False, type(error).__name__, f"unexpected: {error}")
    return StudyRow.from_trial(trial, outcome, perf_counter() - start)
