"""The arm's geometry error: how it correlates, how large it is, and what it leaves uncertain."""

from dataclasses import replace

import numpy as np
import pytest
from _targets import calibrate_on_plane
from calibration_stage import (
    CENTRE,
    HAND,
    NOISE,
    PLACES,
    PLANE,
    circle,
    error,
    looking,
    samples,
    shots,
    target,
)
from scipy.spatial.transform import Rotation

from tjscan.calibration.arm.calibrate import ArmGeometryDeviation
from tjscan.calibration.checks import verify_with_fresh_line
from tjscan.calibration.noise import TYPICAL_FLANGE_LEVER, NoiseModel, geometry_error_correlation
from tjscan.calibration.targets.line import LineFit
from tjscan.calibration.targets.plane import SeenBoard, fit_plane
from tjscan.calibration.targets.target import PosedFit
from tjscan.core.frames import Array, pose, skew_matrix
from tjscan.core.pose_vector import boxminus, boxplus
from tjscan.robot.deviations import deviate_joint_frames
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance

POSES = circle(25)


def test_poses_that_are_alike_err_alike() -> None:
    R = Rotation.from_rotvec([(0, 0, 0), (0, 0, 0), (0, 0, 1.0), (0, 0, np.pi)]).as_matrix()
    T = np.stack([pose(one) for one in R])
    T[1, 0, 3] = TYPICAL_FLANGE_LEVER
    found = geometry_error_correlation(T)
    # exp(-1/2) after a radian or after the reach, and all of it at the same pose.
    np.testing.assert_allclose(np.diag(found), 1)
    np.testing.assert_allclose(found[0], np.exp([0, -0.5, -0.5, -(np.pi**2) / 2]), atol=1e-7)
    assert np.linalg.eigvalsh(found)[0] > -1e-12


def drawn(size: float, rng: np.random.Generator) -> Array:
    """The poses where the flange truly is, if the arm's geometry is that much off."""
    root = np.linalg.cholesky(geometry_error_correlation(POSES) + 1e-9 * np.eye(len(POSES)))
    off = (
        size
        * root
        @ (rng.standard_normal((len(POSES), 6)) / np.repeat((1, TYPICAL_FLANGE_LEVER), 3))
    )
    return np.stack([boxplus(T, step) for T, step in zip(POSES, off, strict=True)])


def test_what_is_stated_holds_for_arms_that_are_off() -> None:
    """Of lines from poses that err alike, the uncertainty is what it says, and far from zero."""
    stated = NoiseModel(geometry=0.3e-3)
    squares, bare = list[float](), list[float]()
    for seed in range(20):
        rng = np.random.default_rng(seed)
        taken = samples(POSES, shots(drawn(0.3e-3, rng), HAND, rng))
        board = target()
        for noise, found in ((stated, squares), (NOISE, bare)):
            result = calibrate_on_plane(taken, board, noise)
            away = error(result.T_f_s)
            found.append(float(away @ np.linalg.solve(result.covariance, away)) / 6)
    # Chi-square over 6: 20 draws give its mean to 0.13; four of those.
    assert abs(np.mean(squares) - 1) < 0.52
    assert np.mean(bare) > 2 * np.mean(squares)


def test_an_arm_that_is_far_off_is_noticed() -> None:
    rng = np.random.default_rng(1)
    taken = samples(POSES, shots(drawn(1.5e-3, rng), HAND, rng))
    result = calibrate_on_plane(taken, target(), NOISE)
    assert result.geometry > 0.3e-3
    assert any("an arm's geometry" in said for said in result.caveats)


def test_an_exact_arm_is_seldom_blamed() -> None:
    found = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        taken = samples(POSES, shots(POSES, HAND, rng))
        found.append(calibrate_on_plane(taken, target(rng), NOISE).geometry)
    assert np.count_nonzero(found) <= 1  # 0.04 expected


def test_touches_next_to_each_other_err_alike() -> None:
    """The board's height is known no better than the arm; its tilt is known better than that."""
    places = 0.15 * np.array([(x, y, 0.0) for x in (-1, 0, 1) for y in (-1, 0, 1)])
    off, alone = (np.linalg.inv(fit_plane(places, 5e-5, geometry=g).information) for g in (3e-4, 0))
    assert np.sqrt(off[2, 2]) > 0.27e-3
    assert np.sqrt(off[0, 0]) < 3e-4 / 0.15
    assert (np.diag(off) > np.diag(alone)).all()


def test_a_known_arm_moves_as_its_deviations_move_it() -> None:
    arm, rng = Kinematics.load("ur10e"), np.random.default_rng(3)
    q, off = rng.uniform(-2, 2, 6), 1e-6 * rng.standard_normal((6, 6))
    size = off / PlacementTolerance().sigmas
    moved = boxminus(deviate_joint_frames(arm, off).forward(q), arm.forward(q))
    # The maker's tolerance leaves 0.40 mm RMS, all directions together: so many metres each.
    np.testing.assert_allclose(
        ArmGeometryDeviation(arm).flange_motion(q) @ size.ravel() * 0.232e-3,
        moved,
        rtol=0.01,
        atol=1e-9,
    )


def rigid(p: Array) -> Array:
    """How a point moves as the arm's whole base does, by a metre and a radian, shape (3, 6)."""
    return np.hstack((np.eye(3), -skew_matrix(p)))


def on_a_base_that_moves() -> SeenBoard:
    """Touches and lines of an arm of which nothing but the base may be off."""
    rng = np.random.default_rng(5)
    touched = HAND.touches(PLACES, rng)
    by_arm = np.array([rigid(p) for p in touched])
    board = fit_plane(touched, NOISE.touch, CENTRE + PLANE.u, by_arm=by_arm)
    lines = [base_moves(s) for s in samples(POSES, shots(POSES, HAND, rng))]
    return SeenBoard(lines, board, NOISE)


def base_moves(sample: PosedFit[LineFit]) -> PosedFit[LineFit]:
    turns = np.hstack((np.zeros((3, 3)), np.eye(3)))
    return replace(sample, by_arm=np.vstack((rigid(sample.T_b_f[:3, 3]), turns)))


def test_what_touches_and_lines_err_by_alike_leaves_the_sensor_where_it_is() -> None:
    board = on_a_base_that_moves()
    exact = calibrate_on_plane(board.samples, board.target, NOISE)
    off = calibrate_on_plane(board.samples, board.target, NoiseModel(geometry=1e-3))
    np.testing.assert_allclose(off.T_f_s, exact.T_f_s, atol=1e-7)
    np.testing.assert_allclose(
        np.diag(off.covariance), np.diag(exact.covariance), rtol=1e-3, atol=1e-16
    )


def test_a_fresh_line_that_errs_as_the_others_do_is_no_contradiction() -> None:
    board = on_a_base_that_moves()
    noise = NoiseModel(geometry=1e-3)
    result = calibrate_on_plane(board.samples, board.target, noise)
    T = looking(10.0, -15.0)
    fresh = base_moves(samples(T[None], shots(T[None], HAND, np.random.default_rng(6)))[0])
    exact = verify_with_fresh_line(board, replace(result, geometry=0.0), fresh)
    alike = verify_with_fresh_line(replace(board, noise=noise), result, fresh)
    # It may miss no more than it may on an exact arm.
    assert alike.sigma_offset == pytest.approx(exact.sigma_offset, rel=1e-3)
    assert alike.line_agrees
