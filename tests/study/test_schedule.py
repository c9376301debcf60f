"""Trials on processes of this machine and of a cluster: the same rows, and nothing lost."""

import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of other people's imports
    distributed = pytest.importorskip("distributed")
    psutil = pytest.importorskip("psutil")

from studies import expand_in
from study_work import double_or_die, once, threads

from tjscan.core.errors import ComputeClusterFault, ConfigurationError
from tjscan.core.version import program_code
from tjscan.runs.tasks import study_backend_of_task
from tjscan.study.plan import StudyPlan
from tjscan.study.run import run_trial
from tjscan.study.schedule import DaskScheduler, EndedTask, _run_tasks, check_study_packages
from tjscan.study.trial import StudyRow
from tjscan.study.worker import SameProgram

pytestmark = pytest.mark.filterwarnings("ignore")


@contextmanager
def cluster_of(workers: int) -> Iterator[Any]:
    """Give a cluster that was started by hand; how long its end takes is nobody's concern."""
    cluster = distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address=None,
    )
    try:
        yield cluster
    finally:
        with suppress(TimeoutError):
            cluster.close()


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with cluster_of(2) as cluster:
        yield cluster.scheduler_address


def made(scheduler: DaskScheduler, plan: StudyPlan) -> list[StudyRow[Any]]:
    work = partial(run_trial, plan=plan, backend_of=study_backend_of_task, code=program_code())
    rows = [
        replace(e.result, wall_s=0.0)
        for e in scheduler(work, plan, len(plan))
        if e.result is not None
    ]
    return sorted(rows, key=lambda row: row.index)


def test_a_cluster_gives_the_same_rows_to_the_last_digit(address: str, tmp_path: Path) -> None:
    trials = expand_in(tmp_path)(fixed={"scan.sections": 4}, grid={"scan.step_mm": [40.0, 50.0]})
    rows = made(DaskScheduler(address=address), trials)
    assert len(rows) == 2
    assert rows == made(DaskScheduler(1), trials)


def test_a_study_on_this_machine_listens_on_loopback_only() -> None:
    for _ in DaskScheduler(1)(threads, (0,), 1):
        mine = psutil.Process()
        places = {
            socket.laddr.ip
            for process in (mine, *mine.children(recursive=True))
            for socket in process.net_connections("inet")
            if socket.status == psutil.CONN_LISTEN
        }
        assert places == {"127.0.0.1"}


def test_a_scheduler_that_is_not_there_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tjscan.study.schedule.CLUSTER_TIMEOUT", 0.5)
    scheduler = DaskScheduler(address="tcp://127.0.0.1:1")
    with pytest.raises(ConfigurationError, match="no scheduler answers"):
        list(scheduler(once, (0,), 1))


def test_a_scheduler_that_goes_away_is_reported_and_what_is_done_was_given() -> None:
    with cluster_of(1) as cluster:
        ended = DaskScheduler(address=cluster.scheduler_address)(once, (0, 1), 2)
        assert next(ended) == EndedTask(0, 0)
        with suppress(TimeoutError):
            cluster.close()
        with pytest.raises(ComputeClusterFault, match="--resume"):
            next(ended)


def test_a_cluster_without_workers_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tjscan.study.schedule.CLUSTER_TIMEOUT", 2.0)
    with (
        cluster_of(0) as cluster,
        pytest.raises(ComputeClusterFault, match="no worker has joined"),
    ):
        list(DaskScheduler(address=cluster.scheduler_address)(once, (0,), 1))


def test_workers_with_another_version_are_refused(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tjscan.study.schedule.program_code", lambda: "0.0.7")
    with pytest.raises(ComputeClusterFault, match=r"the study 0\.0\.7"):
        list(DaskScheduler(address=address)(once, (0,), 1))


@pytest.mark.parametrize("workers", [1, 2])
def test_a_killed_process_costs_its_own_task(workers: int) -> None:
    ended = list(DaskScheduler(workers)(double_or_die, [0, 1, 2, 3, 4, 5], 6))
    assert [e.task for e in ended if e.result is None] == [1]
    assert {e.task: e.result for e in ended if e.result is not None} == {
        0: 0,
        2: 4,
        3: 6,
        4: 8,
        5: 10,
    }


def test_a_worker_takes_one_thread() -> None:
    assert [e.result for e in DaskScheduler(1)(threads, [0], 1)] == ["1"]


def test_a_package_that_is_missing_is_named_with_its_extra(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    check_study_packages()
    monkeypatch.setattr("tjscan.study.schedule.STUDY_PACKAGES", ("distributed", "no_such_package"))
    with pytest.raises(ConfigurationError, match=r"no_such_package.*pip install 'tjscan\[study\]'"):
        check_study_packages()


def test_a_study_without_any_worker_left_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that is not started again must not be waited for without end."""

    class NoWorkers:
        def nthreads(self) -> dict[str, int]:
            return {}

        def submit(self, *call: Any, **options: Any) -> object:
            return object()

    def nothing_ends(*waiting: Any, **options: Any) -> Any:
        raise TimeoutError

    monkeypatch.setattr("distributed.wait", nothing_ends)
    with pytest.raises(ComputeClusterFault, match="no worker is left"):
        list(_run_tasks(NoWorkers(), once, (0,)))


def test_a_worker_of_another_program_that_joins_late_is_never_used() -> None:
    with cluster_of(0) as cluster, distributed.Client(cluster) as client:
        client.register_plugin(SameProgram("another program"))
        late = subprocess.Popen(
            [
                *(sys.executable, "-m", "distributed.cli.dask_worker"),
                *(cluster.scheduler_address, "--nthreads", "1", "--no-dashboard", "--no-nanny"),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        assert late.wait(60) is not None
        assert not client.nthreads()
