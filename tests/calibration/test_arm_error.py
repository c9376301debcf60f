"""The arm's geometry error: how it correlates, how large it is, and what it leaves uncertain."""

import numpy as np
from calibration_stage import HAND, NOISE, circle, error, samples, shots, target
from scipy.spatial.transform import Rotation

from tjscan.calibration.arm_error import ARM_REACH, geometry_correlation
from tjscan.calibration.hand_eye import calibrate_on_plane
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets import fit_plane
from tjscan.core.frames import Array, pose
from tjscan.core.pose_vector import boxplus

POSES = circle(25)


def test_poses_that_are_alike_err_alike() -> None:
    R = Rotation.from_rotvec([(0, 0, 0), (0, 0, 0), (0, 0, 1.0), (0, 0, np.pi)]).as_matrix()
    T = np.stack([pose(one) for one in R])
    T[1, 0, 3] = ARM_REACH
    found = geometry_correlation(T)
    # exp(-1/2) after a radian or after the reach, and all of it at the same pose.
    np.testing.assert_allclose(np.diag(found), 1)
    np.testing.assert_allclose(found[0], np.exp([0, -0.5, -0.5, -(np.pi**2) / 2]), atol=1e-7)
    assert np.linalg.eigvalsh(found)[0] > -1e-12


def drawn(size: float, rng: np.random.Generator) -> Array:
    """The poses where the flange truly is, if the arm's geometry is that much off."""
    root = np.linalg.cholesky(geometry_correlation(POSES) + 1e-9 * np.eye(len(POSES)))
    off = size * root @ (rng.standard_normal((len(POSES), 6)) / np.repeat((1, ARM_REACH), 3))
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
