"""What every scheduler gives: tasks back as they end, done or lost."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from tjscan.study.row import Row
from tjscan.study.task import Task

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class Done(Generic[T, R]):
    """A task and what its work gave."""

    task: T
    result: R


@dataclass(frozen=True, slots=True)
class Lost(Generic[T]):
    """A task whose process died under it, again when it was tried alone, and what is known."""

    task: T
    cause: str


class Scheduler(Protocol):
    """Runs the tasks of a study somewhere, in any order."""

    def __call__(
        self, work: Callable[[Task], Row], tasks: Sequence[Task]
    ) -> Iterator[Done[Task, Row] | Lost[Task]]:
        """Give every task back once it has ended."""
        ...
