"""A bevel ground or cut in two facets: a knee proposed where one straight side fits badly."""

from __future__ import annotations

from itertools import product
from typing import Final

import numpy as np

from tjscan.groove.curves import CubicCurve
from tjscan.groove.fitted_profile import (
    FittedProfile,
    OrderedProfilePoints,
    corners_between_sides,
)
from tjscan.groove.hypotheses import PolylineHypothesis

KNEE_PLACES: Final = np.array(
    list(
        product(
            (0.03, 0.12, 0.24),
            (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8),
            (0.76, 0.88, 0.97),
        )
    )
)
"""Where, as shares of the side's points, the three points of a proposed pair of lines lie."""

KNEE_REACH: Final = 2.0e-3
"""Farther from the side a point proposes nothing, in metres."""

FEWEST_DIVIDED_POINTS: Final = 12
"""Points of a side that is worth dividing."""


def with_knee(
    row: OrderedProfilePoints, fitted: FittedProfile, k: int, tolerance: float, least_gain: float
) -> PolylineHypothesis | None:
    """Divide a fitted side into the two lines that explain most of its points.

    Parameters
    ----------
    row : OrderedProfilePoints
    fitted : FittedProfile
    k : int
        Number of the side.
    tolerance : float
        Distance within which a point supports a side, in metres.
    least_gain : float
        By how many points two lines must explain more than one side.

    Returns
    -------
    PolylineHypothesis or None
        With one side more; None where no two lines explain that much more.
    """
    own = fitted.points_of(k)
    points, residuals = row.points[own], fitted.residuals[own]
    near = np.flatnonzero(np.abs(residuals) < KNEE_REACH)
    if len(near) < FEWEST_DIVIDED_POINTS:
        return None
    side = fitted.curves[k]
    s, d = side.local_coordinates(points)
    n = len(near) - 1
    triples = near[np.rint(KNEE_PLACES * n).astype(np.intp)]
    s3, d3 = s[triples], d[triples]
    apart = np.diff(s3, axis=1)
    distinct = apart.min(axis=1) > 4 * tolerance
    if not distinct.any():
        return None
    s3, d3 = s3[distinct], d3[distinct]
    slopes = np.diff(d3, axis=1) / apart[distinct]
    along = s - s3[:, 1:2]
    away = d - d3[:, 1:2] - along * np.where(along < 0, slopes[:, :1], slopes[:, 1:])
    cost = np.minimum((away / tolerance) ** 2, 1).sum(axis=1)
    best = int(cost.argmin())
    if cost[best] > np.minimum((residuals / tolerance) ** 2, 1).sum() - least_gain:
        return None
    x, z = side.cx + s3[best, 1] * side.tx, side.cz + s3[best, 1] * side.tz
    height = float(d3[best, 1])
    centre = x + height * side.tz, z - height * side.tx
    facets = [CubicCurve(*centre, side.tx, side.tz, 0.0, float(m)) for m in slopes[best]]
    sides = (*fitted.curves[:k], *facets, *fitted.curves[k + 1 :])
    near_corners = np.insert(fitted.corners, k, centre, axis=0)
    met = corners_between_sides(sides, near_corners)
    return None if met is None else PolylineHypothesis(sides, met[0], np.inf)
