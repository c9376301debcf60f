"""Distances from what was measured to what was designed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from tjscan.frames import Array


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
