"""Start poses that a study teaches: near the ideal ones, a step apart, others for every joint."""

from pathlib import Path

import numpy as np
import pytest
from studies import ANY_JOINT, Expand, expand_in, resolved_of, settings_of

from tjscan.core.frames import rotation_angle_between
from tjscan.runs.scan.ideal_views import azimuth_further_along, ideal_sensor_pose


@pytest.fixture
def expand(tmp_path: Path) -> Expand:
    return expand_in(tmp_path)


@pytest.mark.parametrize("direction", ["counterclockwise", "clockwise"])
def test_two_views_are_taught_a_step_apart(expand: Expand, direction: str) -> None:
    trials = expand(
        job=str(ANY_JOINT),
        fixed={
            "scan.direction": direction,
            "scan.sections": 8,
            "rule": {
                "start_azimuth_deg": 40.0,
                "carry_base": True,
                "hand_mm": 3.0,
                "hand_deg": 5.0,
            },
        },
    )
    settings = settings_of(trials, trials[0])
    job, joint = settings.job, settings.joint.definition("joint")
    plan, first, second = job.scan, *(start.T for start in job.start_poses)
    assert job.joint is not None
    assert job.calibration.T_f_s is not None
    T_j_b = np.linalg.inv(job.joint.T_w_j)
    azimuths = (
        np.radians(40.0),
        azimuth_further_along(joint, np.radians(40.0), plan.step, plan.direction),
    )
    for T_b_f, azimuth in zip((first, second), azimuths, strict=True):
        T_j_s, ideal = (
            T_j_b @ T_b_f @ job.calibration.T_f_s,
            ideal_sensor_pose(joint, azimuth, plan),
        )
        T_s_t = plan.target_pose_in_sensor(
            0.0
        )  # any frame in the groove: its origin is what the operator sees
        off = (T_j_s @ T_s_t)[:3, 3] - (ideal @ T_s_t)[:3, 3]
        # Uniform on each of three axes: the corner of the cube is the furthest.
        assert np.linalg.norm(off) < np.sqrt(3) * 3e-3
        assert rotation_angle_between(T_j_s, ideal) < np.radians(np.sqrt(3) * 5.0)
    assert abs(azimuth_further_along(joint, azimuths[1], 0.0, plan.direction) - azimuths[1]) < 1e-9


def test_other_joints_are_taught_with_other_errors(expand: Expand) -> None:
    trials = expand(
        job=str(ANY_JOINT),
        fixed={"rule": {"start_azimuth_deg": "any"}},
        grid={"joint.brace.wall_mm": [16.0, 25.4]},
    )
    followed = [resolved_of(trials, trial).followed for trial in trials]
    assert len({one["rule.start_azimuth_deg"] for one in followed}) == 2
