"""How residuals of neighbouring columns hang together, and what that does to a fit."""

from __future__ import annotations

from math import log, sqrt
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tjscan.core.frames import Array
from tjscan.groove.sides import FittedProfile, Index, NoiseCorrelation, OrderedProfilePoints

LONGEST_LAG: Final = 24
"""Lag in columns beyond which noise is taken as independent."""

WIDEST_HALF_LAG: Final = LONGEST_LAG / 2 * 0.83
"""Largest lag of half the correlation: what stays correlated for longer is shape, not noise."""

LARGEST_FIT_SHARE: Final = 0.6
"""No fit is thought to take out a greater share of the noise."""

UNDULATION_BLOCK: Final = 10
"""Points over which residuals are averaged: undulation is longer, most noise is not."""

FEWEST_BLOCKS: Final = 3
"""Blocks that tell undulation from noise."""

SIGNIFICANT_SIGMAS: Final = 3.0
"""Standard deviations from which a departure or an undulation is none of chance."""

_LOG_TWO: Final = log(2)
_LEAST_CORRELATION: Final = 0.01  # a correlation that is as good as none
_SHORTEST_LAG: Final = 0.15  # columns: white noise
_LAG_POWERS: Final = np.array((1.0, 2.0))  # of the lag in the exponent: a filter's and speckle's


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
    grid = np.zeros((2, count + LONGEST_LAG - 1))
    grid[0, columns] = scaled
    grid[1, columns] = 1.0
    product, pairs = (np.correlate(row, row[:count]) for row in grid)
    rho = product / np.maximum(pairs, 1.0)
    rho = rho / max(float(rho[0]), 1e-30)
    lags = np.zeros(LONGEST_LAG)
    lost: Array | float = 0.0
    for _ in range(3):
        lags = _smooth(rho * (1 - lost) + lost, len(scaled))
        lost = noise_share_in_fit(parameters, max(2 * float(lags.sum()) - 1, 1.0), len(scaled))
    return NoiseCorrelation(lags, float(max(1.0, 2 * lags.sum() - 1)))


def _smooth(rho: Array, count: int) -> Array:
    """A smooth correlation through where the estimated one has fallen to a half."""
    half = _half_lag(rho)
    compared = min(max(int(2.5 * half), 3), LONGEST_LAG - 1)
    shapes = 0.5 ** ((np.arange(LONGEST_LAG) / half) ** _LAG_POWERS[:, None])
    error = ((shapes - rho)[:, 1 : compared + 1] ** 2).sum(axis=1)
    # Neighbouring lags are off together: of those compared about three are independent.
    variance = 2 * half / count * compared / 3
    weight = np.exp(-0.5 * (error - error.min()) / variance)
    return np.asarray(weight @ shapes / weight.sum())


def _half_lag(rho: Array) -> float:
    """Lag at which a correlation has fallen to a half."""
    values = rho.tolist()
    k = next((i for i in range(1, LONGEST_LAG) if values[i] < 0.5), 0)
    if k == 0:
        return WIDEST_HALF_LAG
    before = -log(min(values[k - 1], 1.0)) if k > 1 else 0.0
    share = (_LOG_TWO - before) / (-log(max(values[k], _LEAST_CORRELATION)) - before)
    if k == 1:
        return max(share, _SHORTEST_LAG)
    # A bell's logarithm is linear in the square of the lag.
    return min(sqrt((k - 1) ** 2 + share * (2 * k - 1)), WIDEST_HALF_LAG)


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
    return np.asarray(np.minimum(taken, LARGEST_FIT_SHARE))


def correlated_sums(noise: NoiseCorrelation, basis: Array, counts: Index, columns: Index) -> Array:
    """``B R Bᵀ`` for each side, R being the correlation of the columns of its points.

    Parameters
    ----------
    basis : ndarray, shape (p, n)
        Derivatives of a side's height by its coefficients, at its own points.
    counts : ndarray of int, shape (k,)
        How many of the points belong to each side, one side after the other.
    columns : ndarray of int, shape (n,)

    Returns
    -------
    ndarray, shape (k, p, p)
    """
    ends = counts.cumsum()
    starts = ends - counts
    first = np.minimum.reduceat(columns, starts)
    # Sides are laid so far apart that they do not correlate.
    room = np.maximum.reduceat(columns, starts) - first + LONGEST_LAG
    places = columns + (room.cumsum() - room - first).repeat(counts)
    grid = np.zeros((len(basis), room.sum()))
    grid[:, places] = basis
    kernel = np.concatenate((noise.lags[:0:-1], noise.lags))
    smooth = np.array([np.convolve(row, kernel, "same") for row in grid])[:, places]
    spans = zip(starts.tolist(), ends.tolist(), strict=True)
    return np.array([basis[:, a:b] @ smooth[:, a:b].T for a, b in spans])


def estimate_noise_correlation(
    row: OrderedProfilePoints, fitted: FittedProfile
) -> NoiseCorrelation:
    """Estimate the correlation of the columns' noise from the residuals of all sides.

    Parameters
    ----------
    row : OrderedProfilePoints
    fitted : FittedProfile
    """
    keep = fitted.keep
    scaled = fitted.residuals[keep] / np.maximum(fitted.sigmas, 1e-9).repeat(fitted.counts)
    return estimate_correlation(
        scaled, row.columns[keep], row.count, int((2 + fitted.curved).sum())
    )


def noise_variances(fitted: FittedProfile) -> Array:
    """Variance of each side's noise, with what its fit took up, in m², shape (k,)."""
    inflation = fitted.noise.variance_inflation
    lost = noise_share_in_fit(2 + fitted.curved, inflation, fitted.counts)
    return np.asarray(fitted.sigmas**2 / (1 - lost))


def undulation_sigmas(fitted: FittedProfile) -> Array:
    """Standard deviation of each side's slow undulation beyond noise, (k,), metres.

    Parameters
    ----------
    fitted : FittedProfile
        Whose noise is known.
    """
    found, block = np.zeros(len(fitted.curves)), UNDULATION_BLOCK
    lags = fitted.noise.lags[:block]
    # Variance of a mean of correlated points, over that of one.
    share = (block * lags[0] + 2 * ((block - np.arange(1, len(lags))) * lags[1:]).sum()) / block**2
    for k, sigma in enumerate(np.sqrt(noise_variances(fitted)).tolist()):
        side = fitted.spans[k]
        own = fitted.residuals[side][fitted.keep[side]]
        count = len(own) // block
        if count < FEWEST_BLOCKS:
            continue
        start = (len(own) - count * block) // 2
        means = own[start : start + count * block].reshape(count, block).mean(axis=1)
        free = max(count - (2 + int(fitted.curved[k])), 1)
        variance = float((means**2).sum()) / free
        expected = sigma**2 * share
        if variance > expected * (1 + SIGNIFICANT_SIGMAS * sqrt(2 / free)):
            found[k] = sqrt((variance - expected) * (1 + 4 / count))
    return found
