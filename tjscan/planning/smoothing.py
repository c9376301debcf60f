"""Smooth curves through values that are known to within their standard deviations.

A smoothing spline of degree 2m - 1 is what is to be expected of a curve whose m-th derivative is
white noise, given its noisy values (Wahba 1978, J. R. Stat. Soc. B 40, 364); the strength of that
noise is the one that makes the values most likely (restricted likelihood). The same model gives
the standard deviation of the curve, at the values and between them. Over the length of a curve
these standard deviations hold on average even if the curve is a fixed one (Nychka 1988, J. Am.
Stat. Assoc. 83, 1134).
"""

from __future__ import annotations

from functools import lru_cache
from math import factorial
from typing import Final

import numpy as np
from numpy.polynomial import Polynomial
from scipy.linalg import eigh, qr
from scipy.optimize import minimize_scalar

from tjscan.core.frames import Array

SMOOTHNESS_ORDER: Final = 4
"""m: the edges of tubes that meet have all derivatives."""

LOG_SMOOTHING_STRENGTHS: Final = np.arange(-10.0, 61.0)
"""Natural logarithms of the strengths that are tried, from one too small to be seen."""


class SmoothCurve:
    """A smooth curve of k components over a length s, fitted to values.

    Parameters
    ----------
    s : ndarray, shape (n,)
        Lengths at which values are known.
    values : ndarray, shape (n, k)
        Components there.
    sigma : ndarray, shape (n,)
        Standard deviation of each component; above zero.
    length : float
        Of all of it; the period if it closes.
    closed : bool
        Whether it closes.

    Attributes
    ----------
    sigma : ndarray, shape (n,)
        As given.
    weights, trend : ndarray, shape (n, k) and (p, k)
        Of the kernel at the nodes, and of the powers of the length.
    """

    def __init__(
        self, s: Array, values: Array, sigma: Array, length: float, *, closed: bool
    ) -> None:
        x, count, self.sigma = s / length, len(s), sigma
        self._nodes, self._length, self._closed = x, length, closed
        self._order = order = min(SMOOTHNESS_ORDER, count - 1)
        trend = polynomial_powers(x, 1 if closed else order)
        kernel = smoothness_kernel(x[:, None] - x, order, closed=closed)
        noise = np.diag(sigma**2)
        Q, _ = qr(trend)
        contrasts = Q[:, trend.shape[1] :]  # of the values, in which no trend is left
        seen, modes = eigh(contrasts.T @ kernel @ contrasts, contrasts.T @ noise @ contrasts)
        seen = np.maximum(seen, 0.0)
        modes = contrasts @ modes
        energy = np.sum((modes.T @ values) ** 2, axis=1)
        self._strength = strength = _likeliest_smoothing(seen, energy, values.shape[1])
        inverse = (modes / (1 + strength * seen)) @ modes.T
        covariance = strength * kernel + noise
        pseudo = np.linalg.pinv(trend)
        weights = inverse @ values
        self.weights, self.trend = strength * weights, pseudo @ (values - covariance @ weights)
        lift = pseudo @ (np.eye(count) - covariance @ inverse)
        self._posterior = inverse, lift, covariance

    def values(self, s: Array) -> Array:
        """The curve at lengths (m,), shape (m, k)."""
        x = np.asarray(s) / self._length
        return np.asarray(self._kernel(x) @ self.weights + self._powers(x) @ self.trend)

    def derivatives(self, s: Array) -> Array:
        """Its derivative by s, shape (m, k)."""
        x, count = np.asarray(s) / self._length, len(self.trend)
        rise = self._powers(x)[:, :-1] * np.arange(1, count)  # of x^j, j from 1
        slope = self._kernel(x, derivative=1) @ self.weights
        return np.asarray((slope + rise @ self.trend[1:]) / self._length)

    def sigmas(self, s: Array) -> Array:
        """Standard deviation of each component at lengths (m,), shape (m,)."""
        x = np.asarray(s) / self._length
        inverse, lift, covariance = self._posterior
        kernel = self._strength * self._kernel(x)
        zero = self._strength * smoothness_kernel(np.zeros(1), self._order, closed=self._closed)
        shares = kernel @ inverse + self._powers(x) @ lift  # of the values in the curve
        variance = zero - 2 * np.sum(shares * kernel, axis=1)
        variance += np.sum((shares @ covariance) * shares, axis=1)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def _kernel(self, x: Array, derivative: int = 0) -> Array:
        between = x[:, None] - self._nodes
        return smoothness_kernel(between, self._order, closed=self._closed, derivative=derivative)

    def _powers(self, x: Array) -> Array:
        return polynomial_powers(x, len(self.trend))


def _likeliest_smoothing(seen: Array, energy: Array, components: int) -> float:
    """Strength of the greatest restricted likelihood, of modes of variance 1 + strength · seen."""

    def cost(log_strength: float) -> float:
        variance = 1 + np.exp(log_strength) * seen
        return float(np.sum(components * np.log(variance) + energy / variance))

    tried = LOG_SMOOTHING_STRENGTHS - np.log(seen.max())
    best = int(np.argmin([cost(one) for one in tried]))
    around = tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)]
    return float(np.exp(minimize_scalar(cost, bounds=around, method="bounded").x))


def polynomial_powers(x: Array, count: int) -> Array:
    """Powers of x from 0, shape (m, count)."""
    return np.asarray(np.vander(x, count, increasing=True))


def smoothness_kernel(d: Array, order: int, *, closed: bool, derivative: int = 0) -> Array:
    """Covariance, up to a trend, of a curve whose derivative of an order is white noise.

    Parameters
    ----------
    d : ndarray
        Differences of shares of the length.
    order : int
        m.
    closed : bool
        Whether the curve closes: then it is Bernoulli's polynomial, else a power of the distance.
    derivative : int
        0, or 1 for the covariance's derivative by the difference.
    """
    sign, degree = (-1) ** order, 2 * order - derivative
    if closed:
        return np.asarray(-sign * _bernoulli_polynomial(degree)(np.mod(d, 1.0)) / factorial(degree))
    power = np.abs(d) ** (degree - 1)
    if derivative:
        power = np.sign(d) * power
    return np.asarray(sign * power / (2 * factorial(degree - 1)))


@lru_cache
def _bernoulli_polynomial(degree: int) -> Polynomial:
    """Bernoulli's polynomial: B' = degree · that before, and no mean from 0 to 1."""
    found = Polynomial([1.0])
    for k in range(1, degree + 1):
        found = (k * found).integ()
        found = found - found.integ()(1.0)
    return found
