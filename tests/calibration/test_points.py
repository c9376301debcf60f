"""An arm calibrated from points on its flange, as a tracker or a touched artefact has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ball_views import T_F_S, observe, postures
from ball_views import kinematics as ur10e
from command import tjscan

from tjscan.calibration.arm.calibrate import ArmModel, TargetInPostures, calibrate_arm
from tjscan.calibration.file import read_calibration
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets.point import PointModel, start_of_points
from tjscan.core.frames import Array, inverse_pose, pose, transform_points
from tjscan.core.pose_vector import boxminus, boxplus, rotation_from_vector
from tjscan.robot.deviations import deviate_joint_frames
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance

TOLERANCE = PlacementTolerance()
TRACKER = NoiseModel(position=1e-7, rotation=1e-7, touch=4e-6)
P_F = np.array((0.06, -0.11, 0.14))
"""Of the reflector."""
T_B_T = pose(rotation_from_vector((0.3, -0.2, 2.1)), (2.1, -1.4, 0.6))


def true_arm(arm: Kinematics, seed: int) -> Kinematics:
    deviations = np.random.default_rng(seed).standard_normal((len(arm.lower), 6))
    return deviate_joint_frames(arm, TOLERANCE.sigmas * deviations)


def tracked(true: Kinematics, q: Array, rng: np.random.Generator) -> Array:
    """The reflector in the tracker's frame, shape (n, 3)."""
    points_b = np.array([transform_points(true.forward(one), P_F) for one in q])
    points_t = transform_points(inverse_pose(T_B_T), points_b)
    return points_t + TRACKER.touch * rng.standard_normal(points_t.shape)


def anywhere(arm: Kinematics, count: int, rng: np.random.Generator) -> Array:
    return rng.uniform(np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi), (count, 6))


def points_on(arm: Kinematics, seed: int, count: int) -> TargetInPostures:
    rng = np.random.default_rng(seed)
    q = anywhere(arm, count, rng)
    T_b_f = np.array([arm.forward(one) for one in q])
    model, start = start_of_points(tracked(true_arm(arm, seed), q, rng), T_b_f, TRACKER)
    return TargetInPostures(model, q, T_b_f, start)


@pytest.mark.parametrize("model", ["ur10e", "ur16e"])
def test_an_arm_on_a_tracker_is_off_by_the_tracker_where_it_was_not_calibrated(model: str) -> None:
    """The bar of a calibration from points: 0.085 mm; and its residuals are as stated."""
    arm, seed = Kinematics.load(model), 7
    seen = points_on(arm, seed, 300)
    held_out = np.arange(300) % 5 == 2
    found = calibrate_arm(ArmModel(arm, (seen,)), held_out, TOLERANCE, np.eye(4))
    assert found.error_after < 0.085e-3 < found.error_before
    assert found.error_after == pytest.approx(np.sqrt(3) * TRACKER.touch, rel=0.3)
    assert found.estimate.is_plausible
    assert not (~found.estimate.used & ~held_out).any()
    # Fresh postures, by the true arm: the calibrated one has the reflector where it is.
    q = anywhere(arm, 100, np.random.default_rng(seed + 1))
    calibrated = deviate_joint_frames(arm, found.estimate.deviations)
    assert isinstance(seen.model, PointModel)
    p_f, T_b_t = (
        found.estimate.target[6:],
        boxplus(seen.model.T_b_t, np.array(found.estimate.target[:6])),
    )
    there = [transform_points(calibrated.forward(one), p_f) for one in q]
    true = transform_points(
        T_b_t @ inverse_pose(T_B_T),
        np.array([transform_points(true_arm(arm, seed).forward(one), P_F) for one in q]),
    )
    assert np.sqrt(np.mean(np.sum((there - true) ** 2, axis=1))) < 2 * TRACKER.touch


def test_the_stated_uncertainty_of_fresh_points_is_true() -> None:
    """Of held-out points: squared errors over their stated variances, one each."""
    arm, squared = ur10e(), []
    for seed in (1, 2, 3):
        held_out = np.arange(120) % 4 == 1
        model = ArmModel(arm, (points_on(arm, seed, 120),))
        estimate = calibrate_arm(model, held_out, TOLERANCE, np.eye(4)).estimate
        for k in np.flatnonzero(held_out):
            own = estimate.stacked.profile == k
            J = estimate.stacked.jacobian[own]
            C = estimate.stacked.covariance[np.ix_(own, own)]
            r, C = estimate.stacked.residuals[own], C + J @ estimate.covariance @ J.T
            squared.append(r @ np.linalg.solve(C, r) / 3)
    # The mean of 270 squares: within four of its standard deviations.
    assert np.mean(squared) == pytest.approx(1, abs=4 * np.sqrt(2 / (3 * len(squared))))


def test_points_beside_a_ball_leave_the_sensor_surer() -> None:
    rng = np.random.default_rng(11)
    (ball,) = observe(true_arm(ur10e(), 11), postures(44, rng), rng).targets
    alone, both = (
        calibrate_arm(
            ArmModel(ur10e(), targets),
            np.arange(sum(len(one.q) for one in targets)) % 5 == 2,
            TOLERANCE,
            T_F_S,
        )
        for targets in ((ball,), (ball, points_on(ur10e(), 11, 100)))
    )
    d = boxminus(T_F_S, both.estimate.T_f_s)
    assert d @ np.linalg.solve(both.covariance[:6, :6], d) < 22.5  # one in a thousand
    before, after = (np.sqrt(np.diag(one.covariance)) for one in (alone, both))
    assert (after[:3] < 0.9 * before[:3]).all()
    assert (after[6:] < 1.01 * before[6:]).all()


def write_points(file: Path, q: Array, points: Array) -> Path:
    header = "x_mm,y_mm,z_mm," + ",".join(f"q{k}_deg" for k in range(1, 7))
    rows = np.hstack((1e3 * points, np.degrees(q)))
    np.savetxt(file, rows, delimiter=",", header=header, comments="")
    return file


def test_a_table_of_points_calibrates_an_arm_in_one_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(5)
    q = anywhere(ur10e(), 80, rng)
    file = write_points(tmp_path / "tracker.csv", q, tracked(true_arm(ur10e(), 5), q, rng))
    words = ("--arm.model", "ur10e", "--noise.touch-mm", 0.004, "--noise.position-mm", 0.01)
    command = ("calibrate", file, "--target", "points", *words)
    assert tjscan(*command, "--out", tmp_path / "run") == 2
    assert "--arm" in capsys.readouterr().err
    assert tjscan(*command, "--arm", "--out", tmp_path / "run") == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "16 points that took no part" in told
    found = read_calibration(tmp_path / "run" / "calibration.toml")
    assert found.T_f_s_mm is None
    assert found.T_b_s_mm is not None
    np.testing.assert_allclose(np.array(found.T_b_s_mm)[:3, 3], 1e3 * T_B_T[:3, 3], atol=2)
    assert found.kinematics is not None
    assert found.kinematics.held_out_after_mm < 0.03 < 0.1 < found.kinematics.held_out_before_mm
    text = file.read_text().replace(",q6_deg", ",tool", 1)
    file.write_text(text)
    assert tjscan(*command, "--arm", "--out", tmp_path / "again") == 2
    assert "has 6 joints" in " ".join(capsys.readouterr().err.split())
