"""By how much a groove explains its points worse without the face at its root, at the least."""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.fitted_profile import (
    FittedProfile,
    OrderedProfilePoints,
    corners_between_sides,
)
from tjscan.groove.hypotheses import bearing_tangents


def least_loss_without_root(
    row: OrderedProfilePoints, fitted: FittedProfile, tolerance: float
) -> float:
    """Bound what leaving out the face at the root costs, before anything is fitted.

    Either its points are left to its neighbours, drawn on to where they meet; or the bevel is
    another line, too, which may explain every point that lies on no side between wall and leg, but
    none of the face's and the bevel's.

    Parameters
    ----------
    row : OrderedProfilePoints
    fitted : FittedProfile
        The last side but one is the face.
    tolerance : float
        Distance at which a point stops supporting a side, in metres.

    Returns
    -------
    float
        In outliers.
    """
    root = len(fitted.curves) - 2
    neighbours = fitted.curves[root - 1], fitted.curves[root + 1]
    met = corners_between_sides(neighbours, fitted.corners[root - 1 : root])
    if met is None:
        return 0.0
    first, (bevel, start, end) = fitted.edges[1], fitted.edges[root - 1 : root + 2]
    pays = _costs(fitted.residuals, tolerance)
    explained = 1 - pays[bevel:end]
    other_bevel = float(explained.sum()) - np.count_nonzero(pays[first:end] == 1)
    apex = int(row.tangents.searchsorted(bearing_tangents(met[0][0])))
    a, b = min(apex, start), max(apex, end)
    left_to_neighbours = sum(
        float(_costs(side.signed_distances(row.points[i:j]), tolerance).sum())
        for side, i, j in zip(neighbours, (a, apex), (apex, b), strict=True)
    )
    return min(other_bevel, left_to_neighbours - float(pays[a:b].sum()))


def _costs(distances: Array, tolerance: float) -> Array:
    """What points at these distances pay."""
    scaled = distances / tolerance
    return np.minimum(scaled * scaled, 1)
