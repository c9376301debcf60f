"""Which points of a profile follow one curve: the robust start of every fit."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array, Mask
from tjscan.core.robust import mad_sigma
from tjscan.laser.profile import Profile

HYPOTHESIS_SCORE_POINTS: Final = 96
"""Points at which a hypothesis is scored: enough to rank, few enough to be quick."""
HYPOTHESIS_ANCHOR_POINTS: Final = 14
"""Points from which hypotheses are drawn, evenly spaced; spatter and edges hold only some."""
OUTLIER_SIGMAS: Final = 3.5
"""A point farther from the curve than so many standard deviations does not belong to it."""
MAX_SCATTER_RATIO: Final = 4.0
"""A curve may be so many times rougher than stated before its points count as outliers."""
MIN_CURVE_POINTS: Final = 20
"""A line or an arc has at least so many points."""
MAX_TRIM_ROUNDS: Final = 8
"""Rounds of refitting and trimming; the points in use settle in two or three."""


def valid_points(profile: Profile) -> Array:
    """Points of a profile that hold a measurement: x and z in frame s, shape (n, 2), metres."""
    return np.column_stack((profile.x_s[profile.valid], profile.z_s[profile.valid]))


def columns_of_points(profile: Profile, inlier: Mask) -> Mask:
    """Mask of a profile's columns, from a mask of its valid points."""
    columns = np.zeros(len(profile.valid), dtype=bool)
    columns[np.flatnonzero(profile.valid)[inlier]] = True
    return columns


def evenly_spaced_indices(count: int, wanted: int) -> NDArray[np.intp]:
    """At most `wanted` indices spread over ``range(count)``."""
    return np.unique(np.linspace(0, count - 1, min(count, wanted)).astype(np.intp))


def sample_index_sets(count: int, size: int) -> NDArray[np.intp]:
    """Sets of `size` indices, shape (k, size), spread over ``range(count)``; always the same."""
    anchors = evenly_spaced_indices(count, HYPOTHESIS_ANCHOR_POINTS)
    return np.asarray(anchors[np.array(list(combinations(range(len(anchors)), size)))])


def find_inliers(
    points: Array,
    hypotheses: Array,
    distances: Callable[[Array, Array], Array],
    sigma: float,
    scored: int = HYPOTHESIS_SCORE_POINTS,
) -> Mask:
    """Points close to the one of many curves that most of them are close to, shape (n,).

    Distances count squared and, beyond the tolerance, all the same (MSAC, Torr and Zisserman
    2000, doi:10.1006/cviu.1999.0832).

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        Valid points of a profile, metres.
    hypotheses : ndarray, shape (k, m)
        Parameters of the curves.
    distances : callable
        From points, shape (n, 2), and curves, shape (k, m), to distances, shape (k, n), metres.
    sigma : float
        Standard deviation of a point, metres.
    scored : int
        Number of points that rank the curves.
    """
    if not len(hypotheses):
        return np.zeros(len(points), dtype=bool)
    tolerance = 2 * OUTLIER_SIGMAS * sigma
    few = points[evenly_spaced_indices(len(points), scored)]
    cost = np.minimum(np.square(distances(few, hypotheses)), tolerance**2).sum(axis=1)
    best = hypotheses[[int(np.argmin(cost))]]
    return np.asarray(np.abs(distances(points, best)[0]) < tolerance)


def inlier_scatter(residuals: Array, stated: float) -> float:
    """Standard deviation of points near the curve, from `stated` to `MAX_SCATTER_RATIO` times it.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        Distances of all points from the curve, metres.
    stated : float
        Standard deviation that the noise model states, metres.
    """
    near = np.abs(residuals)[np.abs(residuals) < OUTLIER_SIGMAS * MAX_SCATTER_RATIO * stated]
    spread = mad_sigma(near) if near.size else stated
    return min(max(spread, stated), MAX_SCATTER_RATIO * stated)


def refit_and_trim(residuals_of: Callable[[Mask], Array], inlier: Mask, stated: float) -> Mask:
    """Refit and trim until the points that belong to the curve no longer change.

    Parameters
    ----------
    residuals_of : callable
        Gives the residuals of all points, shape (n,), from the curve through those of a mask.
    inlier : ndarray of bool, shape (n,)
        The points to start with.
    stated : float
        Standard deviation that the noise model states.
    """
    for _ in range(MAX_TRIM_ROUNDS):
        residuals = residuals_of(inlier)
        kept = np.abs(residuals) < OUTLIER_SIGMAS * inlier_scatter(residuals, stated)
        if (kept == inlier).all() or kept.sum() < 3:
            break
        inlier = kept
    return inlier
