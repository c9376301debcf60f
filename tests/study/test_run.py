"""Laws of a running study: the same table wherever it runs, and nothing lost on the way."""

import json
from collections.abc import Callable, Generator, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
import tomli_w
from cells import PAPER
from command import tjscan

from tjscan.core.version import program_code
from tjscan.runs.scan.study import ScanOutcome
from tjscan.runs.tasks import study_backend_of_task
from tjscan.study.plan import StudyPlan, plan_study
from tjscan.study.rows import STUDY_ROWS_FILE
from tjscan.study.run import make_study_directory, read_study, run_study, run_trial
from tjscan.study.schedule import DaskScheduler, EndedTask
from tjscan.study.trial import LOST_WORKER_REASON, StudyRow, Trial

STUDY = {
    "job": str(PAPER),
    "fixed": {"scan.sections": 4},
    "grid": {"scan.prediction_case": [1, 3]},
    # The last start sees no groove: a scan that fails.
    "together": [
        {
            "scan.step_mm": [40.0, 50.0, 40.0],
            "scan.second.position_mm": [
                [-49.0, 807.9, 363.1],
                [-49.0, 807.9, 363.1],
                [-49.0, 807.9, 463.1],
            ],
        }
    ],
}


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("study") / "study.toml"
    file.write_text(tomli_w.dumps(STUDY), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def trials(study: Path) -> StudyPlan:
    return plan_study(study, study_backend_of_task)


@pytest.fixture(scope="module")
def rows(trials: StudyPlan) -> tuple[StudyRow[Any], ...]:
    """What every run of the study shall give: made here, one after the other."""
    made = (run_trial(t, trials, study_backend_of_task, program_code()) for t in trials)
    return timeless(made)


class Here:
    """A scheduler that runs in this process, and stops after some trials as Ctrl-C would."""

    def __init__(self, stop_after: int | None = None) -> None:
        self.stop_after, self.made = stop_after, 0

    def __call__(
        self,
        work: Callable[[Trial], StudyRow[Any]],
        trials: Iterable[Trial],
        count: int,
    ) -> Generator[EndedTask[Trial, StudyRow[Any]]]:
        for trial in trials:
            if self.made == self.stop_after:
                raise KeyboardInterrupt
            self.made += 1
            yield EndedTask(trial, work(trial))


def ignore(row: StudyRow[Any]) -> None:
    """Watch nothing."""


def timeless(rows: Iterable[StudyRow[Any]]) -> tuple[StudyRow[Any], ...]:
    return tuple(replace(row, wall_s=0.0) for row in rows)


def test_a_failed_scan_is_a_row_with_its_reason(rows: tuple[StudyRow[Any], ...]) -> None:
    assert [row.outcome.complete for row in rows] == [True, True, False] * 2
    assert rows[2].outcome.reason == "StartSeesNoGroove"
    assert "second taught pose" in rows[2].outcome.detail


def test_a_row_comes_back_from_its_line(rows: tuple[StudyRow[Any], ...]) -> None:
    assert tuple(StudyRow.from_json_line(row.to_json_line(), ScanOutcome) for row in rows) == rows


def test_an_interrupted_study_goes_on_to_the_same_table(
    trials: StudyPlan, rows: tuple[StudyRow[Any], ...], tmp_path: Path
) -> None:
    make_study_directory(tmp_path / "s", trials)
    with pytest.raises(KeyboardInterrupt):
        run_study(tmp_path / "s", Here(stop_after=2), ignore, study_backend_of_task)
    assert len(pq.read_table(tmp_path / "s" / "study.parquet")) == 2
    # The machine lost power in the middle of a line.
    with (tmp_path / "s" / STUDY_ROWS_FILE).open("a") as file:
        # Lines that are rows in form alone are passed over, too.
        for key, value in (("index", "0"), ("inputs", None), ("wall_s", "long"), ("code", 1)):
            line = json.loads(rows[0].to_json_line()) | {key: value}
            file.write(json.dumps(line) + "\n")
        file.write(rows[3].to_json_line()[:50])
    rest = Here()
    assert timeless(run_study(tmp_path / "s", rest, ignore, study_backend_of_task)) == rows
    assert rest.made == len(rows) - 2
    _, kept = read_study(tmp_path / "s", study_backend_of_task)
    assert [row.key for row in kept] == [trial.hash_key for trial in trials]
    again = Here()
    assert timeless(run_study(tmp_path / "s", again, ignore, study_backend_of_task)) == rows
    assert again.made == 0


def test_processes_change_nothing(
    trials: StudyPlan, rows: tuple[StudyRow[Any], ...], tmp_path: Path
) -> None:
    make_study_directory(tmp_path / "s", trials)
    made = run_study(tmp_path / "s", DaskScheduler(2), ignore, study_backend_of_task)
    assert timeless(made) == rows


def test_a_lost_task_is_a_row_that_says_so(trials: StudyPlan, tmp_path: Path) -> None:
    def losing(
        work: object, trials: Iterable[Trial], count: int
    ) -> Generator[EndedTask[Trial, StudyRow[Any]]]:
        yield EndedTask(next(iter(trials)), None, "its process died")

    make_study_directory(tmp_path / "s", trials)
    (row,) = run_study(tmp_path / "s", losing, ignore, study_backend_of_task)
    assert not row.outcome.complete
    assert row.outcome.reason == LOST_WORKER_REASON
    assert "its process died" in (tmp_path / "s" / "report.md").read_text()


def test_the_command_writes_tables_pictures_and_a_report(study: Path, tmp_path: Path) -> None:
    out = tmp_path / "s"
    assert tjscan("study", study, "--out", out, "--workers", 1, pictures=True) == 0
    names = {file.name for file in out.iterdir()}
    assert names >= {"study.csv", "study.parquet", "report.md", "overview.png"}
    table = pq.read_table(out / "study.parquet")
    lines = (out / "study.csv").read_text().splitlines()
    assert lines[0].split(",") == table.column_names
    assert len(lines) == 1 + len(table) == 7
    assert "StartSeesNoGroove | 2" in (out / "report.md").read_text()
    assert tjscan("study", study, "--out", out) == 2  # never overwrites
    assert tjscan("study", "--resume", out) == 0
    assert tjscan("study", tmp_path / "nothing", "--resume") == 2


def test_a_dry_run_makes_nothing(study: Path, tmp_path: Path) -> None:
    assert tjscan("study", study, "--out", tmp_path / "s", "--dry-run") == 0
    assert not (tmp_path / "s").exists()
