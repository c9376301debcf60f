"""Which points of a profile follow one curve: the robust start of the line and circle fits."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.core.robust import mad_sigma

SCORED_POINTS: Final = 96
"""Points at which a hypothesis is scored: enough to rank, few enough to be quick."""
ANCHOR_POINTS: Final = 14
"""Points from which hypotheses are drawn, evenly spaced; spatter and edges hold only some."""
OUTLIER_SIGMAS: Final = 3.5
"""A point farther from the curve than so many standard deviations does not belong to it."""
MAX_SCATTER_RATIO: Final = 4.0
"""A curve may be so many times rougher than stated before its points count as outliers."""

InlierMask = NDArray[np.bool_]


def evenly_spaced_indices(count: int, wanted: int) -> NDArray[np.intp]:
    """At most `wanted` indices spread over ``range(count)``.

    Parameters
    ----------
    count : int
        Length of the range.
    wanted : int
        How many indices to return at most.
    """
    return np.unique(np.linspace(0, count - 1, min(count, wanted)).astype(np.intp))


def sample_index_sets(count: int, size: int) -> NDArray[np.intp]:
    """Index sets, shape (k, size), spread over ``range(count)``; the same ones every time.

    Parameters
    ----------
    count : int
        Number of points to draw from.
    size : int
        Points in each set.
    """
    anchors = evenly_spaced_indices(count, ANCHOR_POINTS)
    return np.asarray(anchors[np.array(list(combinations(range(len(anchors)), size)))])


def best_hypothesis(distances: Array, tolerance: float) -> int:
    """Index of the hypothesis that most points lie close to.

    Distances count squared and, beyond the tolerance, all the same (MSAC, Torr and Zisserman
    2000, doi:10.1006/cviu.1999.0832).

    Parameters
    ----------
    distances : ndarray, shape (k, n)
        Of n points from k hypotheses, metres.
    tolerance : float
        Distance beyond which a point counts as an outlier, metres.
    """
    cost = np.minimum(np.square(distances), tolerance**2).sum(axis=1)
    return int(np.argmin(cost))


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


def refit_and_trim(
    residuals_of: Callable[[InlierMask], Array], inlier: InlierMask, stated: float
) -> InlierMask:
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
    for _ in range(8):
        residuals = residuals_of(inlier)
        kept = np.abs(residuals) < OUTLIER_SIGMAS * inlier_scatter(residuals, stated)
        if (kept == inlier).all() or kept.sum() < 3:
            break
        inlier = kept
    return inlier
