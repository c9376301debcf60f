"""Laws of a running study: the same table wherever it runs, and nothing lost on the way."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import tomli_w
from cells import PAPER
from command import tjscan
from matplotlib.colors import to_rgba
from study_work import double_or_die, threads

from tjscan.runs.context import RunContext
from tjscan.runs.scan import run_scan
from tjscan.study.figures import COLOURS, OTHER, draw_effort
from tjscan.study.file import read_study
from tjscan.study.grid import tasks_of
from tjscan.study.local import LocalScheduler
from tjscan.study.one import run_task
from tjscan.study.paper import CASE, STEP
from tjscan.study.row import LOST_WORKER, Measured, Row
from tjscan.study.run import run_study
from tjscan.study.schedule import Done, Lost
from tjscan.study.store import ROWS, make_study, read_rows
from tjscan.study.task import Task

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
def tasks(study: Path) -> tuple[Task, ...]:
    return tasks_of(read_study(study), study)


@pytest.fixture(scope="module")
def rows(tasks: tuple[Task, ...]) -> tuple[Row, ...]:
    """What every run of the study shall give: made here, one after the other."""
    return tuple(run_task(task).timeless for task in tasks)


class Here:
    """A scheduler that runs in this process, and stops after some tasks as Ctrl-C would."""

    def __init__(self, stop_after: int | None = None) -> None:
        self.stop_after, self.made = stop_after, 0

    def __call__(self, work: object, tasks: object) -> Iterator[Done[Task, Row]]:
        assert callable(work)
        assert isinstance(tasks, list)
        for task in tasks:
            if self.made == self.stop_after:
                raise KeyboardInterrupt
            self.made += 1
            yield Done(task, work(task))


def ignore(row: Row) -> None:
    """Watch nothing."""


def timeless(rows: tuple[Row, ...]) -> tuple[Row, ...]:
    return tuple(row.timeless for row in rows)


def test_a_failed_scan_is_a_row_with_its_reason(rows: tuple[Row, ...]) -> None:
    assert [row.measured.complete for row in rows] == [True, True, False] * 2
    assert rows[2].measured.reason == "StartSeesNoGroove"
    assert "second taught pose" in rows[2].measured.detail


def test_a_row_comes_back_from_its_line(rows: tuple[Row, ...]) -> None:
    assert tuple(Row.from_json(row.to_json()) for row in rows) == rows


def test_a_study_keeps_what_a_recorded_scan_would_say(
    tasks: tuple[Task, ...], rows: tuple[Row, ...], tmp_path: Path
) -> None:
    job = tasks[0].job_file
    summary = run_scan(RunContext(job, PAPER), tmp_path / "run")
    measured = rows[0].measured
    assert summary.step_mm.mean == measured.step_mean_mm
    assert summary.flange_travel_mm == measured.travel_mm
    assert summary.motion_time_s == measured.motion_time_s
    assert summary.scans == measured.scans
    assert summary.corner_error_mm is not None
    # The same points, carried into frame j by another product of the same poses.
    assert summary.corner_error_mm.mean == pytest.approx(measured.corner_mean_mm, rel=1e-9)


def test_travel_is_that_of_predictions_and_corrections(rows: tuple[Row, ...]) -> None:
    measured = rows[0].measured
    assert measured.travel_prediction_mm is not None
    assert measured.travel_correction_mm is not None
    both = measured.travel_prediction_mm + measured.travel_correction_mm
    assert both == pytest.approx(measured.travel_mm, rel=1e-12)
    assert len(rows[0].path) == measured.scans


def test_an_interrupted_study_goes_on_to_the_same_table(
    tasks: tuple[Task, ...], rows: tuple[Row, ...], tmp_path: Path
) -> None:
    make_study(tmp_path / "s", tasks)
    with pytest.raises(KeyboardInterrupt):
        run_study(tmp_path / "s", Here(stop_after=2), ignore)
    assert len(pq.read_table(tmp_path / "s" / "study.parquet")) == 2
    # The machine lost power in the middle of a line.
    with (tmp_path / "s" / ROWS).open("a") as file:
        file.write(rows[3].to_json()[:50])
    rest = Here()
    assert timeless(run_study(tmp_path / "s", rest, ignore)) == rows
    assert rest.made == len(rows) - 2
    assert set(read_rows(tmp_path / "s", tasks)) == {task.key for task in tasks}
    again = Here()
    assert timeless(run_study(tmp_path / "s", again, ignore)) == rows
    assert again.made == 0


@pytest.mark.parametrize("workers", [1, 2])
def test_processes_change_nothing(
    workers: int, tasks: tuple[Task, ...], rows: tuple[Row, ...], tmp_path: Path
) -> None:
    make_study(tmp_path / "s", tasks)
    assert timeless(run_study(tmp_path / "s", LocalScheduler(workers), ignore)) == rows


@pytest.mark.parametrize("workers", [1, 2])
def test_a_killed_process_costs_its_own_task(workers: int) -> None:
    ended = list(LocalScheduler(workers)(double_or_die, [0, 1, 2, 3, 4, 5]))
    assert [e.task for e in ended if isinstance(e, Lost)] == [1]
    assert {e.task: e.result for e in ended if isinstance(e, Done)} == {
        0: 0,
        2: 4,
        3: 6,
        4: 8,
        5: 10,
    }


def test_a_lost_task_is_a_row_that_says_so(tasks: tuple[Task, ...], tmp_path: Path) -> None:
    def losing(work: object, tasks: object) -> Iterator[Lost[Task]]:
        assert isinstance(tasks, list)
        yield from (Lost(task, "its process died") for task in tasks)

    make_study(tmp_path / "s", tasks[:1])
    (row,) = run_study(tmp_path / "s", losing, ignore)
    assert not row.measured.complete
    assert row.measured.reason == LOST_WORKER
    assert "its process died" in (tmp_path / "s" / "report.md").read_text()


def test_a_worker_takes_one_thread() -> None:
    assert [e.result for e in LocalScheduler(1)(threads, [0]) if isinstance(e, Done)] == ["1"]


def test_the_command_writes_tables_pictures_and_a_report(study: Path, tmp_path: Path) -> None:
    out = tmp_path / "s"
    assert tjscan("study", study, "--out", out, "--workers", 1) == 0
    names = {file.name for file in out.iterdir()}
    assert names >= {"study.csv", "study.parquet", "report.md", "steps.png", "effort.png"}
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


def test_a_prediction_keeps_its_colour_and_what_is_not_complete_is_marked(
    rows: tuple[Row, ...],
) -> None:
    template = next(row for row in rows if row.measured.complete)
    shown = [
        replace(template, inputs={CASE: case, STEP: 20.0}) for case in (3, "smooth", "another")
    ]
    shown[1] = replace(shown[1], measured=Measured(False, "lost", "lost"))
    axes = draw_effort(shown).axes[0]
    assert {bar.get_facecolor() for bar in axes.patches} >= {to_rgba(COLOURS[3]), to_rgba(OTHER)}
    crosses = [line for line in axes.lines if line.get_marker() == "x"]
    assert [line.get_color() for line in crosses] == [COLOURS["smooth"]]
    legend = axes.get_legend()
    assert legend is not None
    words = [text.get_text() for text in legend.get_texts()]
    assert {"case 3", "smooth", "no complete scan"} <= set(words)
