"""What a budget states of two points together."""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array
from tjscan.uncertainty.budget import UncertaintyBudget


def covariance_between(
    budget: UncertaintyBudget, one: tuple[int, int], other: tuple[int, int]
) -> Array:
    """Covariance, shape (3, 3), of two points: a section's number and its own, 0 for p1."""
    total = np.zeros((3, 3))
    for part in budget.components:
        if part.is_shared or one[0] == other[0]:
            total += part.points[one] @ part.points[other].T
    return total
