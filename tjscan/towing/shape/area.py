"""The floor that cable and vehicles may use: a polygon with pillars, and discs that may move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import scipy  # its parts are loaded at first use
from numpy.typing import ArrayLike, NDArray

from tjscan.core.frames import Array, readonly_copy

LOOK_AHEAD: Final = 1.0
"""Seconds of an obstacle's way, and of the welder's, that are to be free: delay of the poses, a
period of the loop, and the time in which vehicles stop."""


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """A floor.

    Parameters
    ----------
    outline : ndarray, shape (n, 2)
        Corners in order, metres, either way round; the first is not repeated.
    pillars : tuple of ndarray, shape (m, 2)
        Corners of what is on the floor.
    """

    outline: Array
    pillars: tuple[Array, ...] = ()

    def __init__(self, outline: ArrayLike, pillars: Sequence[ArrayLike] = ()) -> None:
        object.__setattr__(self, "outline", _ordered_corners(outline))
        object.__setattr__(self, "pillars", tuple(_ordered_corners(pillar) for pillar in pillars))


@dataclass(frozen=True, slots=True)
class DiscObstacle:
    """Something round that rests on the floor or moves over it.

    Parameters
    ----------
    x, y : float
        Of its centre now, metres.
    radius : float
        Metres.
    velocity : tuple of float
        Along x and y, m/s.
    name : str
        For messages.

    Raises
    ------
    ValueError
        What is no number: a planner would look for a way round it for ever.
    """

    x: float
    y: float
    radius: float
    velocity: tuple[float, float] = (0.0, 0.0)
    name: str = "an obstacle"

    def __post_init__(self) -> None:
        if not np.isfinite((self.x, self.y, self.radius, *self.velocity)).all():
            raise ValueError(f"an obstacle's place must be finite: {self}")


class Obstacles(NamedTuple):
    """Obstacles as `distance` takes them: each is convex, or a polygon of its own.

    The outside of an outline is the half planes beyond its convex hull's edges, and a polygon for
    every pocket between hull and outline.

    Parameters
    ----------
    walls : ndarray, shape (W, 3)
        Inward normal n and offset c of a wall: the distance of p is n · p - c.
    corners : ndarray, shape (V, 2)
        Of all polygons, one after the other, counter-clockwise.
    starts : ndarray of int, shape (P + 1,)
        Where each polygon begins in `corners`, and their number.
    discs : ndarray, shape (D, 5)
        Discs swept along a line: x and y of the centre at its start and end, and radius.
    """

    walls: Array
    corners: Array
    starts: NDArray[np.int64]
    discs: Array

    @classmethod
    def of_area(cls, area: Floor) -> Obstacles:
        """Walls and polygons of an area."""
        walls, pockets = _half_planes_and_pockets(area.outline)
        polygons = (*pockets, *area.pillars)
        starts = np.cumsum([0, *(len(polygon) for polygon in polygons)])
        corners = np.concatenate((np.zeros((0, 2)), *polygons))
        return cls(walls, corners, starts.astype(np.int64), np.zeros((0, 5)))

    def with_discs(self, discs: Sequence[DiscObstacle], ahead: float) -> Obstacles:
        """The same with discs, each swept by its velocity over the seconds `ahead`."""
        swept = [
            (d.x, d.y, d.x + ahead * d.velocity[0], d.y + ahead * d.velocity[1], d.radius)
            for d in discs
        ]
        return self._replace(discs=np.array(swept, dtype=float).reshape(-1, 5))

    @property
    def polygons(self) -> list[Array]:
        """The polygons' corners, one array each."""
        return [self.corners[a:b] for a, b in pairwise(self.starts.tolist())]


def _half_planes_and_pockets(outline: Array) -> tuple[Array, list[Array]]:
    """Half planes beyond the hull, and pockets between hull and outline."""
    tolerance = 1e-9 * float(np.ptp(outline, axis=0).max())
    # Corners in the middle of a hull's edge may or may not count as its own: take them out.
    hull = [int(i) for i in np.sort(scipy.spatial.ConvexHull(outline).vertices)]
    for i in list(hull):
        at = hull.index(i)
        before, after = outline[hull[at - 1]], outline[hull[(at + 1) % len(hull)]]
        if abs((outline[i] - before) @ _inward_normal(before, after)) < tolerance:
            hull.remove(i)
    walls, pockets = [], []
    for a, b in pairwise((*hull, hull[0] + len(outline))):
        inward = _inward_normal(outline[a], outline[b % len(outline)])
        walls.append((*inward, inward @ outline[a]))
        chain = outline[np.arange(a, b + 1) % len(outline)]
        on_wall = np.flatnonzero(abs(chain @ inward - walls[-1][2]) < tolerance)
        pockets += [chain[i : j + 1][::-1] for i, j in pairwise(on_wall) if j > i + 1]
    return np.array(walls), pockets


def _inward_normal(a: Array, b: Array) -> Array:
    """Normal to the left of the way from a to b."""
    edge = b - a
    return np.asarray(np.array((-edge[1], edge[0])) / np.hypot(*edge))


def _ordered_corners(corners: ArrayLike) -> Array:
    """Read-only copy in counter-clockwise order."""
    points = readonly_copy(corners)
    x, y = points.T
    clockwise = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 0
    return readonly_copy(points[::-1]) if clockwise else points
