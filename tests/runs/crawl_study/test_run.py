"""A study of crawls keeps what a recorded crawl says, and why one was stopped."""

from pathlib import Path

import pytest
import tomli_w
from cells import PAPER

from tjscan.core.errors import ConfigurationError
from tjscan.core.version import program_code
from tjscan.crawler.pass_record import root_mean_square
from tjscan.job.crawl.job import read_crawl_job
from tjscan.runs.crawl.results import read_recorded_crawl
from tjscan.runs.crawl.run import CrawlContext, run_crawl
from tjscan.runs.crawl.study import CrawlOutcome
from tjscan.runs.tasks import study_backend_of_task
from tjscan.study.plan import StudyPlan, plan_study
from tjscan.study.report import write_study_report
from tjscan.study.run import run_trial
from tjscan.study.trial import StudyRow

EXAMPLE = PAPER.parent / "crawl-study.toml"

JOB = """
[alignment]
speed_mm_s = 90
return_speed_mm_s = 90
length_mm = 50
longest_mm = 60
offset_mm = 20
offset_sigma_mm = 20
in_view_s = 0.1
[guards]
torch_sigma_mm = 20
[weld]
length_m = 0.02
run_up_mm = 0
[[pass]]
speed_mm_s = 40
[simulation]
arc_points_percent = 0
[simulation.vehicle]
start_mm = [0.0, 1.0]
"""


def trials_in(folder: Path, **tables: object) -> StudyPlan:
    (folder / "tiny.toml").write_text(JOB)
    file = folder / "study.toml"
    file.write_text(tomli_w.dumps({"task": "crawl", "job": "tiny.toml", **tables}))
    return plan_study(file, study_backend_of_task)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module")
def rows(folder: Path) -> tuple[StudyRow[CrawlOutcome], ...]:
    """Of both methods, and of a crawl whose joint leaves the field at once."""
    trials = trials_in(
        folder,
        together=[
            {
                "method": ["paper", "slip-aware", "slip-aware"],
                "guards.field_mm": [22.0, 22.0, 0.1],
            }
        ],
    )
    code = program_code()
    return tuple(run_trial(trial, trials, study_backend_of_task, code) for trial in trials)


def test_a_study_keeps_what_a_recorded_crawl_says(
    folder: Path,
    rows: tuple[StudyRow[CrawlOutcome], ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tjscan.crawler.journal.CYCLES_PER_TRUTH", 1)
    file = folder / "tiny.toml"
    run_crawl(CrawlContext(read_crawl_job(file), file), tmp_path / "run")
    (recorded,) = read_recorded_crawl(tmp_path / "run").passes
    found = rows[1].outcome
    assert found.complete
    assert found.passes == 1
    assert found.sigma_mm == 1e3 * root_mean_square(recorded.sigma)
    assert found.read_percent == 100 * recorded.read_share
    # Where the arc goes out the recording holds the truth of the last cycle once more.
    nearly = 1.5 / len(recorded.travel)
    assert found.torch_rms_mm == pytest.approx(
        1e3 * root_mean_square(recorded.true_deviation), rel=nearly
    )
    assert found.error_rms_mm == pytest.approx(
        1e3 * root_mean_square(recorded.offset_error), rel=nearly
    )


def test_each_method_estimates_otherwise(rows: tuple[StudyRow[CrawlOutcome], ...]) -> None:
    paper, ours = rows[0].outcome, rows[1].outcome
    assert paper.complete
    assert paper.torch_rms_mm != ours.torch_rms_mm


def test_a_stopped_crawl_is_a_row_with_its_guard(
    rows: tuple[StudyRow[CrawlOutcome], ...],
) -> None:
    stopped = rows[2].outcome
    assert not stopped.complete
    assert stopped.reason == "joint at the edge"
    assert stopped.torch_rms_mm is None


def test_the_report_shows_the_methods_beside_each_other(
    rows: tuple[StudyRow[CrawlOutcome], ...], tmp_path: Path
) -> None:
    write_study_report(tmp_path, study_backend_of_task("crawl"), rows, planned=3)
    lines = (tmp_path / "report.md").read_text().splitlines()
    (head,) = (n for n, line in enumerate(lines) if line.startswith("| torch off its path, rms"))
    assert lines[head].endswith("| paper | slip-aware |")
    means = [f"{row.outcome.torch_rms_mm:.2f}" for row in rows[:2]]
    assert lines[head + 2] == f"| all | {means[0]} (1 of 1) | {means[1]} (1 of 2) |"
    assert (tmp_path / "overview.png").exists()


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("weld.lenght_m", 1.0, "length_m"),
        ("calibration", "calibration.toml", "leave this key out"),
        ("vehicle.driver", "mqtt", "simulates"),
        ("course.radius_m", 3.0, "turns no tighter"),
    ],
)
def test_what_can_not_be_is_refused_before_anything_runs(
    tmp_path: Path, key: str, value: object, words: str
) -> None:
    with pytest.raises(ConfigurationError, match=words) as refused:
        trials_in(tmp_path, fixed={key: value})
    assert refused.value.file is not None
    assert refused.value.file.name == "study.toml"


def test_the_example_is_sound() -> None:
    trials = plan_study(EXAMPLE, study_backend_of_task)
    assert {trial.inputs["method"] for trial in trials} == {"paper", "slip-aware"}
    assert len({trial.hash_key for trial in trials}) == len(trials)
