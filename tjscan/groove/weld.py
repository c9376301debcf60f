"""The surface of a weld in a groove: its points, and the toes where it meets bevel and leg."""

from __future__ import annotations

from math import sqrt
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.reflections import MEETING_REACH, find_runs, gaps_beside_corners
from tjscan.groove.sides import (
    LEAST_NOISE,
    OUTLIER_SIGMAS,
    CubicCurve,
    GrooveFit,
    end_of_support,
    intersect_curves,
)

TOE_REACH: Final = 2.5e-3
"""Points of a weld this near its toe, in metres, show how it meets the flank."""

FEWEST_TOE_POINTS: Final = 4

LEAST_TOE_SIGMA: Final = 0.03e-3
"""Least standard deviation of a toe along its flank, in metres: no bead begins as a line."""

SEEN_TOE_DISTANCE: Final = 0.5e-3
"""A flank that is seen up to its toe ends no farther from it, in metres."""

UNSEEN_TOE_SIGMA: Final = 5e-3
"""The same if too few points show it."""

SURFACE_REACH: Final = 1.5e-3
"""Points this near a fitted weld, in metres, are of its surface: beads leave it by a millimetre."""


def find_toe(fit: GrooveFit, flank: int) -> tuple[float, float, int]:
    """Find where a weld meets one of its flanks.

    Parameters
    ----------
    fit : GrooveFit
        Whose last side but one is the weld.
    flank : int
        Number of the side before or after it.

    Returns
    -------
    s, sigma : float
        Of the toe along the flank, and its standard deviation, in metres.
    first : int
        The first point of the weld as seen from the flank.
    """
    row, fitted = fit.row, fit.fitted
    weld, n = len(fitted.curves) - 2, len(fit.row.points)
    curve, order = fitted.curves[flank], 1 if flank < weld else -1
    # From the far end of the flank to the middle of the weld.
    own, far = fitted.spans[weld], fitted.spans[flank]
    reach = (far.start if order > 0 else far.stop), (own.start + own.stop) // 2
    points = row.points[slice(*reach)] if order > 0 else row.points[slice(*reach[::-1])][::-1]
    limit = OUTLIER_SIGMAS * max(float(fitted.sigmas[flank]), LEAST_NOISE)
    end = max(end_of_support(np.abs(curve.signed_distances(points)) < limit), 1)
    last = points[end - 1]
    beside = points[end:][np.linalg.norm(points[end:] - last, axis=1) < TOE_REACH]
    start = curve.position_along_chord(*last.tolist())
    first = reach[0] + end if order > 0 else reach[0] - 1 - end
    first = min(max(first, 0), n - 1)
    if len(beside) >= FEWEST_TOE_POINTS:
        centre = beside.mean(axis=0)
        spread, axes = np.linalg.eigh(np.cov(beside.T))
        direction = axes[:, 1] * np.sign(axes[:, 1] @ (beside[-1] - beside[0]))
        line = CubicCurve(*centre.tolist(), *direction.tolist())
        met = intersect_curves(curve, line, start)
        if met is not None and abs(met[0] - start) < TOE_REACH:
            tangent = np.array(curve.tangent_at(met[0]))
            sine = abs(float(tangent[0] * direction[1] - tangent[1] * direction[0]))
            share = 4 * min(fitted.variance_inflation / len(beside), 1.0)
            sigma = sqrt(share * max(spread[0], 0.0)) / sine + LEAST_TOE_SIGMA
            # If the flank ends well before, an undercut or a hole hides the toe.
            gap = float(gaps_beside_corners(fitted)[-1 - (order > 0), int(order < 0)])
            sigma += max(abs(met[0] - start) - SEEN_TOE_DISTANCE, 0.0)
            return met[0], sigma + (gap if gap > MEETING_REACH else 0.0), first
    return start, UNSEEN_TOE_SIGMA, first


def weld_surface(fit: GrooveFit, first: int, last: int) -> Array:
    """Points of a weld's surface, shape (m, 2), of those from `first` to `last`, in metres."""
    points = fit.row.points[first : last + 1]
    if not len(points):
        return points
    near = np.abs(fit.fitted.curves[-2].signed_distances(points)) < SURFACE_REACH
    # What hangs together with it is of the surface, too, however high it is.
    runs = find_runs(points, fit.row.columns[first : last + 1])
    return np.asarray(points[np.logical_or.reduceat(near, runs.first).repeat(runs.count)])
