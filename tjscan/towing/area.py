"""The floor that cable and vehicles may use: a polygon with pillars, and discs that may move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tjscan.core.frames import Array, readonly_copy


@dataclass(frozen=True, slots=True, eq=False)
class Area:
    """A floor.

    Parameters
    ----------
    outline : ndarray, shape (n, 2)
        Corners in order, metres, either way round; the first is not repeated.
    pillars : tuple of ndarray, shape (m, 2)
        Corners of what stands on the floor.

    Raises
    ------
    ValueError
        Fewer than three corners, or corners that are no numbers.
    """

    outline: Array
    pillars: tuple[Array, ...] = ()

    def __init__(self, outline: ArrayLike, pillars: Sequence[ArrayLike] = ()) -> None:
        object.__setattr__(self, "outline", _corners(outline))
        object.__setattr__(self, "pillars", tuple(_corners(pillar) for pillar in pillars))


@dataclass(frozen=True, slots=True)
class DiscObstacle:
    """Something round that stands on the floor or moves over it.

    Parameters
    ----------
    x, y : float
        Of its centre now, metres.
    radius : float
        Metres.
    velocity : tuple of float
        Along x and y, m/s.
    """

    x: float
    y: float
    radius: float
    velocity: tuple[float, float] = (0.0, 0.0)


def _corners(corners: ArrayLike) -> Array:
    """Read-only copy in counter-clockwise order."""
    points = readonly_copy(corners)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise ValueError("a polygon needs three corners or more, of x and y each")
    if not np.isfinite(points).all():
        raise ValueError("a polygon's corners must be numbers")
    x, y = points.T
    clockwise = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 0
    return readonly_copy(points[::-1]) if clockwise else points
