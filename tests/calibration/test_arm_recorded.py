"""The arm's calibration from files: profiles, poses and joint angles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tomli_w
from ball_views import CENTRE_B, NOISE, RADIUS, T_F_S, kinematics, postures
from command import tjscan
from scipy.spatial.transform import Rotation

from tjscan.calibration.file import read_calibration
from tjscan.core.frames import Array, inverse_pose, pose, transform_points
from tjscan.robot.deviations import deviate_joint_frames
from tjscan.robot.settings import PlacementTolerance

POSES = 30


def write(folder: Path, q_stated: Array | None = None) -> tuple[Path, Path]:
    """Arcs of a ball seen by an arm that deviates, its poses as its model has them."""
    rng = np.random.default_rng(2)
    deviations = PlacementTolerance().sigmas * rng.standard_normal((6, 6))
    true, q = deviate_joint_frames(kinematics(), deviations), postures(POSES, rng)
    lines, poses = (
        ["profile,x_mm,z_mm"],
        ["x_mm,y_mm,z_mm,qx,qy,qz,qw,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg"],
    )
    stated = q if q_stated is None else q_stated
    for k, angles in enumerate(q, start=1):
        step = rng.standard_normal(6) * np.repeat((NOISE.position, NOISE.rotation), 3)
        T = true.forward(angles)
        turn = Rotation.from_rotvec(step[3:]).as_matrix()
        T_b_s = pose(turn @ T[:3, :3], T[:3, 3] + step[:3]) @ T_F_S
        x, y, z = transform_points(inverse_pose(T_b_s), CENTRE_B)
        radius = np.sqrt(RADIUS**2 - y**2)
        for angle in np.radians(np.linspace(-70, 70, 80)):
            seen = z - radius * np.cos(angle) + 2e-5 * rng.standard_normal()
            lines.append(f"{k},{1e3 * (x + radius * np.sin(angle)):.5f},{1e3 * seen:.5f}")
        T_b_f = kinematics().forward(angles)
        numbers = (
            *(1e3 * T_b_f[:3, 3]),
            *Rotation.from_matrix(T_b_f[:3, :3]).as_quat(),
            *np.degrees(stated[k - 1]),
        )
        poses.append(",".join(f"{number:.9f}" for number in numbers))
    files = folder / "lines.csv", folder / "poses.csv"
    for file, rows in zip(files, (lines, poses), strict=True):
        file.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return files


def write_job(folder: Path, files: tuple[Path, Path]) -> Path:
    """A job that calibrates the arm from the files of a ball."""
    profiles, poses = files
    job = {
        "solve": {"calibrate_arm": True},
        "arm": {"id": "ur10e", "model": "ur10e"},
        "laser": {"id": "simulated"},
        "noise": {"position_mm": 0.03, "rotation_deg": 0.0034, "correlation_columns": 0.0},
        "recorded": [{"profiles": profiles.name, "poses": poses.name, "target": "ball"}],
    }
    file = folder / "job.toml"
    file.write_text(tomli_w.dumps(job), encoding="utf-8")
    return file


def test_joint_angles_beside_the_poses_calibrate_the_arm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = write_job(tmp_path, write(tmp_path))
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "6 profiles that took no part" in told
    assert "joint 1: length x" in told
    found = read_calibration(tmp_path / "run" / "calibration.toml").kinematics
    assert found is not None
    assert found.held_out_poses == 6
    assert 2 * found.held_out_after_mm < found.held_out_before_mm
    assert found.held_out_after_mm < 0.12


def test_joint_angles_of_other_poses_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(9)
    job = write_job(tmp_path, write(tmp_path, postures(POSES, rng)))
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == 2
    assert "they belong to another pose" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "run" / "calibration.toml").exists()
