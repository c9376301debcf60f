"""How a groove's section changes round the brace: slowly, and nothing else is known of it."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Final, Self

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from tjscan.core.frames import Array, readonly

SMOOTH: Final = radians(30.0)
"""Azimuth over which the section of a groove changes its shape."""


def likeness(a: Array, b: Array) -> Array:
    """Correlation of what lies at azimuths (n,) and at azimuths (m,), shape (n, m).

    Near by it falls as a bell curve does, and round the brace it closes.
    """
    return np.asarray(np.exp((np.cos(a[:, None] - b) - 1) / SMOOTH**2))


def likeness_slope(a: Array, b: Array) -> Array:
    """Derivative of `likeness` by the first azimuths, shape (n, m)."""
    return np.asarray(-np.sin(a[:, None] - b) / SMOOTH**2 * likeness(a, b))


@dataclass(frozen=True, slots=True, eq=False)
class SmoothValue:
    """A value that was measured here and there, as a Gaussian process over the azimuth.

    Parameters
    ----------
    azimuth : ndarray, shape (n,)
        Where it was measured, radians.
    weight : ndarray, shape (n,)
        What the curve is made of.
    """

    azimuth: Array
    weight: Array

    def __post_init__(self) -> None:
        for name in ("azimuth", "weight"):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    @classmethod
    def through(cls, azimuth: Array, value: Array, sigma: float) -> Self:
        """Curve of values, shape (n,), with a standard deviation."""
        spread = float(np.ptp(value)) + 10 * sigma
        total = spread**2 * likeness(azimuth, azimuth) + sigma**2 * np.eye(len(azimuth))
        return cls(azimuth, spread**2 * cho_solve(cho_factor(total), value - value.mean()))

    def change(self, start: float, by: float) -> float:
        """How much the value grows on the way from an azimuth to `by` beyond it."""
        both = likeness(np.array((start, start + by)), self.azimuth)
        return float((both[1] - both[0]) @ self.weight)
