"""Distances from what was measured to what was designed, and their statistics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from tjscan.core.frames import Array, frozen_arrays
from tjscan.joint.edges import FeatureEdges


@dataclass(frozen=True, slots=True)
class DistanceStatistics:
    """Statistics of distances (mean, median, rms, percentile, largest), in millimetres.

    Parameters
    ----------
    mean, median : float
        With their signs, if the distances have one.
    rms : float
        Root of the mean square.
    p95, max : float
        95th percentile and largest, of absolute distances.
    """

    mean: float
    p95: float
    max: float
    rms: float
    median: float

    @classmethod
    def from_distances(cls, distances: Array) -> Self:
        """Statistics of raw distances in metres, any shape; NaN is none."""
        mm = 1e3 * distances[~np.isnan(distances)]
        size = np.abs(mm)
        return cls(
            mean=float(mm.mean()),
            p95=float(np.percentile(size, 95)),
            max=float(size.max()),
            rms=float(np.sqrt(np.mean(mm * mm))),
            median=float(np.median(mm)),
        )


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class DeviationDistances:
    """Distances of one kind between what was measured and its reference.

    Parameters
    ----------
    kind : str
        ``cloud to mesh``, ``cloud to cloud``, ``corners to feature edges`` or ``corners to
        reference cloud``.
    meaning : str
        What the distances are.
    signed : bool
        Whether they are positive outside and negative inside; else they are never negative.
    points : ndarray, shape (n, 3)
        What was measured, in the reference's frame, metres.
    distances : ndarray, shape (n,)
        Metres.
    tolerance : float or None
        Metres.
    """

    kind: str
    meaning: str
    signed: bool
    points: Array
    distances: Array
    tolerance: float | None = None

    @property
    def known(self) -> Array:
        """Distances that are known, shape (k,), metres: a corner that is absent has none."""
        return self.distances[~np.isnan(self.distances)]

    @property
    def within(self) -> float | None:
        """Share of absolute distances within the tolerance; None if there is none."""
        if self.tolerance is None:
            return None
        return float(np.mean(np.abs(self.known) <= self.tolerance))

    @property
    def statistics(self) -> DistanceStatistics:
        """Their statistics, in millimetres."""
        return DistanceStatistics.from_distances(self.distances)


def corner_to_edge_distances(
    points_j: Array, edges: FeatureEdges, absent: NDArray[np.bool_] | None = None
) -> Array:
    """Distances of measured corners from the joint's feature edges.

    Parameters
    ----------
    points_j : ndarray, shape (n, 5, 3)
        The five points of each section in frame j, metres.
    edges : FeatureEdges
        The joint's edges.
    absent : ndarray of bool, shape (n, 3), optional
        Which of p2, p3 and p4 were not seen: they are compared with nothing.

    Returns
    -------
    ndarray, shape (n, 3)
        Distances of p2, p3 and p4, each from its own edge, metres; NaN for p3 and p4 where a
        tack weld buries them, and for corners that are absent.
    """
    lines = (edges.p2, edges.p3, edges.p4)
    errors = [line.distances(points_j[:, i]) for i, line in enumerate(lines, start=1)]
    for i in (1, 2):
        errors[i] = np.where(edges.on_tack(points_j[:, i + 1]), np.nan, errors[i])
    found = np.column_stack(errors)
    return found if absent is None else np.where(absent, np.nan, found)


def distances_to_cloud(points: Array, reference: Array) -> Array:
    """Unsigned distances of points from the nearest points of a cloud, shape (n,), metres.

    They never go below the noise and the spacing of the cloud.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Metres.
    reference : ndarray, shape (m, 3)
        The cloud, metres.
    """
    return np.asarray(KDTree(reference).query(points)[0])


def median_point_spacing(points: Array) -> float:
    """Median distance of a cloud's points, shape (n, 3), from their nearest neighbours."""
    if len(points) < 2:
        return float("nan")
    chosen = points[:: max(1, len(points) // 20_000)]
    return float(np.median(np.asarray(KDTree(points).query(chosen, k=[2])[0])))
