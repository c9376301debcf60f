"""Laws of a study's grid: what it holds, in which order, and what it refuses."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from cells import CLOCKWISE, PAPER

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import rotation_angle
from tjscan.core.units import DEG, MM
from tjscan.study.file import read_study
from tjscan.study.grid import tasks_of
from tjscan.study.task import Task
from tjscan.study.teaching import further, ideal_view

ANY_JOINT = PAPER.parent / "any-joint.toml"
Expand = Callable[..., tuple[Task, ...]]


@pytest.fixture
def expand(tmp_path: Path) -> Expand:
    """Tasks of a study that is written to a file first."""

    def tasks(**tables: Any) -> tuple[Task, ...]:
        file = tmp_path / "study.toml"
        file.write_text(tomli_w.dumps({"job": str(PAPER), **tables}), encoding="utf-8")
        return tasks_of(read_study(file), file)

    return tasks


def test_the_grid_is_the_product_and_the_last_key_runs_fastest(expand: Expand) -> None:
    tasks = expand(
        job=[str(PAPER), str(CLOCKWISE)],
        seeds=2,
        grid={"scan.prediction_case": [1, 3], "scan": {"pull_angle_deg": [5.0, 10.0]}},
        together=[{"scan.step_mm": [20.0, 40.0, 60.0], "scan.sections": [30, 16, 11]}],
    )
    assert [task.index for task in tasks] == list(range(2 * 2 * 2 * 3 * 2))
    assert [task.inputs["simulation.seed"] for task in tasks[:4]] == [1, 2, 1, 2]
    assert [task.inputs["scan.sections"] for task in tasks[:6]] == [30, 30, 16, 16, 11, 11]
    assert [task.inputs["job"] for task in tasks] == ["paper"] * 24 + ["paper-clockwise"] * 24
    for task in tasks:
        scan = task.job_file.scan
        assert MM.to_file(scan.step) == task.inputs["scan.step_mm"]
        assert DEG.to_file(scan.pull_angle) == task.inputs["scan.pull_angle_deg"]
        assert (scan.direction == "clockwise") == (task.inputs["job"] == "paper-clockwise")


def test_a_study_expands_to_the_same_tasks_each_time(expand: Expand) -> None:
    tables: dict[str, Any] = {
        "job": str(ANY_JOINT),
        "seeds": 2,
        "fixed": {"rule": {"start_azimuth_deg": "any", "carry_base": True, "centre_view": True}},
        "grid": {"joint.brace.wall_mm": [16.0, 25.4]},
    }
    first, second = expand(**tables), expand(**tables)
    assert [task.key for task in first] == [task.key for task in second]
    assert len({task.key for task in first}) == 4
    assert [Task.from_json(task.to_json()).key for task in first] == [task.key for task in first]


def test_a_joint_can_be_varied_and_ruled(expand: Expand) -> None:
    tasks = expand(
        fixed={"rule.room_mm": 100.0, "rule.step_to_brace": 0.1},
        grid={"joint.brace.outer_diameter_mm": [168.3, 610.0], "rule.leg_to_brace": [1.05, 3.0]},
    )
    for task in tasks:
        joint = task.joint_definition
        ratio = task.inputs["rule.leg_to_brace"]
        assert joint.leg_radius / joint.brace_radius == pytest.approx(ratio, rel=1e-12)
        assert task.inputs["scan.step_mm"] == pytest.approx(200 * joint.brace_radius, abs=0.05)
        assert MM.to_file(task.job_file.scan.step) == task.inputs["scan.step_mm"]


@pytest.mark.parametrize("direction", ["counterclockwise", "clockwise"])
def test_a_hand_teaches_two_views_a_step_apart(expand: Expand, direction: str) -> None:
    (task,) = expand(
        job=str(ANY_JOINT),
        fixed={
            "scan.direction": direction,
            "rule": {
                "start_azimuth_deg": 40.0,
                "carry_base": True,
                "hand_mm": 3.0,
                "hand_deg": 5.0,
            },
        },
    )
    job, joint = task.job_file, task.joint_definition
    plan, first, second = job.scan, *(start.T for start in job.starts)
    assert job.joint is not None
    assert job.calibration.T_f_s is not None
    T_j_b = np.linalg.inv(job.joint.T_w_j)
    azimuths = (np.radians(40.0), further(joint, np.radians(40.0), plan.step, plan.direction))
    for T_b_f, azimuth in zip((first, second), azimuths, strict=True):
        T_j_s, ideal = T_j_b @ T_b_f @ job.calibration.T_f_s, ideal_view(joint, azimuth, plan)
        T_s_t = plan.target(0.0)  # any frame in the groove: its origin is what a hand sees
        off = (T_j_s @ T_s_t)[:3, 3] - (ideal @ T_s_t)[:3, 3]
        # Uniform on each of three axes: the corner of the cube is the furthest.
        assert np.linalg.norm(off) < np.sqrt(3) * 3e-3
        assert rotation_angle(T_j_s, ideal) < np.radians(np.sqrt(3) * 5.0)
    assert abs(further(joint, azimuths[1], 0.0, plan.direction) - azimuths[1]) < 1e-9


def test_other_joints_are_taught_by_other_hands(expand: Expand) -> None:
    tasks = expand(
        job=str(ANY_JOINT),
        fixed={"rule": {"start_azimuth_deg": "any"}},
        grid={"joint.brace.wall_mm": [16.0, 25.4]},
    )
    assert len({task.inputs["rule.start_azimuth_deg"] for task in tasks}) == 2


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
