"""Tasks on a cluster, through dask.distributed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final, TypeVar

from tjscan.errors import ConfigurationError
from tjscan.study.schedule import Done, Lost

T = TypeVar("T")
R = TypeVar("R")

PATIENCE: Final = 20.0
"""Seconds that a scheduler has to answer."""


class ClusterScheduler:
    """Runs tasks on the workers of a dask scheduler, which have tjscan installed.

    A worker that dies takes no task with it: the scheduler hands it to another one, and only a
    task that kills worker after worker is lost.

    Parameters
    ----------
    address : str
        Of the scheduler, for instance ``tcp://10.0.0.5:8786``.
    """

    def __init__(self, address: str) -> None:
        self.address = address

    def __call__(
        self, work: Callable[[T], R], tasks: Sequence[T]
    ) -> Iterator[Done[T, R] | Lost[T]]:
        """Run `work` on every task; see `tjscan.study.schedule.Scheduler`.

        Raises
        ------
        ConfigurationError
            If dask.distributed is not installed, or no scheduler answers.
        """
        try:
            from distributed import Client, KilledWorker, as_completed
        except ImportError:
            raise ConfigurationError(
                "a cluster needs dask.distributed: pip install 'tjscan[cluster]'"
            ) from None
        try:
            client = Client(self.address, timeout=PATIENCE)
        except (OSError, ValueError) as error:
            raise ConfigurationError(
                f"no scheduler answers at {self.address} ({error}); start one with `dask "
                "scheduler`, and workers with `dask worker ADDRESS --nthreads 1`"
            ) from None
        with client:
            futures = {client.submit(work, task, pure=False): task for task in tasks}
            for future in as_completed(futures):
                task = futures.pop(future)
                fault = future.exception()
                if isinstance(fault, KilledWorker):
                    yield Lost(task, f"worker after worker died under it: {fault}")
                else:
                    yield Done(task, future.result())
                future.release()
