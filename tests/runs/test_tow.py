"""Tows by the command line, in a simulated world: whole, halted, interrupted, gone on with."""

import json
import signal
import tomllib
import warnings
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import pytest
import tomli_w

pytest.importorskip("mujoco")
pytest.importorskip("proxsuite")

from command import tjscan

from tjscan.job.tow.job import read_tow_job
from tjscan.runs.tow.results import outcome_of_tow, read_recorded_tow, read_tow_key_figures
from tjscan.towing.journal import TowCycle
from tjscan.towing.loop import CableTow
from tjscan.towing.shape.plan import PlanInputs, TowingPlan
from tjscan.towing.shape.planner import TowingPlanner

EXAMPLE = Path(__file__).parents[2] / "examples" / "tow-simulation.toml"
SHORT = (
    "--seam.points-mm",
    "[[2600, -300], [2600, -260]]",
    "--seam.speed-mm-min",
    "1200",
    "--following.patience-s",
    "1",
)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("runs") / "run"
    assert tjscan("tow", "run", EXAMPLE, *SHORT, "--out", directory) == 0
    return directory


def test_a_tow_leaves_its_recording_its_figures_and_a_report_that_loads_nothing(
    out: Path,
) -> None:
    figures = read_tow_key_figures(out)
    assert figures["complete"]
    assert figures["welded_mm"] == pytest.approx(40)
    assert figures["touches"] == 0
    assert figures["bend_deg"] < 44.2
    assert figures["constraint"] < 1e-6
    rows = [line for line in (out / "tow.csv").read_text().splitlines() if line[0] != "#"]
    assert len(rows) == 1 + len(read_recorded_tow(out).cycles)
    page = (out / "report.html").read_text()
    assert "<canvas" in page
    assert "://" not in page.replace("http://www.w3.org", "")


def test_a_tow_of_one_cycle_has_figures_without_a_mean_of_nothing(out: Path) -> None:
    found, job = read_recorded_tow(out), read_tow_job(out / "job.toml")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        outcome = outcome_of_tow(job, found.cycles[:1], found.truths[:1], (False, "stop", ""))
    assert outcome.followed_mm is None
    assert outcome.force_max_n


def test_a_dry_run_says_whether_the_seam_can_be_followed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert tjscan("tow", "run", EXAMPLE, *SHORT, "--dry-run", "--json") == 0
    assert json.loads(capsys.readouterr().out)["feasible"]
    far = ("--area.outline-mm", "[[0,-9000],[9000,-9000],[9000,9000],[0,9000]]")
    seam = ("--seam.points-mm", "[[2600, 5000], [2600, 6000]]")
    assert tjscan("tow", "run", EXAMPLE, *far, *seam, "--dry-run") == 2
    said = capsys.readouterr().err
    assert "seam.points_mm" in said
    assert "539 mm beyond the cable's length" in " ".join(said.split())


def test_a_wrong_job_is_refused_before_a_directory_is_made(tmp_path: Path) -> None:
    out = tmp_path / "run"
    wrong = ("--weights.bending", "-1", "--out", out)
    assert tjscan("tow", "run", EXAMPLE, *wrong) == 2
    assert not out.exists()


@pytest.mark.usefixtures("ctrl_c_is_heard")
def test_a_tow_that_was_interrupted_is_whole_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "cut"
    cycle = CableTow._run_cycle
    left = 15

    def interrupted(self: CableTow, *arguments: object) -> None:
        nonlocal left
        left -= 1
        if not left:
            signal.raise_signal(signal.SIGINT)
        cycle(self, *arguments)  # type: ignore[arg-type]

    with patch.object(CableTow, "_run_cycle", interrupted):
        assert tjscan("tow", "run", EXAMPLE, *SHORT, "--out", out) == 130
    job = (out / "job.toml").read_text()
    for table, key, other, said in (
        ("cable", "length_mm", 5900.0, "cable.length_mm"),
        ("seam", "points_mm", [[2600.0, -300.0], [2600.0, -299.0]], "seam.points_mm"),
        ("limits", "link_clearance_mm", 500.0, "can't follow"),
    ):
        edited = tomllib.loads(job)
        edited[table][key] = other
        (out / "job.toml").write_text(tomli_w.dumps(edited))
        assert tjscan("tow", "run", "--resume", out) == 2
        assert said in " ".join(capsys.readouterr().err.split())
    (out / "job.toml").write_text(job)
    cut = read_recorded_tow(out)
    assert (cut.events[-1].name, len(cut.cycles)) == ("stop", 14)
    assert (out / "report.html").is_file()
    assert tjscan("tow", "run", "--resume", out) == 0
    whole = read_recorded_tow(out)
    assert whole.complete
    assert whole.cycles[14].along > whole.cycles[13].along
    assert tjscan("tow", "run", "--resume", out) == 2


def test_a_replay_with_the_same_keys_plans_the_same(
    out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = tmp_path / "again"
    capsys.readouterr()
    assert tjscan("tow", "replay", out, "--out", again, "--json") == 0
    assert json.loads(capsys.readouterr().out)["figures"] == read_tow_key_figures(again)
    assert tjscan("tow", "replay", out, "--seam.speed-mm-min", "1", "--out", tmp_path / "no") == 2

    assert read_tow_key_figures(again)["complete"]
    apart = ("--limits.link-clearance-mm", "1000", "--out", tmp_path / "apart")
    assert tjscan("tow", "replay", out, *apart) == 0
    figures = read_tow_key_figures(tmp_path / "apart")
    assert (figures["halts"], figures["asked_mm_s"]) == (len(read_recorded_tow(out).cycles), 0)
    assert not figures["complete"]

    def angles(directory: Path) -> list[list[float]]:
        return [cycle.plan.angles.tolist() for cycle in read_recorded_tow(directory).cycles]

    for was, now in zip(angles(out), angles(again), strict=True):
        assert now == pytest.approx(was, abs=1e-6)
    assert tjscan("tow", "run", "--resume", again) == 2


def test_a_replay_waits_where_the_plan_now_leads_away(out: Path, tmp_path: Path) -> None:
    plan, away = TowingPlanner.plan, "too near to a crate"

    def plan_away(planner: TowingPlanner, inputs: PlanInputs) -> TowingPlan:
        return replace(plan(planner, inputs), retreat=away)

    with patch.object(TowingPlanner, "plan", plan_away):
        assert tjscan("tow", "replay", out, "--out", tmp_path / "away") == 0
    cycles = read_recorded_tow(tmp_path / "away").cycles
    assert {(cycle.wait, cycle.pace) for cycle in cycles} == {(away, 0.0)}


def test_a_jammed_welder_ends_the_tow_as_a_fault_of_a_device(tmp_path: Path) -> None:
    out = tmp_path / "jammed"
    fault = "[{kind = 'jam', vehicle = 6, at_s = 0.5}]"
    options = (*SHORT, "--simulation.faults", fault, "--out", out)
    assert tjscan("tow", "run", EXAMPLE, *options) == 4
    cycles: tuple[TowCycle, ...] = read_recorded_tow(out).cycles
    assert "the welder is stopped" in cycles[-1].wait
