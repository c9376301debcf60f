"""Laws of a study's grid: what it holds, in which order, and what it refuses."""

import json
import shutil
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from cells import CLOCKWISE, PAPER
from studies import ANY_JOINT, Expand, expand_in, resolved_of, settings_of

from tjscan.core.errors import ConfigurationError
from tjscan.core.units import DEG, MM
from tjscan.robot import models
from tjscan.study.plan import StudyPlan, read_plan


@pytest.fixture
def expand(tmp_path: Path) -> Expand:
    return expand_in(tmp_path)


def test_the_grid_is_the_product_and_the_last_key_runs_fastest(expand: Expand) -> None:
    trials = expand(
        job=[str(PAPER), str(CLOCKWISE)],
        seeds=2,
        grid={"scan.prediction_case": [1, 3], "scan": {"pull_angle_deg": [5.0, 10.0]}},
        together=[{"scan.step_mm": [20.0, 40.0, 60.0], "scan.sections": [30, 16, 11]}],
    )
    assert [trial.index for trial in trials] == list(range(2 * 2 * 2 * 3 * 2))
    assert [trial.inputs["simulation.seed"] for trial in trials[:4]] == [1, 2, 1, 2]
    assert [trial.inputs["scan.sections"] for trial in trials[:6]] == [30, 30, 16, 16, 11, 11]
    assert [trial.inputs["job"] for trial in trials] == ["paper"] * 24 + ["paper-clockwise"] * 24
    for trial in trials:
        scan = settings_of(trials, trial).job.scan
        assert MM.to_file(scan.step) == trial.inputs["scan.step_mm"]
        assert DEG.to_file(scan.pull_angle) == trial.inputs["scan.pull_angle_deg"]
        assert (scan.direction == "clockwise") == (trial.inputs["job"] == "paper-clockwise")


def test_a_study_expands_to_the_same_trials_each_time(expand: Expand, tmp_path: Path) -> None:
    tables: dict[str, Any] = {
        "job": str(ANY_JOINT),
        "seeds": 2,
        "fixed": {
            "scan.sections": 8,
            "rule": {"start_azimuth_deg": "any", "carry_base": True, "centre_view": True},
        },
        "grid": {"joint.brace.wall_mm": [16.0, 25.4]},
    }
    first, second = expand(**tables), expand(**tables)
    assert [trial.hash_key for trial in first] == [trial.hash_key for trial in second]
    assert len({trial.hash_key for trial in first}) == 4
    kept = tmp_path / "kept.json"
    kept.write_text(first.to_json(), encoding="utf-8")
    assert list(read_plan(kept)) == list(first)


@pytest.mark.parametrize(
    ("tables", "key", "words"),
    [
        ({"grid": {"scan.stepp_mm": [10.0]}}, "scan.stepp_mm", "step_mm"),
        ({"grid": {"scna.step_mm": [10.0]}}, "scna", "scan"),
        ({"grid": {"joint.brcae.wall_mm": [10.0]}}, "joint.brcae.wall_mm", "joint.brace"),
        ({"grid": {"joint.brace.wal_mm": [10.0]}}, "joint.brace.wal_mm", "wall_mm"),
        ({"grid": {"rule.leg_too_brace": [2.0]}}, "rule.leg_too_brace", "leg_to_brace"),
        ({"grid": {"scan.step_mm": 10.0}}, "scan.step_mm", "list"),
        ({"grid": {"scan.step_mm": []}}, "scan.step_mm", "list"),
        ({"grid": {"scan.step_mm": [10.0, "wide"]}}, "scan.step_mm", "wide"),
        ({"grid": {"scan.step_mm": [10.0, 4.0]}}, "scan.step_mm", "4.0"),
        ({"gird": {}}, "gird", "grid"),
        (
            {"grid": {"scan.step_mm": [1.0]}, "fixed": {"scan.step_mm": 1.0}},
            "scan.step_mm",
            "twice",
        ),
        ({"together": [{"scan.step_mm": [10.0, 20.0], "scan.sections": [3]}]}, None, "equally"),
        ({"fixed": {"joint.brace.outer_diameter_mm": 599.0}}, "joint.brace.outer", "too wide"),
        ({"fixed": {"rule.carry_base": True}}, "rule.start_azimuth_deg", "needed"),
        ({"job": "nowhere.toml"}, None, "no such file"),
    ],
)
def test_what_can_not_be_is_refused_by_key_before_anything_runs(
    expand: Expand, tables: dict[str, Any], key: str | None, words: str
) -> None:
    with pytest.raises(ConfigurationError) as refused:
        expand(**tables)
    assert words in str(refused.value)
    assert key is None or (refused.value.key or "").startswith(key)
    assert refused.value.file is not None
    # Who swept the key has to mend it: the job that it replaces is not to blame.
    assert refused.value.file.name == tables.get("job", "study.toml")


@pytest.mark.parametrize(("task", "words"), [("scam", "scan"), ("calibrate", "brings no study")])
def test_only_a_task_that_brings_studies_can_be_studied(
    expand: Expand, task: str, words: str
) -> None:
    with pytest.raises(ConfigurationError, match=words):
        expand(task=task)


def job_in(folder: Path, name: str = "paper.toml", arm: str = "ur10e") -> Path:
    """The example and its joint, copied to a folder, with an arm."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(PAPER.parents[1] / "cad" / "tjoint-600x457.toml", folder)
    file = folder / name
    text = PAPER.read_text(encoding="utf-8").replace('model = "ur10e"', f'model = "{arm}"')
    file.write_text(text.replace("../cad/", ""), encoding="utf-8")
    return file


def test_an_arm_of_ones_own_goes_with_the_plan(expand: Expand, tmp_path: Path) -> None:
    job = job_in(tmp_path / "cell", arm="my.urdf")
    urdf = job.with_name("my.urdf")
    text = (files(models) / "ur10e.urdf").read_text(encoding="utf-8")
    urdf.write_text(text, encoding="utf-8")
    plan = expand(job=str(job), fixed={"scan.sections": 4})
    urdf.unlink()
    assert resolved_of(plan, plan[0]).settings
    urdf.write_text(text.replace("<cylinder", "<mesh/><cylinder"), encoding="utf-8")
    with pytest.raises(ConfigurationError, match="absolute path"):
        expand(job=str(job), fixed={"scan.sections": 4})


@pytest.mark.parametrize("by_study", [False, True])
def test_a_file_that_is_named_by_its_absolute_path_goes_with_the_plan(
    expand: Expand, tmp_path: Path, *, by_study: bool
) -> None:
    job = job_in(tmp_path / "cell")
    joint = (tmp_path / "elsewhere" / "joint.toml").absolute()
    joint.parent.mkdir()
    (job.parent / "tjoint-600x457.toml").rename(joint)
    fixed: dict[str, object] = {"scan.sections": 4}
    if by_study:
        fixed["joint.file"] = str(joint)
    else:
        text = job.read_text(encoding="utf-8").replace("tjoint-600x457.toml", str(joint))
        job.write_text(text, encoding="utf-8")
    plan = expand(job=str(job), fixed=fixed)
    joint.unlink()
    assert resolved_of(plan, plan[0]).settings


def test_jobs_of_one_name_are_told_apart_by_their_folders(expand: Expand, tmp_path: Path) -> None:
    jobs = [str(job_in(tmp_path / name)) for name in ("left", "right")]
    plan = expand(job=jobs, fixed={"scan.sections": 4})
    assert [trial.inputs["job"] for trial in plan] == ["left/paper", "right/paper"]
    with pytest.raises(ConfigurationError, match="twice"):
        expand(job=[*jobs, jobs[0]])


@pytest.mark.parametrize("name", ["../outside.txt", "/tmp/outside.txt", "a/../../outside.txt"])
def test_a_plan_that_would_write_outside_of_its_folder_is_refused(
    expand: Expand, tmp_path: Path, name: str
) -> None:
    plan = expand(fixed={"scan.sections": 4})
    kept = tmp_path / "kept.json"
    hostile = StudyPlan(plan.study, plan.seed_key, plan.jobs, {**plan.files, name: "x"})
    kept.write_text(hostile.to_json(), encoding="utf-8")
    with pytest.raises(ConfigurationError, match="outside of its folder"):
        read_plan(kept)
    kept.write_text(json.dumps({"study": {}, "runs": []}), encoding="utf-8")
    with pytest.raises(ConfigurationError, match="begin the study again"):
        read_plan(kept)
