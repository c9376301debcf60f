"""Run a study: from the plan in its directory to rows as they come, and to the tables of all."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import fields
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, Final

from tjscan.core import files
from tjscan.core.errors import ConfigurationError, RecordingError, TjscanError
from tjscan.study.report import write_study_report
from tjscan.study.schedule import TaskScheduler
from tjscan.study.trial import LOST_WORKER_REASON, BackendOfTask, StudyRow, Trial, Value

PLAN_FILE: Final = "plan.jsonl"
STUDY_ROWS_FILE: Final = "rows.jsonl"
CSV_FILE: Final = "study.csv"
PARQUET_FILE: Final = "study.parquet"

MOST_STUDY_BYTES: Final = 2_000_000_000
"""A larger file is no part of a study."""


def make_study_directory(directory: Path, trials: Sequence[Trial]) -> None:
    """Make a study's directory and write all its trials into it.

    Parameters
    ----------
    directory : Path
        To make.
    trials : sequence of Trial
        All of them.

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
        text = "".join(f"{trial.to_json_line()}\n" for trial in trials)
        (draft / PLAN_FILE).write_text(text, encoding="utf-8")


def read_trials(directory: Path) -> tuple[Trial, ...]:
    """Read the trials of a study from its directory.

    Raises
    ------
    ConfigurationError
        If it holds no study.
    """
    file = directory / PLAN_FILE
    try:
        files.check_file_size(file, MOST_STUDY_BYTES, "a plan")
        return tuple(Trial.from_json_line(line) for line in file.read_text("utf-8").splitlines())
    except OSError:
        raise ConfigurationError("there is no study", file=directory) from None
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ConfigurationError(f"is no plan of a study: {error}", file=file) from None


def read_rows(
    directory: Path, trials: Sequence[Trial], backend_of: BackendOfTask
) -> dict[str, StudyRow[Any]]:
    """Read the finished rows of a study that belong to one of the trials, by hash key.

    Parameters
    ----------
    directory : Path
        The study's.
    trials : sequence of Trial
        All that were planned.
    backend_of : callable
        Gives the backend of their task.

    Raises
    ------
    ConfigurationError
        If the file is no file, or too large.
    RecordingError
        If it can't be read.
    """
    file, keys = directory / STUDY_ROWS_FILE, {trial.hash_key for trial in trials}
    rows: dict[str, StudyRow[Any]] = {}
    if not trials or not file.exists():
        return rows
    try:
        files.check_file_size(file, MOST_STUDY_BYTES, "the rows of a study")
        lines = file.read_text("utf-8", errors="replace").splitlines()
    except OSError as error:
        raise RecordingError(f"{file}: can't be read: {error.strerror}") from error
    outcome = backend_of(trials[0].task).outcome
    for line in lines:
        try:
            row: StudyRow[Any] = StudyRow.from_json_line(line, outcome)
        except (ValueError, RecursionError):
            continue
        if row.key in keys:
            rows[row.key] = row
    return rows


@contextmanager
def open_row_writer(directory: Path) -> Iterator[Callable[[StudyRow[Any]], None]]:
    """Open the rows file of a study; gives the function that writes a row to disk.

    Raises
    ------
    RecordingError
        If the file can't be written.
    """
    try:
        with (directory / STUDY_ROWS_FILE).open("ab") as file:
            if file.tell():
                file.write(b"\n")  # ends a line that was cut off; an empty one is no row

            def keep(row: StudyRow[Any]) -> None:
                file.write(row.to_json_line().encode() + b"\n")
                files.sync_stream_to_disk(file)

            yield keep
    except OSError as error:
        reason = f"{directory / STUDY_ROWS_FILE}: can't be written: {error.strerror}"
        raise RecordingError(reason) from error


def write_study_tables(folder: Path, rows: Sequence[StudyRow[Any]]) -> None:
    """Write ``study.csv`` and ``study.parquet``: each row's inputs, outcome and wall-clock time.

    CSV holds numbers to the last digit, and nothing for what is not known; in Parquet a column
    whose values are of several types becomes text.

    Parameters
    ----------
    folder : Path
        Where to.
    rows : sequence of StudyRow
        One at least, all of one kind.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    inputs = dict.fromkeys(key for row in rows for key in row.inputs)
    shown = [f.name for f in fields(rows[0].outcome) if f.metadata.get("column", True)]
    table: dict[str, list[Value | None]] = {"row": [row.index for row in rows]}
    table |= {key: [row.inputs.get(key) for row in rows] for key in inputs}
    table |= {name: [getattr(row.outcome, name) for row in rows] for name in shown}
    table["wall_s"] = [round(row.wall_s, 3) for row in rows]
    with (folder / CSV_FILE).open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(table)
        writer.writerows(zip(*table.values(), strict=True))
    columns = {name: _unify_value_types(values) for name, values in table.items()}
    pq.write_table(pa.table(columns), folder / PARQUET_FILE)


def _unify_value_types(values: list[Value | None]) -> list[Value | None]:
    types = {type(value) for value in values if value is not None}
    if len(types) < 2:
        return values
    common = float if types == {int, float} else str
    return [None if value is None else common(value) for value in values]


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
    with files.lock_and_clean_directory(directory):
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
                    outcome = lost(False, LOST_WORKER_REASON, ended.cause_of_crash)
                    row = ended.result or StudyRow.from_trial(ended.task, outcome)
                    keep(row)
                    rows[row.key] = row
                    watch(row)
        finally:
            done = tuple(rows[trial.hash_key] for trial in trials if trial.hash_key in rows)
            if done:
                kind = backend_of(trials[0].task)
                with files.write_files_atomically(directory) as draft:
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
