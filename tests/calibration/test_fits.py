"""Lines and circles come out of profiles that hold more than the board or the ball."""

import numpy as np
import pytest
from calibration_stage import NOISE
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets.ball import fit_circle
from tjscan.calibration.targets.line import fit_line
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array
from tjscan.laser.faults import correlated_noise
from tjscan.laser.profile import Profile

COLUMNS = 640
QUIET = NoiseModel(correlation=0.0)


def board(angle: float, z: float = 0.24, half: float = 0.045) -> tuple[Array, Array]:
    """A line through (0, z) at `angle` to x_s."""
    along = np.linspace(-half, half, COLUMNS)
    return along * np.cos(angle), z + along * np.sin(angle)


def noisy(x: Array, z: Array, seed: int = 0, noise: NoiseModel = NOISE) -> Profile:
    rng = np.random.default_rng(seed)
    return Profile(x, z + correlated_noise(rng, len(x), noise.range, noise.correlation))


@given(angle=st.floats(-1.2, 1.2), z=st.floats(0.1, 0.4))
@settings(max_examples=40, deadline=None)
def test_an_exact_line_comes_back(angle: float, z: float) -> None:
    fit = fit_line(Profile(*board(angle, z)), NOISE)
    np.testing.assert_allclose(fit.direction_s, (np.cos(angle), 0, np.sin(angle)), atol=1e-12)
    np.testing.assert_allclose(fit.point_s, (0, 0, z), atol=1e-12)
    assert fit.inlier.sum() == COLUMNS


@given(seed=st.integers(0, 2**32 - 1), spatter=st.floats(0, 0.3))
@settings(max_examples=25, deadline=None)
def test_spatter_edges_and_a_second_object_are_left_out(seed: int, spatter: float) -> None:
    rng = np.random.default_rng(seed)
    x, z = board(0.3)
    truth = np.ones(COLUMNS, dtype=bool)
    z[:90] += 0.02 - 0.4 * x[:90]  # another object, beside the board
    z[600:] += np.linspace(0, 0.01, 40)  # the board's edge rounds off
    z[rng.random(COLUMNS) < 0.03] = np.nan
    flying = rng.random(COLUMNS) < spatter
    z[flying] -= rng.uniform(0.002, 0.03, flying.sum())
    truth[:90] = truth[600:] = False
    truth[flying] = False
    fit = fit_line(noisy(x, z, seed), NOISE)
    tilt = np.arctan2(fit.direction_s[2], fit.direction_s[0]) - 0.3
    offset = (fit.point_s - (0, 0, 0.24)) @ np.array((-np.sin(0.3), 0, np.cos(0.3)))
    # Five standard deviations, with some room for the edge's first columns.
    assert abs(tilt) < 6 * fit.sigma_angle
    assert abs(offset) < 6 * np.hypot(fit.sigma_offset, fit.point_s[0] * fit.sigma_angle)
    # Spatter may fall onto the line by chance, also beside the board.
    assert fit.inlier[:90].sum() <= 2
    assert fit.inlier[620:].sum() <= 2
    assert fit.inlier[truth & np.isfinite(z)].mean() > 0.98


@pytest.mark.parametrize("noise", [NOISE, QUIET])
@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_offset_and_angle_scatter_as_stated(noise: NoiseModel, angle: float) -> None:
    offsets, tilts = [], []
    for seed in range(250):
        fit = fit_line(noisy(*board(angle), seed, noise), noise)
        tilt = np.arctan2(fit.direction_s[2], fit.direction_s[0]) - angle
        offset = (fit.point_s - (0, 0, 0.24)) @ np.array((-np.sin(angle), 0, np.cos(angle)))
        tilts.append(tilt / fit.sigma_angle)
        offsets.append(offset / fit.sigma_offset)
    # 250 draws give the standard deviation to 4.5 %; three of those.
    assert np.std(offsets) == pytest.approx(1.0, abs=0.14)
    assert np.std(tilts) == pytest.approx(1.0, abs=0.14)


def test_a_profile_without_a_line_is_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(CalibrationRefused, match="points are on one straight line"):
        fit_line(Profile(rng.uniform(-0.05, 0.05, 640), rng.uniform(0.2, 0.28, 640)), NOISE)
    with pytest.raises(CalibrationRefused, match="holds 0 points"):
        fit_line(Profile(np.full(640, np.nan), np.full(640, np.nan)), NOISE)
    with pytest.raises(CalibrationRefused, match="turn the sensor"):
        fit_line(noisy(*board(0.0, half=0.001)), NOISE)


def arc(radius: float, centre: Array, half: float) -> tuple[Array, Array]:
    """The side of a circle that faces the sensor."""
    angle = np.linspace(-half, half, COLUMNS)
    return centre[0] + radius * np.sin(angle), centre[1] - radius * np.cos(angle)


@given(
    radius=st.floats(0.005, 0.1),
    x=st.floats(-0.02, 0.02),
    z=st.floats(0.2, 0.3),
    half=st.floats(0.5, 1.3),
)
@settings(max_examples=25, deadline=None)
def test_an_exact_circle_comes_back(radius: float, x: float, z: float, half: float) -> None:
    fit = fit_circle(Profile(*arc(radius, np.array((x, z)), half)), NOISE)
    np.testing.assert_allclose((*fit.centre_s, fit.radius), (x, 0, z, radius), atol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_the_stand_under_a_ball_and_spatter_are_left_out(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, z = arc(0.025, np.array((0.004, 0.25)), 1.1)
    x[:120], z[:120] = np.linspace(-0.05, -0.02, 120), 0.27
    flying = rng.random(COLUMNS) < 0.15
    z[flying] -= rng.uniform(0.002, 0.02, flying.sum())
    fit = fit_circle(noisy(x, z, seed), NOISE)
    assert not fit.inlier[:120].any()
    away = np.array((fit.centre_s[0], fit.centre_s[2], fit.radius)) - (0.004, 0.25, 0.025)
    assert away @ np.linalg.solve(fit.covariance, away) < 20  # chi-square, 3 degrees: p = 2e-4


def test_a_straight_line_is_no_circle() -> None:
    with pytest.raises(CalibrationRefused, match="no arc seen"):
        fit_circle(noisy(*board(0.1)), NOISE)


@given(
    seed=st.integers(0, 2**32 - 1),
    half=st.floats(0.003, 0.05),
    stated=st.sampled_from((10, 30, 150)),
)
@settings(max_examples=40, deadline=None)
def test_a_straight_line_is_no_arc(seed: int, half: float, stated: int) -> None:
    noise = NoiseModel(range=1e-6 * stated)
    with pytest.raises(CalibrationRefused, match="no arc seen"):
        fit_circle(noisy(*board(0.3, half=half), seed, noise), noise)
