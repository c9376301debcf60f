"""A study on a cluster of two processes gives what it gives anywhere."""

import warnings
from collections.abc import Iterator

import pytest

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of other people's imports
    distributed = pytest.importorskip("distributed")

from cells import PAPER
from study_work import once

from tjscan.core.errors import ClusterFault, ConfigurationError
from tjscan.study.cluster import ClusterScheduler
from tjscan.study.file import StudyFile
from tjscan.study.grid import tasks_of
from tjscan.study.local import LocalScheduler
from tjscan.study.one import run_task
from tjscan.study.row import Row
from tjscan.study.schedule import Done
from tjscan.study.task import Task


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
    )
    with cluster:
        yield cluster.scheduler_address


def made(scheduler: ClusterScheduler | LocalScheduler, tasks: tuple[Task, ...]) -> list[Row]:
    rows = [e.result.timeless for e in scheduler(run_task, tasks) if isinstance(e, Done)]
    return sorted(rows, key=lambda row: row.index)


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_gives_the_same_rows_to_the_last_digit(address: str) -> None:
    study = StudyFile(
        job=PAPER.name, fixed={"scan.sections": 4}, grid={"scan.step_mm": [30.0, 40.0, 50.0]}
    )
    tasks = tasks_of(study, PAPER)
    rows = made(ClusterScheduler(address), tasks)
    assert len(rows) == 3
    assert rows == made(LocalScheduler(1), tasks)


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_is_not_there_is_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tjscan.study.cluster.PATIENCE", 0.5)
    scheduler = ClusterScheduler("tcp://127.0.0.1:1")
    with pytest.raises(ConfigurationError, match="no scheduler answers"):
        list(scheduler(run_task, ()))


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_goes_away_is_told_of_and_what_is_done_was_given() -> None:
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
    )
    with cluster:
        ended = ClusterScheduler(cluster.scheduler_address)(once, (0, 1))
        assert next(ended) == Done(0, 0)
        cluster.close(timeout=5)
        with pytest.raises(ClusterFault, match="--resume"):
            next(ended)


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_without_workers_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tjscan.study.cluster.PATIENCE", 2.0)
    with (
        distributed.LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=None) as cluster,
        pytest.raises(ClusterFault, match="no worker has joined"),
    ):
        list(ClusterScheduler(cluster.scheduler_address)(once, (0,)))


@pytest.mark.filterwarnings("ignore")
def test_workers_with_another_version_are_refused(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tjscan.study.cluster.VERSION", "0.0.7")
    with pytest.raises(ClusterFault, match=r"this machine 0\.0\.7"):
        list(ClusterScheduler(address)(once, (0,)))
