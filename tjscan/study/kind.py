"""What an algorithm brings to studies: how its runs are resolved, made and measured."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

from tjscan.core.registry import TASKS
from tjscan.study.row import RunOutcome, StudyRow

O = TypeVar("O", bound=RunOutcome)  # noqa: E741


@dataclass(frozen=True, slots=True)
class ResolvedRun:
    """A run, resolved and checked.

    Parameters
    ----------
    settings : str
        Everything that the run needs, as canonical JSON.
    followed : mapping
        What followed from the study's keys and stands in the table beside them.
    """

    settings: str
    followed: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class ReportedQuantity(Generic[O]):
    """A number of every run that reports show.

    Parameters
    ----------
    name : str
        With its unit, as ``mean corner error / mm``.
    value : callable
        Takes it from an outcome; None where it is unknown.
    form : str
        How it is written, as `format` knows it.
    """

    name: str
    value: Callable[[O], float | None]
    form: str


class StudyKind(ABC, Generic[O]):
    """The studies of one algorithm, which its `Task` names.

    Attributes
    ----------
    outcome : type
        What comes out of a run: a subclass of `RunOutcome` whose other fields have defaults.
    seed : str
        The key that sets a run's random numbers.
    measures : sequence of ReportedQuantity
        What every report of a study shows.
    """

    outcome: type[O]
    seed: str
    measures: Sequence[ReportedQuantity[O]]

    @abstractmethod
    def resolve(self, job_file: Path, keys: Mapping[str, Any]) -> ResolvedRun:
        """Resolve and check one run; nothing moves.

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
    def run(self, settings: str) -> O:
        """Make a run from what `resolve` gave.

        Raises
        ------
        TjscanError
            If it fails.
        """

    def chapters(self, folder: Path, rows: Sequence[StudyRow[O]]) -> Iterator[str]:
        """Lines of the report in place of the usual ones, where rows are of a known programme.

        Parameters
        ----------
        folder : Path
            Where pictures may be written.
        rows : sequence of StudyRow
            What is done so far, one at least.
        """
        yield from ()


def study_kind_of_task(task: str) -> StudyKind[Any]:
    """The studies of a task.

    Raises
    ------
    ConfigurationError
        If there is no such task, or it can't be studied.
    """
    return cast("StudyKind[Any]", TASKS.load(task).load("study"))
