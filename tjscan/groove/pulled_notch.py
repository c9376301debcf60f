"""How far light that one face throws onto the other pulls a notch in, towards the sensor."""

from __future__ import annotations

from math import inf, sqrt
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.curves import CubicCurve
from tjscan.groove.fitted_profile import (
    LEAST_NOISE,
    OUTLIER_SIGMAS,
    FittedProfile,
    OrderedProfilePoints,
    estimate_noise_correlation,
)
from tjscan.groove.models import GrooveModel
from tjscan.groove.shape import LEAST_RAY_SINE, UNDULATION_BLOCK, undulation_sigmas

PULL_REACH: Final = 4e-3
"""Distance from a notch in metres within which points are pulled in: real profiles
show 3 to 5 mm."""

PULL_DOUBT: Final = 0.15
"""Share of itself by which a pull is uncertain, for its reach is."""

FEWEST_PULLED_POINTS: Final = 4
"""Points about a notch that show a pull."""


def closeness_to_notch(points: Array, notch: Array) -> Array:
    """Share of the pull that points take, shape (n,): a raised cosine of their distance.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
    notch : ndarray, shape (m, 2)
        Its corners, x and z in metres.
    """
    away = np.linalg.norm(points[:, None] - notch, axis=2).min(axis=1)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * np.minimum(away / PULL_REACH, 1.0)))


def sines_with_rays(curve: CubicCurve, points: Array) -> Array:
    """Sines of the angles between a side and the rays to points, shape (n, 2)."""
    square = points @ np.array((curve.tz, -curve.tx)) / np.linalg.norm(points, axis=1)
    return np.asarray(np.maximum(np.abs(square), LEAST_RAY_SINE))


def estimate_pull(
    row: OrderedProfilePoints, fitted: FittedProfile, model: GrooveModel
) -> tuple[float, float]:
    """Estimate a pull from the flanks of a root with a face: weighted least squares.

    Parameters
    ----------
    row : OrderedProfilePoints
        Its points may lie elsewhere than those of the fit.
    fitted : FittedProfile
    model : GrooveModel
        Whose last side but one is the root's face.

    Returns
    -------
    float, float
        In metres, and its standard deviation, infinite where nothing shows it. It may come out
        negative.
    """
    noise = fitted.noise or estimate_noise_correlation(row, fitted)
    slow = undulation_sigmas(fitted)
    closeness = closeness_to_notch(row.points, fitted.corners[-2:])
    value, information = 0.0, 0.0
    last = len(fitted.curves) - 1
    for k in (last - 2, last):
        own, side = fitted.points_of(k), model.sides[k]
        curve = fitted.curves[k].rebased_at_tangent(fitted.middles[k])
        points = row.points[own]
        s, d = curve.local_coordinates(points)
        pull = -closeness[own] * sines_with_rays(curve, points)
        close = closeness[own] > 0
        off = d - (curve.c0 + s * (curve.c1 + s * (curve.c2 + s * curve.c3)))
        sigma = max(float(fitted.sigmas[k]), LEAST_NOISE)
        used = fitted.keep[own] | (close & (np.abs(off) < 2 * OUTLIER_SIGMAS * sigma))
        if np.count_nonzero(close & used) < FEWEST_PULLED_POINTS:
            continue
        expected = curve.c2 if side.expected_bend is None and side.bend > 1 else side.expected_bend
        basis = np.stack([s[used] ** p for p in range(4)])
        g, y = pull[used], d[used] - (expected or 0.0) * basis[2]
        variance = sigma**2 * noise.variance_inflation + UNDULATION_BLOCK * float(slow[k]) ** 2
        known = np.zeros(4)
        known[2:] = variance / np.maximum((side.bend, side.twist), 1e-3) ** 2
        taken = np.linalg.solve(basis @ basis.T + np.diag(known), basis @ np.column_stack((g, y)))
        left = g - taken[:, 0] @ basis
        value += float(left @ y) / variance
        information += float(left @ g) / variance
    if information <= 0:
        return 0.0, inf
    return value / information, 1 / sqrt(information)
