"""What is uncertain of a corner because steel is no line, arc or cubic: the model's part.

Noise alone explains how far an average of many points strays. It does not explain a bevel that
undulates, points beside a corner that leave their side together, or a notch that light between
its faces pulls in. What the residuals show of these counts as an error of the sides' heights at
their corners.
"""

from __future__ import annotations

from math import hypot, sqrt
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.models import Side
from tjscan.groove.noise import Correlation
from tjscan.groove.refinement import FittedProfile, Row, noise_variances

BLOCK: Final = 10
"""Points over which residuals are averaged: undulation is longer, most noise is not."""

FEWEST_BLOCKS: Final = 3
"""Blocks that tell undulation from noise."""

SIGNIFICANT: Final = 3.0
"""Standard deviations from which a departure or an undulation is none of chance."""

BESIDE: Final = 1.5e-3
"""Points this near a corner, in metres along their side, belong to its neighbourhood."""

NEAR: Final = 2.0e-3
"""Farther from its side a point is a reflection, in metres."""

FEWEST_BESIDE: Final = 4
"""Points that show a departure."""

JUMP: Final = 0.4e-3
"""Neighbouring points of one surface lie no farther apart, square to it, in metres."""

_MEDIAN: Final = 1.2533  # standard deviation of a median over that of a mean


def shape_errors(
    row: Row, fitted: FittedProfile, model: tuple[Side, ...], noise: Correlation
) -> Array:
    """Standard deviation of the sides' heights at their corners beyond noise, in metres.

    Parameters
    ----------
    row : Row
    fitted : FittedProfile
        k sides.
    model : tuple of Side
        What they are like.
    noise : Correlation
        Of the columns' noise.

    Returns
    -------
    ndarray, shape (k - 1, 2)
        For each corner of the side before and of the side after it.
    """
    sigmas = np.sqrt(noise_variances(fitted, noise))
    slow = _undulations(fitted, noise, sigmas)
    departures = _departures(row, fitted, noise, sigmas)
    errors = np.hypot(np.abs(departures), np.column_stack((slow[:-1], slow[1:])))
    for k, side in enumerate(model):
        if side.bead:
            errors[k - 1 : k + 1] = _with_pull(row, fitted, k, departures, errors)
    return np.asarray(errors)


def _undulations(fitted: FittedProfile, noise: Correlation, sigmas: Array) -> Array:
    """Standard deviation of the slow part of each side's residuals beyond noise, shape (k,)."""
    found = np.zeros(len(fitted.curves))
    lags = noise.lags[:BLOCK]
    # Variance of a mean of correlated points, over that of one.
    share = (BLOCK * lags[0] + 2 * ((BLOCK - np.arange(1, len(lags))) * lags[1:]).sum()) / BLOCK**2
    for k, sigma in enumerate(sigmas.tolist()):
        own = fitted.residuals[fitted.keep & (fitted.owner == k)]
        count = len(own) // BLOCK
        if count < FEWEST_BLOCKS:
            continue
        start = (len(own) - count * BLOCK) // 2
        means = own[start : start + count * BLOCK].reshape(count, BLOCK).mean(axis=1)
        free = max(count - int(fitted.parameters[k]), 1)
        variance = float((means**2).sum()) / free
        expected = sigma**2 * share
        if variance > expected * (1 + SIGNIFICANT * sqrt(2 / free)):
            found[k] = sqrt((variance - expected) * (1 + 4 / count))
    return found


def _departures(row: Row, fitted: FittedProfile, noise: Correlation, sigmas: Array) -> Array:
    """How far the points beside each corner leave its sides, shape (k - 1, 2), in metres."""
    found = np.zeros((len(fitted.corners), 2))
    edges = np.searchsorted(fitted.owner, np.arange(len(fitted.curves) + 1)).tolist()
    near = np.abs(fitted.residuals) < NEAR
    for i, places in enumerate(fitted.places):
        for j, s in enumerate(places):
            a, b = edges[i + j], edges[i + j + 1]
            beside = near[a:b] & (np.abs(fitted.along[a:b] - s) < BESIDE)
            residuals = fitted.residuals[a:b][beside]
            n = len(residuals)
            if n < FEWEST_BESIDE or _jumps(residuals):
                continue
            # Before the corner the row ends at it, after it the row begins there.
            inner, outer = np.array_split(residuals if j else residuals[::-1], 2)
            if abs(np.median(outer)) > abs(np.median(inner)) + SIGNIFICANT * sigmas[i + j]:
                continue  # a reflection that grows out of the corner
            away = float(np.median(residuals))
            chance = _MEDIAN * sigmas[i + j] * sqrt(min(1.0, noise.inflation / n))
            if abs(away) > SIGNIFICANT * chance:
                found[i, j] = away
    return found


def _jumps(residuals: Array) -> bool:
    """Whether a row of residuals jumps, as reflections do, single points apart."""
    a, b, c = residuals[:-2], residuals[1:-1], residuals[2:]
    middle = np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))
    return bool(np.abs(np.diff(middle)).max(initial=0.0) > JUMP)


def _with_pull(row: Row, fitted: FittedProfile, k: int, departures: Array, errors: Array) -> Array:
    """Errors at both corners of a bead, shape (2, 2), where its neighbours are pulled in.

    Where light between the faces of a notch moves the points of its flanks, it moves those of its
    bottom along the rays by as much, and nothing in them shows it.
    """
    found = errors[k - 1 : k + 1].copy()
    pull = 0.0
    for i, side, j in ((k - 1, k - 1, 0), (k, k + 1, 1)):
        x, z = fitted.corners[i].tolist()
        tx, tz = fitted.curves[side].tangent(fitted.places[i][j])
        square = abs(x * tz - z * tx) / hypot(x, z)
        pull = max(pull, -departures[i, j] / max(square, 0.2))
    for i in (0, 1):
        x, z = fitted.corners[k - 1 + i].tolist()
        tx, tz = fitted.curves[k].tangent(fitted.places[k - 1 + i][1 - i])
        found[i, 1 - i] = hypot(found[i, 1 - i], pull * abs(x * tz - z * tx) / hypot(x, z))
    return found
