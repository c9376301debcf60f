"""Tasks on a cluster, through dask.distributed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version as installed
from typing import Any, Final, TypeVar

from tjscan.core.errors import ClusterFault, ConfigurationError
from tjscan.core.version import VERSION
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
        ClusterFault
            If no worker joins, one has another tjscan, or the scheduler is gone before the end.
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
            _check_workers(client)
            futures = {client.submit(work, task, pure=False): task for task in tasks}
            for future in as_completed(futures):
                task = futures.pop(future)
                fault = future.exception() if future.status == "error" else None
                if isinstance(fault, KilledWorker):
                    yield Lost(task, f"worker after worker died under it: {fault}")
                elif fault is not None:
                    raise ClusterFault(f"a worker of {self.address} failed: {fault!r}")
                elif future.status != "finished":
                    raise ClusterFault(
                        f"the scheduler at {self.address} is gone; start one again, and go on "
                        "with --resume"
                    )
                else:
                    yield Done(task, future.result())
                future.release()


def _check_workers(client: Any) -> None:
    """Refuse a cluster without workers, or whose workers have another tjscan than this one.

    Raises
    ------
    ClusterFault
        If so.
    """
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        raise ClusterFault(
            f"no worker has joined the scheduler within {PATIENCE:g} s; start one with `dask "
            "worker ADDRESS --nthreads 1`, and go on with --resume"
        ) from None
    for worker, found in client.run(installed, "tjscan", on_error="return").items():
        if found != VERSION:
            other = found if isinstance(found, str) else "not at all"
            raise ClusterFault(
                f"the worker {worker} has tjscan {other}, this machine {VERSION}: the same "
                "version everywhere makes the same rows; then go on with --resume"
            )
