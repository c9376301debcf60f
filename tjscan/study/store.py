"""The study's directory: the plan, written before anything runs, and rows as they come."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, Protocol

from tjscan.core.errors import ConfigurationError, RecordingError
from tjscan.core.files import bring_stream_to_disk, check_file_size, write_files_atomically
from tjscan.study.backend import study_backend_of_task
from tjscan.study.row import StudyRow
from tjscan.study.trial import Trial

PLAN: Final = "plan.jsonl"
ROWS: Final = "rows.jsonl"

MOST_BYTES: Final = 2_000_000_000
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
    with write_files_atomically(directory) as draft:
        text = "".join(f"{trial.to_json_line()}\n" for trial in trials)
        (draft / PLAN).write_text(text, encoding="utf-8")


def read_trials(directory: Path) -> tuple[Trial, ...]:
    """Read the trials of a study from its directory.

    Raises
    ------
    ConfigurationError
        If it holds no study.
    """
    file = directory / PLAN
    try:
        check_file_size(file, MOST_BYTES, "a plan")
        return tuple(Trial.from_json_line(line) for line in file.read_text("utf-8").splitlines())
    except OSError:
        raise ConfigurationError("there is no study", file=directory) from None
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ConfigurationError(f"is no plan of a study: {error}", file=file) from None


def read_rows(directory: Path, trials: Sequence[Trial]) -> dict[str, StudyRow[Any]]:
    """Read the finished rows of a study that belong to one of the trials, by hash key.

    Parameters
    ----------
    directory : Path
        The study's.
    trials : sequence of Trial
        All that were planned.

    Raises
    ------
    ConfigurationError
        If the file is no file, or too large.
    RecordingError
        If it can't be read.
    """
    file, keys = directory / ROWS, {trial.hash_key for trial in trials}
    rows: dict[str, StudyRow[Any]] = {}
    if not trials or not file.exists():
        return rows
    try:
        check_file_size(file, MOST_BYTES, "the rows of a study")
        lines = file.read_text("utf-8", errors="replace").splitlines()
    except OSError as error:
        raise RecordingError(f"{file}: can't be read: {error.strerror}") from error
    outcome = study_backend_of_task(trials[0].task).outcome
    for line in lines:
        try:
            row: StudyRow[Any] = StudyRow.from_json_line(line, outcome)
        except (ValueError, RecursionError):
            continue
        if row.key in keys:
            rows[row.key] = row
    return rows


class RowWriter(Protocol):
    """A function that keeps one finished row of a study."""

    def __call__(self, row: StudyRow[Any]) -> None:
        """Keep a row."""
        ...


@contextmanager
def open_row_writer(directory: Path) -> Iterator[RowWriter]:
    """Open the rows file of a study; gives the function that writes a row to disk.

    Raises
    ------
    RecordingError
        If the file can't be written.
    """
    try:
        with (directory / ROWS).open("ab") as file:
            if file.tell():
                file.write(b"\n")  # ends a line that was cut off; an empty one is no row

            def keep(row: StudyRow[Any]) -> None:
                file.write(row.to_json_line().encode() + b"\n")
                bring_stream_to_disk(file)

            yield keep
    except OSError as error:
        raise RecordingError(f"{directory / ROWS}: can't be written: {error.strerror}") from error
