"""The arm's deviations and the sensor's pose, found together."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from ball_views import CENTRE_B, NOISE, T_F_S, kinematics, observe, postures

from tjscan.calibration.arm.calibrate import (
    ArmCalibration,
    ArmModel,
    TargetInPostures,
    calibrate_arm,
    estimate_deviations,
)
from tjscan.calibration.arm.wizard import PosturePlan, plan_postures
from tjscan.calibration.closed_form import PluckerPlane
from tjscan.calibration.targets.line import LineBundle
from tjscan.calibration.targets.plane import PlaneModel, PlaneTarget
from tjscan.core.errors import CalibrationRefused, PoseUnreachable
from tjscan.core.frames import Array, inverse_pose, pose
from tjscan.core.pose_vector import boxminus, boxplus
from tjscan.laser.model import MeasuringRange
from tjscan.robot.deviations import deviate_joint_frames
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance

TOLERANCE = PlacementTolerance()
SIGMAS = np.tile(TOLERANCE.sigmas, (6, 1))
GUESS = boxplus(T_F_S, np.array((0.003, -0.002, 0.004, 0.01, -0.02, 0.01)))
AHEAD_S = np.array((0.0, 0.0, 0.24, 1.0))


def drawn(seed: int) -> Kinematics:
    deviations = SIGMAS * np.random.default_rng(seed).standard_normal((6, 6))
    return deviate_joint_frames(kinematics(), deviations)


def calibrated(seed: int, poses: int = 44) -> ArmCalibration:
    rng = np.random.default_rng(100 + seed)
    model = observe(drawn(seed), postures(poses + 20, rng), rng)
    return calibrate_arm(model, np.arange(poses + 20) >= poses, TOLERANCE, GUESS)


calibrated_once = cache(calibrated)


def off(arm: Kinematics, T_f_s: Array, true: Kinematics, q: Array) -> float:
    """RMS distance of the middle of the sensor's range, the base being fitted, in metres."""
    a, b = (
        np.array([(k.forward(one) @ T @ AHEAD_S)[:3] for one in q])
        for k, T in ((arm, T_f_s), (true, T_F_S))
    )
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    U, _, V = np.linalg.svd(a.T @ b)
    R = V.T @ np.diag((1, 1, np.linalg.det(V.T @ U.T))) @ U.T
    return float(np.sqrt(((a @ R.T - b) ** 2).sum(axis=1).mean()))


def test_without_noise_what_shows_is_found_again() -> None:
    rng = np.random.default_rng(1)
    true = drawn(1)
    model = observe(true, postures(40, rng), rng, share=0.0)
    loose = 30 * SIGMAS  # next to no prior: it would pull
    found = estimate_deviations(model, loose, GUESS)
    arm = deviate_joint_frames(kinematics(), found.deviations)
    assert off(arm, found.T_f_s, true, postures(30, rng)) < 1e-6


def test_a_calibrated_arm_is_three_times_better_where_it_was_not_calibrated() -> None:
    rng = np.random.default_rng(7)
    anywhere = rng.uniform(-np.pi, np.pi, (60, 6))
    before, after = [], []
    for seed in range(3):
        found, true = calibrated_once(seed), drawn(seed)
        arm = deviate_joint_frames(kinematics(), found.estimate.deviations)
        before.append(off(kinematics(), T_F_S, true, anywhere))
        after.append(off(arm, found.estimate.T_f_s, true, anywhere))
    assert np.mean(before) > 3 * np.mean(after)
    assert np.sqrt(np.mean(np.square(after))) < 1.5e-4


def test_held_out_poses_see_it_too() -> None:
    found = calibrated_once(0)
    assert found.held_out.sum() == 20
    assert found.error_after < 1e-4 < 2e-4 < found.error_before


def test_the_stated_uncertainty_is_true() -> None:
    squared = []
    for seed in range(3):
        found = calibrated_once(seed)
        d = boxminus(T_F_S, found.estimate.T_f_s)
        squared.append(d @ np.linalg.solve(found.covariance[:6, :6], d) / 6)
    # The mean of 18 squares of normal numbers: within four of its standard deviations.
    assert 0 < np.mean(squared) < 1 + 4 * np.sqrt(2 / 18)


def test_what_can_not_be_told_is_named_and_left() -> None:
    found = calibrated_once(1)
    said = "\n".join(found.undetermined)
    assert "joint 1: length x, length y, length z, twist x, twist y, offset" in said
    assert "not separable from where the target is" in said
    assert "joint 6: length z, offset not separable from how the sensor sits" in said
    sigma = np.sqrt(np.diag(found.estimate.covariance))[6:42].reshape(6, 6)
    np.testing.assert_allclose(sigma[0], SIGMAS[0], rtol=0.05)
    assert np.abs(found.estimate.deviations[0] / SIGMAS[0]).max() < 0.1
    # The zero of joint 3, between two long links, is known better than before.
    assert sigma[2, 5] < 0.9 * SIGMAS[2, 5]


def test_a_pose_that_is_wrong_is_left_out() -> None:
    rng = np.random.default_rng(3)
    model = observe(drawn(3), postures(44, rng), rng)
    (seen,) = model.targets
    q, T_b_f = np.array(seen.q), np.array(seen.T_b_f)
    q[5, 2] += np.radians(0.5)
    T_b_f[5] = kinematics().forward(q[5])
    bent = ArmModel(model.kinematics, (replace(seen, q=q, T_b_f=T_b_f),))
    estimate = estimate_deviations(bent, SIGMAS, GUESS)
    np.testing.assert_array_equal(np.flatnonzero(~estimate.used), [5])


def test_few_poses_and_other_arms_are_refused() -> None:
    rng = np.random.default_rng(4)
    few = observe(drawn(4), postures(22, rng), rng)
    with pytest.raises(CalibrationRefused, match="at least 20"):
        calibrate_arm(few, np.arange(22) >= 12, TOLERANCE, GUESS)
    (seen,) = observe(drawn(4), postures(40, rng), rng).targets
    other = ArmModel(Kinematics.load("ur5e"), (seen,))
    wrong = replace(seen, T_b_f=np.array([other.kinematics.forward(q) for q in seen.q]))
    with pytest.raises(CalibrationRefused, match=r"no arm explains|fit worse"):
        calibrate_arm(ArmModel(other.kinematics, (wrong,)), np.arange(40) >= 30, TOLERANCE, GUESS)


def test_lines_on_boards_at_three_places_tell_of_the_arm_too() -> None:
    rng, true = np.random.default_rng(5), drawn(5)
    places = [pose(p=(0.7, 0.2, 0.0)), pose(p=(-0.4, 0.6, 0.1)), pose(p=(-0.5, -0.5, 0.3))]
    seen = [lines_on(board, true, rng) for board in places]
    found = estimate_deviations(ArmModel(kinematics(), tuple(seen)), SIGMAS, GUESS)
    anywhere = rng.uniform(-np.pi, np.pi, (60, 6))
    arm = deviate_joint_frames(kinematics(), found.deviations)
    before = off(kinematics(), T_F_S, true, anywhere)
    assert off(arm, found.T_f_s, true, anywhere) < 0.7 * before


def lines_on(T_b_board: Array, true: Kinematics, rng: np.random.Generator) -> TargetInPostures:
    """Lines on the plane z = 0 of a board, from postures that would see a ball there."""
    to_board = pose(p=T_b_board[:3, 3] - CENTRE_B)
    q_all: list[Array] = []
    points, directions = [], []
    while len(q_all) < 20:
        (q,) = postures(1, rng)
        T_b_f = to_board @ kinematics().forward(q)
        try:
            q = kinematics().inverse(T_b_f, q)
        except PoseUnreachable:
            continue
        T_s_board = inverse_pose(true.forward(q) @ T_F_S) @ T_b_board
        u, p = T_s_board[:3, 2], T_s_board[:3, 3]
        if abs(u[2]) < 0.4:
            continue
        along = np.array((u[2], 0.0, -u[0])) / np.hypot(u[0], u[2])
        points.append((0.0, 0.0, float(u @ p) / u[2]))
        directions.append(along)
        q_all.append(q)
    q, T_b_f = np.array(q_all), np.array([kinematics().forward(one) for one in q_all])
    sigma = np.full(len(q), 5e-6), np.full(len(q), 5e-5)
    lines = LineBundle(
        T_b_f[:, :3, :3], T_b_f[:, :3, 3], np.array(points), np.array(directions), *sigma
    )
    u = T_b_board[:3, 2]
    plane = PluckerPlane(u, -float(u @ T_b_board[:3, 3]))
    target = PlaneTarget.from_unknown_plane(plane, T_b_board[:3, 3])
    return TargetInPostures(PlaneModel(lines, target, NOISE), q, T_b_f, np.zeros(3))


def test_postures_that_only_check_look_every_way() -> None:
    window = MeasuringRange(near=0.19, far=0.29, apex_z=-0.028, half_angle=0.188, columns=640)
    plan = PosturePlan(CENTRE_B, 0.03, T_F_S, window, NOISE, TOLERANCE, poses=44, held_out=12)
    views = [view for view in plan_postures(plan, kinematics()) if view.held_out][:12]
    ways = np.array([view.T_b_f[:3, 2] for view in views])
    cosines = (ways @ ways.T)[np.triu_indices(len(ways), 1)]
    apart = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    assert len(ways) == 12
    # No two of them are the same view in another configuration of the arm.
    assert apart.min() > 1
    assert np.median(apart) > 15
