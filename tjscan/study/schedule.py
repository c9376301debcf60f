"""Trials on processes of this machine or of a cluster, by dask.distributed."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import islice
from logging import CRITICAL
from typing import Any, Final, Generic, TypeVar

from tjscan.core.errors import ComputeClusterFault, ConfigurationError, missing_package_error
from tjscan.core.version import program_code
from tjscan.study.trial import StudyRow, Trial

T = TypeVar("T")
R = TypeVar("R")

CLUSTER_TIMEOUT: Final = 20.0
"""Seconds that a scheduler has to answer, and the first worker of a cluster to join it."""

MOST_WORKER_DEATHS: Final = 1
"""How often a trial may take a process of this machine with it and be tried again."""

STUDY_PACKAGES: Final = ("distributed", "pyarrow")
"""What the extra ``study`` installs."""


@dataclass(frozen=True, slots=True)
class EndedTask(Generic[T, R]):
    """A scheduled task and the result of its work; or why it crashed, and no result.

    It crashes if its process dies whenever it is tried.
    """

    task: T
    result: R | None
    cause_of_crash: str = ""


TaskScheduler = Callable[
    [Callable[[Trial], StudyRow[Any]], Iterable[Trial], int],
    Generator[EndedTask[Trial, StudyRow[Any]]],
]
"""Runs so many trials of a study somewhere, and gives each back once it has ended."""


@dataclass(frozen=True, slots=True)
class DaskScheduler:
    """Runs tasks on the workers of a dask scheduler, which take one thread each.

    A worker that dies costs no task but the one that kills its workers again and again.

    Parameters
    ----------
    workers : int
        Processes of this machine, started and ended with the study.
    address : str, optional
        Of a scheduler to use instead, whose workers have tjscan installed, for instance
        ``tcp://10.0.0.5:8786``.
    """

    workers: int = 1
    address: str | None = None

    def __call__(
        self, work: Callable[[T], R], tasks: Iterable[T], count: int
    ) -> Generator[EndedTask[T, R]]:
        """Run `work` on every task; for the parameters see `TaskScheduler`.

        Raises
        ------
        ConfigurationError
            If dask.distributed is not installed, or no scheduler answers.
        ClusterFault
            If no worker joins, one has another tjscan, or the scheduler is gone before the end.
        """
        check_study_packages()
        if not count:
            return
        local = _start_local_cluster(min(self.workers, count))
        with local if self.address is None else _connect_to_cluster(self.address) as client:
            yield from _run_tasks(client, work, tasks)


def check_study_packages() -> None:
    """Check that the packages that a study needs are installed.

    Raises
    ------
    ConfigurationError
        If something is not.
    """
    for name in STUDY_PACKAGES:
        if find_spec(name) is None:
            raise missing_package_error("a study", name, "study")


NO_WORKER_LEFT_MESSAGE: Final = "no worker is left; start them again, and go on with --resume"
SCHEDULER_GONE_MESSAGE: Final = "the scheduler is gone; start one again, and go on with --resume"


def _run_tasks(
    client: Any, work: Callable[[T], R], tasks: Iterable[T]
) -> Generator[EndedTask[T, R]]:
    """Hand out one task per thread, so that a worker that dies is blamed on what it ran."""
    from distributed import KilledWorker

    waiting, running = iter(tasks), dict[Any, T]()

    def hand_out() -> None:
        try:
            threads = sum(client.nthreads().values())
        except OSError:
            raise ComputeClusterFault(SCHEDULER_GONE_MESSAGE) from None
        for task in islice(waiting, max(threads, 1) - len(running)):
            future = client.submit(work, task, pure=False)
            running[future] = task

    hand_out()
    while running:
        future = _await_next_result(client, list(running))
        task = running.pop(future)
        fault = future.exception() if future.status == "error" else None
        over: EndedTask[T, R]
        if isinstance(fault, KilledWorker):
            over = EndedTask(task, None, "every worker that ran it died")
        elif isinstance(fault, ComputeClusterFault):
            raise fault
        elif fault is not None:
            raise ComputeClusterFault(f"a worker failed: {fault!r}")
        elif future.status != "finished":
            raise ComputeClusterFault(SCHEDULER_GONE_MESSAGE)
        else:
            over = EndedTask(task, future.result())
        future.release()
        hand_out()
        yield over


def _await_next_result(client: Any, running: list[Any]) -> Any:
    """Wait for the next task that ends; raises ComputeClusterFault if no worker is left for it."""
    from distributed import wait

    while True:
        try:
            return next(iter(wait(running, CLUSTER_TIMEOUT, return_when="FIRST_COMPLETED").done))
        except TimeoutError:
            if not client.nthreads():
                raise ComputeClusterFault(NO_WORKER_LEFT_MESSAGE) from None
        except CancelledError:
            raise ComputeClusterFault(SCHEDULER_GONE_MESSAGE) from None


@contextmanager
def _start_local_cluster(workers: int) -> Iterator[Any]:
    """Give the client of a scheduler with processes of this machine, which end with the block."""
    from dask import config
    from distributed import Client, LocalCluster

    with config.set({"distributed.scheduler.allowed-failures": MOST_WORKER_DEATHS}):
        cluster = LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            memory_limit=0,
            silence_logs=CRITICAL,
            preload=["tjscan.study.worker"],
        )
        try:
            with Client(cluster) as client:
                yield client
        finally:
            with suppress(TimeoutError):  # processes that end late on a busy machine do no harm
                cluster.close()


@contextmanager
def _connect_to_cluster(address: str) -> Iterator[Any]:
    """Give the client of a scheduler somewhere, whose workers are as this machine."""
    from distributed import Client

    try:
        client = Client(address, timeout=CLUSTER_TIMEOUT)
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            f"no scheduler answers at {address} ({error}); start one with `dask "
            "scheduler`, and workers with `dask worker ADDRESS --nthreads 1`"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=CLUSTER_TIMEOUT)
        except TimeoutError:
            raise ComputeClusterFault(
                f"no worker has joined the scheduler within {CLUSTER_TIMEOUT:g} s; start one with "
                "`dask worker ADDRESS --nthreads 1`, and go on with --resume"
            ) from None
        from tjscan.study.worker import SameProgram

        try:
            client.register_plugin(SameProgram(program_code()))
        except Exception as error:  # what an older program raises has no one name
            raise ComputeClusterFault(
                f"a worker can't take part: {error}; install tjscan {program_code()} everywhere, "
                "then go on with --resume"
            ) from None
        yield client
