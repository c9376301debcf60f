"""Runs of a study: what is to be made, the row that comes of it, and what an algorithm brings."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

from tjscan.core.errors import ConfigurationError

Value = bool | int | float | str
"""What a cell of the table holds."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One run of a study to make: its row in the table, and what is varied in it.

    Parameters
    ----------
    index : int
        Its row in the table.
    hash_key : str
        Hash of all that decides the run's result; it differs from every other run's.
    job : str
        Path of its base job, from the folder of the plan's files.
    varied : mapping
        Dotted keys and values that are not the same in every run.
    inputs : mapping
        The same as cells of the table.
    """

    index: int
    hash_key: str
    job: str
    varied: Mapping[str, Any]
    inputs: Mapping[str, Value]


def canonical_json(data: Any) -> str:
    """JSON text that is always the same for the same data."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)


LOST_WORKER_REASON = "WorkerLost"
"""The reason of a row whose process died twice."""

HIDDEN_COLUMN_METADATA = {"column": False}
"""Metadata of a field of an outcome that is no column of the table."""


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """Outcome of one run: whether it is complete, and why it ended. Each task adds its fields.

    Parameters
    ----------
    complete : bool
        Whether the run did what was asked.
    reason : str
        Why it ended: a stop in words, or the name of an error.
    detail : str
        The same in one sentence.
    """

    complete: bool
    reason: str
    detail: str


O = TypeVar("O", bound=RunOutcome)  # noqa: E741


@dataclass(frozen=True, slots=True)
class StudyRow(Generic[O]):
    """One row of a study's table: what was varied in a run, and its outcome.

    Parameters
    ----------
    key : str
        Of the trial.
    index : int
        Its place in the table.
    inputs : mapping
        What was varied.
    outcome : RunOutcome
        What came out.
    code : str
        Version and source of the program that made it.
    wall_s : float
        How long it took on the clock of the machine that made it, seconds: the one value that
        differs from run to run.
    """

    key: str
    index: int
    inputs: Mapping[str, Value]
    outcome: O
    code: str = ""
    wall_s: float = 0.0

    def to_json_line(self) -> str:
        """The row as one line of JSON."""
        return canonical_json(asdict(self))

    @classmethod
    def from_json_line(cls, line: str, outcome: type[O]) -> Self:
        """Read a row from the line that `to_json_line` gave.

        Parameters
        ----------
        line : str
            One line.
        outcome : type
            Of what came out.

        Raises
        ------
        ValueError
            If the line is no row, or was cut off.
        """
        try:
            data: dict[str, Any] = json.loads(line)
            data["outcome"] = outcome(**data["outcome"])
            row = cls(**data)
            kinds = ((row.key, str), (row.index, int), (row.inputs, dict), (row.code, str))
            if not all(isinstance(v, kind) for v, kind in (*kinds, (row.wall_s, int | float))):
                raise ValueError("no row of a study: a value of it is of another type")
            return row
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"no row of a study: {error}") from None


@dataclass(frozen=True, slots=True)
class ResolvedRun:
    """Complete settings of one run of a study, resolved and checked.

    Parameters
    ----------
    settings : str
        Everything that the run needs, as canonical JSON.
    followed : mapping
        What followed from the study's keys and is in the table beside them.
    """

    settings: str
    followed: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class ReportedQuantity(Generic[O]):
    """A quantity of every run that a study's report shows: its name, value and format.

    Parameters
    ----------
    name : str
        With its unit, as ``mean corner error / mm``.
    value : callable
        Takes it from an outcome; None if it is unknown.
    form : str
        How it is written, as `format` knows it.
    """

    name: str
    value: Callable[[O], float | None]
    form: str


class StudyBackend(ABC, Generic[O]):
    """How the runs of one task are resolved, executed and reported in a study.

    Attributes
    ----------
    outcome : type
        What comes out of a run: a subclass of `RunOutcome` whose other fields have defaults.
    seed : str
        The key that sets a run's random numbers.
    measures : sequence of ReportedQuantity
        What every report of a study shows.
    compared_key : str
        A key whose values the report shows side by side if a study varies it; none if empty.
    """

    outcome: type[O]
    seed: str
    measures: Sequence[ReportedQuantity[O]]
    compared_key: str = ""

    @abstractmethod
    def resolve_run(self, job_file: Path, keys: Mapping[str, Any]) -> ResolvedRun:
        """Resolve and check the settings of one run; nothing moves.

        Parameters
        ----------
        job_file : Path
            The base job.
        keys : mapping
            Dotted keys and their values, as the study sets them.

        Raises
        ------
        ConfigurationError
            If such a run can't be, naming the key.
        """

    @abstractmethod
    def execute_run(self, settings: str) -> O:
        """Execute a run whose settings `resolve_run` gave.

        Raises
        ------
        TjscanError
            If it fails.
        """


@contextmanager
def drop_file_from_study_key_errors(keys: Mapping[str, Any]) -> Iterator[None]:
    """Name no file in errors of the block about a key of the study: it is not the job's to mend.

    Parameters
    ----------
    keys : mapping
        Dotted keys that the study sets in the job that the block reads.
    """
    try:
        yield
    except ConfigurationError as error:
        blamed = error.key or ""
        if any(key == blamed or key.startswith(f"{blamed}.") for key in keys):
            raise ConfigurationError(error.message, key=error.key) from None
        raise


BackendOfTask = Callable[[str], StudyBackend[Any]]
"""Gives the backend of a task by its name, and raises ConfigurationError if there is none. Workers
of other processes get it pickled: it is a function of a module."""
