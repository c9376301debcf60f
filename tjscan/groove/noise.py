"""How residuals of neighbouring columns hang together, and what that does to a fit."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import log, sqrt
from typing import Final

import numpy as np
import scipy  # its parts are loaded at first use
from numpy.typing import ArrayLike

from tjscan.core.frames import Array
from tjscan.groove.segments import Index

LONGEST: Final = 24
"""Lag in columns beyond which noise is taken as independent."""

WIDEST: Final = LONGEST / 2 * 0.83
"""Largest lag of half the correlation: what stays correlated for longer is shape, not noise."""

MOST_LOST: Final = 0.6
"""No fit is thought to take out a greater share of the noise."""

_HALF: Final = log(2)
_LEAST: Final = 0.01  # a correlation that is as good as none
_SHORTEST: Final = 0.15  # columns: white noise
_POWERS: Final = np.array((1.0, 2.0))  # of the lag in the exponent: a filter's and speckle's


@dataclass(frozen=True, slots=True, eq=False)
class NoiseCorrelation:
    """Correlation of the noise between columns of a profile, by their distance.

    Parameters
    ----------
    lags : ndarray, shape (m,)
        Correlation of columns 0, 1, 2 … apart.
    """

    lags: Array

    @property
    def variance_inflation(self) -> float:
        """By how much correlation raises the variance of a mean of many points."""
        return float(max(1.0, 2 * self.lags.sum() - 1))


def estimate_correlation(
    scaled: Array, columns: Index, count: int, parameters: int
) -> NoiseCorrelation:
    """Estimate the correlation from residuals over their own standard deviation.

    It is taken as a bell, ``exp(-(lag / width)²)``, as speckle's, or as falling by the same
    share from column to column, as a filter's, or as something between them, each in the
    proportion in which it agrees with the first lags. Of the few hundred points of a profile only
    some ninety are independent: too few to use the farther lags as they are.

    A fit takes up the slowest part of the noise: with p parameters the residuals' correlation
    is too small by about ``p inflation / n`` at all lags, which is put back.

    Parameters
    ----------
    scaled : ndarray, shape (n,)
    columns : ndarray of int, shape (n,)
        The column of each.
    count : int
        Columns in all.
    parameters : int
        Number of coefficients that were fitted.
    """
    size = scipy.fft.next_fast_len(count + LONGEST, real=True)
    grid = np.zeros((2, size))
    grid[0, columns] = scaled
    grid[1, columns] = 1.0
    power = np.abs(np.fft.rfft(grid)) ** 2
    product, pairs = np.fft.irfft(power, n=size)[:, :LONGEST]
    rho = product / np.maximum(pairs, 1.0)
    rho = rho / max(float(rho[0]), 1e-30)
    lags = np.zeros(LONGEST)
    lost: Array | float = 0.0
    for _ in range(3):
        lags = _smooth(rho * (1 - lost) + lost, len(scaled))
        lost = noise_share_in_fit(parameters, max(2 * float(lags.sum()) - 1, 1.0), len(scaled))
    return NoiseCorrelation(lags)


def _smooth(rho: Array, count: int) -> Array:
    """A smooth correlation through where the estimated one has fallen to a half."""
    half = _half_lag(rho)
    compared = min(max(int(2.5 * half), 3), LONGEST - 1)
    shapes = 0.5 ** ((np.arange(LONGEST) / half) ** _POWERS[:, None])
    error = ((shapes - rho)[:, 1 : compared + 1] ** 2).sum(axis=1)
    # Neighbouring lags are off together: of those compared about three are independent.
    variance = 2 * half / count * compared / 3
    weight = np.exp(-0.5 * (error - error.min()) / variance)
    return np.asarray(weight @ shapes / weight.sum())


def _half_lag(rho: Array) -> float:
    """Lag at which a correlation has fallen to a half."""
    height = -np.log(np.clip(rho, _LEAST, 1.0))
    height[0] = 0.0
    k = int((height > _HALF).argmax())
    if k == 0:
        return WIDEST
    share = (_HALF - height[k - 1]) / (height[k] - height[k - 1])
    if k == 1:
        return max(float(share), _SHORTEST)
    # A bell's logarithm is linear in the square of the lag.
    return min(sqrt((k - 1) ** 2 + float(share) * (2 * k - 1)), WIDEST)


def noise_share_in_fit(parameters: ArrayLike, inflation: float, count: ArrayLike) -> Array:
    """Share of the variance of correlated noise that a fit takes out of its residuals.

    Parameters
    ----------
    parameters : array_like
        Number of coefficients that were fitted.
    inflation : float
        By how much correlation raises the variance of a mean.
    count : array_like
        Number of points.
    """
    taken = np.asarray(parameters) * max(inflation, 1.0) / np.asarray(count)
    return np.asarray(np.minimum(taken, MOST_LOST))


def correlated_sums(noise: NoiseCorrelation, basis: Array, owner: Index, columns: Index) -> Array:
    """``B R Bᵀ`` for each side, R being the correlation of the columns of its points.

    Parameters
    ----------
    basis : ndarray, shape (p, n)
        Derivatives of a side's height by its coefficients, at its own points.
    owner : ndarray of int, shape (n,)
        The side of each point, rising.
    columns : ndarray of int, shape (n,)

    Returns
    -------
    ndarray, shape (k, p, p)
    """
    k = int(owner[-1]) + 1
    edges = owner.searchsorted(np.arange(k + 1)).tolist()
    first = np.minimum.reduceat(columns, edges[:-1])
    longest = int((np.maximum.reduceat(columns, edges[:-1]) - first).max()) + 1
    size = scipy.fft.next_fast_len(max(longest, LONGEST) + LONGEST, real=True)
    grid = np.zeros((k, len(basis), size))
    for own, start, (a, b) in zip(grid, first.tolist(), pairwise(edges), strict=True):
        own[:, columns[a:b] - start] = basis[:, a:b]
    # A sum over columns is one over frequencies (Parseval).
    waves = np.fft.rfft(grid)
    weight = _spectrum(noise.lags, size)
    sums = (waves.real * weight) @ waves.real.transpose(0, 2, 1)
    sums += (waves.imag * weight) @ waves.imag.transpose(0, 2, 1)
    return np.asarray(sums)


def correlated_variance(
    noise: NoiseCorrelation, shares: Array, owner: Index, columns: Index
) -> Array:
    """``h R hᵀ`` for each side, h being the shares of its points; arguments as above."""
    return correlated_sums(noise, shares[None], owner, columns)[:, 0, 0]


def _spectrum(lags: Array, size: int) -> Array:
    """Power spectrum of a correlation over `size` columns, nowhere negative.

    Of the frequencies of a real row all but the first, and the last of an even number, come in
    pairs and count twice.
    """
    kernel = np.zeros(size)
    kernel[: len(lags)] = lags
    kernel[size - len(lags) + 1 :] = lags[:0:-1]
    power = np.maximum(np.fft.rfft(kernel).real, 0.0) * (2 / size)
    power[0] /= 2
    if size % 2 == 0:
        power[-1] /= 2
    return np.asarray(power)
