"""Calibration on a ball, its radius known or not."""

from contextlib import suppress

import numpy as np
import pytest
from _targets import BALL_B, TargetSimulator
from calibration_stage import NOISE, T_F_S, WINDOW, error

from tjscan.calibration.hand_eye import calibrate_on_targets
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.targets.ball import CircleFit, SeenBall, SphereTarget
from tjscan.calibration.targets.target import PosedFit
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array
from tjscan.core.pose_vector import boxplus

HAND = TargetSimulator(T_F_S, WINDOW, NOISE)
RADIUS = HAND.radius


def arcs(
    rng: np.random.Generator, count: int = 15, tilt: float = 35.0
) -> list[PosedFit[CircleFit]]:
    poses = HAND.poses(rng, count, "ball", tilt)
    return HAND.arcs(poses, poses, rng)


def calibrate_on_sphere(
    taken: list[PosedFit[CircleFit]], sphere: SphereTarget, guess: Array | None = None
) -> HandEyeCalibration:
    return calibrate_on_targets([SeenBall(taken, sphere, NOISE)], NOISE, T_f_s_guess=guess)


@pytest.mark.parametrize("radius", [RADIUS, None])
def test_the_sensor_is_found_without_a_guess(radius: float | None) -> None:
    squares = []
    for seed in range(5):
        taken = arcs(np.random.default_rng(seed))
        result = calibrate_on_sphere(taken, SphereTarget(radius))
        away = error(result.T_f_s)
        squares.append(away @ np.linalg.solve(result.covariance, away))
        assert result.radius == pytest.approx(RADIUS, abs=0.2e-3)
        assert result.centre_b is not None
        np.testing.assert_allclose(result.centre_b, BALL_B, atol=1e-3)
    # Chi-square with 6 degrees; the mean of five is known to 1.5; three of those.
    assert np.mean(squares) < 10.6


def test_a_guess_leads_to_the_same_place() -> None:
    taken = arcs(np.random.default_rng(0))
    free = calibrate_on_sphere(taken, SphereTarget(RADIUS))
    led = calibrate_on_sphere(taken, SphereTarget(RADIUS), T_F_S)
    np.testing.assert_allclose(led.T_f_s, free.T_f_s, atol=1e-7)


def test_the_derivatives_are_those_of_the_residuals() -> None:
    rng = np.random.default_rng(0)
    taken = arcs(rng, 6)
    model = SeenBall(taken, SphereTarget(), NOISE).model
    T, where = boxplus(T_F_S, 0.01 * rng.standard_normal(6)), np.append(BALL_B + 0.01, 0.031)
    found, h = model.linearise(T, where), 1e-6
    for i in range(6):
        step = h * np.eye(6)[i]
        up, down = (model.linearise(boxplus(T, s * step), where).residuals for s in (1, -1))
        np.testing.assert_allclose(found.by_pose[:, :, i], (up - down) / (2 * h), atol=1e-7)
    for i in range(4):
        step = h * np.eye(4)[i]
        up, down = (model.linearise(T, where + s * step).residuals for s in (1, -1))
        np.testing.assert_allclose(found.by_target[:, :, i], (up - down) / (2 * h), atol=1e-7)


def test_a_bad_pose_is_named() -> None:
    taken = arcs(np.random.default_rng(1))
    T = taken[3].T_b_f.copy()
    T[:3, 3] += 2e-3
    taken[3] = PosedFit("arc 4", T, taken[3].fit)
    assert calibrate_on_sphere(taken, SphereTarget(RADIUS)).rejected_sample_names == ("arc 4",)


def test_poses_that_only_translate_are_refused() -> None:
    with pytest.raises(CalibrationRefused, match="only translations"):
        calibrate_on_sphere(arcs(np.random.default_rng(0), tilt=0.1), SphereTarget(RADIUS))


@pytest.mark.parametrize("off", [-0.5e-3, 0.5e-3, 0.030])
def test_a_ball_of_another_radius_than_stated_is_refused(off: float) -> None:
    with pytest.raises(CalibrationRefused, match=r"radius of 30\.\d\d mm.*is stated"):
        calibrate_on_sphere(arcs(np.random.default_rng(2)), SphereTarget(RADIUS + off))


def test_the_radius_is_measured_beside_the_stated_one() -> None:
    result = calibrate_on_sphere(arcs(np.random.default_rng(2)), SphereTarget(RADIUS))
    measured = result.measured_radius
    assert measured is not None
    assert measured.stated == RADIUS
    assert measured.radius == pytest.approx(RADIUS, abs=4 * measured.sigma)
    assert result.radius == pytest.approx(RADIUS, abs=40e-6)  # four tolerances of the stated one


def test_a_radius_is_refused_only_as_surely_as_few_residuals_allow() -> None:
    """Poses that scatter more than stated widen its sigma, which few of them show roughly."""
    loud = NoiseModel(position=2 * NOISE.position, rotation=2 * NOISE.rotation, geometry=0.0)
    hand = TargetSimulator(T_F_S, WINDOW, loud, radius=0.0127)
    rng, taken = np.random.default_rng(5), list[PosedFit[CircleFit]]()
    while len(taken) < 9:
        T = hand.poses(rng, 1, "ball")
        with suppress(CalibrationRefused):  # the ball is out of view
            taken += hand.arcs(T, T, rng)

    def calibrated(radius: float | None) -> HandEyeCalibration:
        return calibrate_on_targets([SeenBall(taken, SphereTarget(radius), NOISE)], NOISE)

    free = calibrated(None)
    assert free.measured_radius is not None
    assert free.sigma_scale > 1
    assert (free.geometry, free.rejected_sample_names) == (0.0, ())
    found, sigma = free.measured_radius.radius, free.measured_radius.sigma
    calibrated(found + 3.6 * sigma)  # a normal distribution would refuse 3.3
    with pytest.raises(CalibrationRefused, match="another radius"):
        calibrated(found + 5 * sigma)
