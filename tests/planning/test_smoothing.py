"""Smooth curves through uncertain values: what they keep, and whether their sigmas are true."""

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.planning.smoothing import SmoothCurve

LENGTH = 1.4


def lengths(count: int, *, closed: bool) -> Array:
    return np.linspace(0, LENGTH, count, endpoint=not closed)


def saddle(s: Array) -> Array:
    """A saddle about a tube, as two tubes make it: closed, of all derivatives."""
    phi = 2 * np.pi * s / LENGTH
    height = np.sqrt(0.3**2 - (0.22 * np.sin(phi)) ** 2)
    return np.column_stack((0.22 * np.cos(phi), 0.22 * np.sin(phi), height))


def fitted(count: int, sigma: float, seed: int, *, closed: bool = True) -> SmoothCurve:
    s = lengths(count, closed=closed)
    noise = sigma * np.random.default_rng(seed).standard_normal((count, 3))
    return SmoothCurve(s, saddle(s) + noise, np.full(count, sigma), LENGTH, closed=closed)


def test_a_straight_line_stays_straight_whatever_the_noise_is_said_to_be() -> None:
    s = lengths(9, closed=False)
    line = np.outer(s, (1.0, -2.0, 0.5)) + 3.0
    curve = SmoothCurve(s, line, np.full(9, 1e-3), LENGTH, closed=False)
    between = np.linspace(0, LENGTH, 40)
    np.testing.assert_allclose(
        curve.values(between), np.outer(between, (1.0, -2.0, 0.5)) + 3.0, atol=1e-9
    )
    np.testing.assert_allclose(curve.derivatives(between), 40 * [(1.0, -2.0, 0.5)], atol=1e-8)


@pytest.mark.parametrize("closed", [True, False])
def test_exact_values_are_met_and_the_curve_between_them_too(closed: bool) -> None:
    curve = fitted(36, 1e-7, 0, closed=closed)
    between = lengths(360, closed=closed)
    # At its ends an open curve is known from one side alone.
    np.testing.assert_allclose(curve.values(between), saddle(between), atol=1e-5)


@pytest.mark.parametrize("closed", [True, False])
def test_derivatives_are_those_of_the_values(closed: bool) -> None:
    curve, step = fitted(24, 1e-4, 1, closed=closed), 1e-5
    s = np.linspace(0.1, LENGTH - 0.1, 20)
    numeric = (curve.values(s + step) - curve.values(s - step)) / (2 * step)
    np.testing.assert_allclose(curve.derivatives(s), numeric, atol=1e-6)


def test_a_closed_curve_is_the_same_wherever_it_is_said_to_begin() -> None:
    s, shift = lengths(20, closed=True), 7
    values = saddle(s) + 1e-4 * np.random.default_rng(2).standard_normal((20, 3))
    one = SmoothCurve(s, values, np.full(20, 1e-4), LENGTH, closed=True)
    other = SmoothCurve(s, np.roll(values, -shift, 0), np.full(20, 1e-4), LENGTH, closed=True)
    at = np.linspace(0, LENGTH, 33)
    np.testing.assert_allclose(other.values(at - s[shift]), one.values(at), atol=1e-9)
    np.testing.assert_allclose(other.sigmas(at - s[shift]), one.sigmas(at), rtol=1e-4)


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("sigma", [3e-5, 3e-4])
def test_errors_are_as_large_as_their_standard_deviations_say(closed: bool, sigma: float) -> None:
    """At the values and between them, on average over the curve and over drawn errors."""
    at = lengths(144, closed=closed)
    squares = []
    for seed in range(20):
        curve = fitted(36, sigma, seed, closed=closed)
        errors = curve.values(at) - saddle(at)
        squares.append(np.mean((errors / curve.sigmas(at)[:, None]) ** 2))
    assert 0.7 < np.mean(squares) < 1.5


def test_it_is_less_sure_between_values_that_stand_far_apart() -> None:
    s = lengths(36, closed=True)
    keep = np.r_[0:12, 17:36]
    values = saddle(s) + 1e-5 * np.random.default_rng(3).standard_normal((36, 3))
    curve = SmoothCurve(s[keep], values[keep], np.full(len(keep), 1e-5), LENGTH, closed=True)
    gap, close = curve.sigmas(np.array([s[14], s[28]]))
    assert gap > 2 * close
