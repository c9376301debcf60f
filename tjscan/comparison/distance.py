"""Distances from what was measured to what was designed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from tjscan.frames import Array
from tjscan.joint.edges import FeatureEdges


@dataclass(frozen=True, slots=True)
class DistanceStatistics:
    """Spread of distances, in millimetres.

    Parameters
    ----------
    mean, p95, max : float
        Mean, 95th percentile and largest distance, mm.
    """

    mean: float
    p95: float
    max: float

    @classmethod
    def of(cls, distances: Array) -> Self:
        """Statistics of raw distances in metres, any shape."""
        mm = 1e3 * distances
        return cls(float(mm.mean()), float(np.percentile(mm, 95)), float(mm.max()))


def corner_errors(points_j: Array, edges: FeatureEdges) -> Array:
    """Distances of measured corners from the joint's feature edges.

    Parameters
    ----------
    points_j : ndarray, shape (n, 5, 3)
        The five points of each section in frame j, metres.
    edges : FeatureEdges
        The joint's edges.

    Returns
    -------
    ndarray, shape (n, 3)
        Distances of p2, p3 and p4, each from its own edge, metres.
    """
    lines = (edges.p2, edges.p3, edges.p4)
    return np.column_stack([line.distance(points_j[:, i]) for i, line in enumerate(lines, start=1)])
