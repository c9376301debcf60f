"""What an algorithm brings to studies: how its runs are resolved, made and measured."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from tjscan.core.errors import ConfigurationError
from tjscan.study.trial import RunOutcome

O = TypeVar("O", bound=RunOutcome)  # noqa: E741


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
