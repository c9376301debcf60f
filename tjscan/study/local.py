"""Tasks in processes of this machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Final, TypeVar

from tjscan.study.quiet import quiet
from tjscan.study.schedule import Done, Lost

T = TypeVar("T")
R = TypeVar("R")

AHEAD: Final = 2
"""Tasks handed out per process: one under way, and one so that it never waits."""


class LocalScheduler:
    """Runs tasks in a number of processes of this machine.

    A process that dies takes no task with it: those under way are tried once more, one by
    one, and only one that kills a process again is lost.

    Parameters
    ----------
    workers : int
        How many processes.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers

    def __call__(
        self, work: Callable[[T], R], tasks: Sequence[T]
    ) -> Iterator[Done[T, R] | Lost[T]]:
        """Run `work` on every task; see `tjscan.study.schedule.Scheduler`."""
        left = list(tasks)
        while left:
            suspects: list[T] = []
            yield from self._until_broken(work, left, suspects)
            while suspects:
                yield from _one_by_one(work, suspects)

    def _until_broken(
        self, work: Callable[[T], R], left: list[T], suspects: list[T]
    ) -> Iterator[Done[T, R]]:
        """Take tasks off `left` until none is left, or a process died under the `suspects`."""
        with _pool(min(self.workers, len(left))) as pool:
            running: dict[Future[R], T] = {}
            while left or running:
                try:
                    while left and len(running) < AHEAD * self.workers:
                        future = pool.submit(work, left[0])
                        running[future] = left.pop(0)
                except BrokenProcessPool:
                    # The task that could not be submitted is still the first of those left.
                    suspects += running.values()
                    return
                ended, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in ended:
                    task = running.pop(future)
                    if isinstance(future.exception(), BrokenProcessPool):
                        suspects.append(task)
                    else:
                        yield Done(task, future.result())
                if suspects:
                    suspects += running.values()
                    return


def _one_by_one(work: Callable[[T], R], suspects: list[T]) -> Iterator[Done[T, R] | Lost[T]]:
    """Take tasks off `suspects`, one at a time in one process, until one of them kills it."""
    with _pool(1) as pool:
        while suspects:
            task = suspects.pop(0)
            try:
                yield Done(task, pool.submit(work, task).result())
            except BrokenProcessPool:
                cause = "its process died twice, the second time with nothing else in it"
                yield Lost(task, cause)
                return


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes started afresh: a fork would copy threads' locks. Leaving drops what waits."""
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=quiet)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
