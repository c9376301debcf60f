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

    A process that dies takes no task with it: those under way are tried once more, each alone
    in a process of its own, and only one that kills that too is lost.

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
            for task in suspects:
                yield _alone(work, task)

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


def _alone(work: Callable[[T], R], task: T) -> Done[T, R] | Lost[T]:
    with _pool(1) as pool:
        try:
            return Done(task, pool.submit(work, task).result())
        except BrokenProcessPool:
            return Lost(task, "its process died twice, the second time with nothing else in it")


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes started afresh: a fork would copy threads' locks. Leaving drops what waits."""
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=quiet)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
