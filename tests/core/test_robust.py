"""Laws of robust statistics."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import norm

from tjscan.core.frames import Array
from tjscan.core.robust import (
    MAD_TO_SIGMA,
    TUKEY_CUTOFF,
    mad_sigma,
    tukey_root_weights,
    tukey_weights,
)

residuals = arrays(np.float64, st.integers(1, 40), elements=st.floats(-1e3, 1e3))


def test_the_deviation_of_gaussian_noise_is_found() -> None:
    noise = np.random.default_rng(0).normal(scale=0.3, size=100_000)
    assert mad_sigma(noise) == pytest.approx(0.3, rel=0.01)
    assert pytest.approx(1 / norm.ppf(0.75), rel=1e-4) == MAD_TO_SIGMA


def test_less_than_half_of_outliers_do_not_carry_the_deviation_away() -> None:
    noise = np.random.default_rng(1).normal(size=10_000)
    noise[:3000] = 1e6
    assert mad_sigma(noise) < 2


@given(residuals, st.floats(0.01, 100))
def test_the_deviation_has_the_residuals_unit_and_no_sign(r: Array, scale: float) -> None:
    assert mad_sigma(scale * r) == pytest.approx(scale * mad_sigma(r))
    assert mad_sigma(-r) == mad_sigma(r)


@given(residuals)
def test_weights_lie_between_none_and_one_and_fall_with_the_residual(r: Array) -> None:
    weights = tukey_weights(np.sort(np.abs(r)))
    assert ((weights >= 0) & (weights <= 1)).all()
    assert (np.diff(weights) <= 0).all()
    np.testing.assert_array_equal(tukey_weights(-r), tukey_weights(r))
    np.testing.assert_array_equal(tukey_root_weights(r) ** 2, tukey_weights(r))


def test_known_weights() -> None:
    at = np.array([0.0, TUKEY_CUTOFF / 2, TUKEY_CUTOFF, 2 * TUKEY_CUTOFF])
    np.testing.assert_allclose(tukey_weights(at), (1.0, 0.5625, 0.0, 0.0), atol=1e-15)
    assert tukey_weights(at, 1e-6)[3] == 1e-6


def test_weighted_least_squares_stay_95_percent_efficient_on_gaussian_noise() -> None:
    # Variance of an M-estimate over that of the mean: E[psi²] / E[psi']², psi = r w(r).
    r = np.linspace(-TUKEY_CUTOFF, TUKEY_CUTOFF, 200_001)
    density = norm.pdf(r)
    psi = r * tukey_weights(r)
    square = np.trapezoid(psi**2 * density, r)
    slope = np.trapezoid(np.gradient(psi, r) * density, r)
    assert slope**2 / square == pytest.approx(0.95, abs=1e-3)
