"""Segments in an ordered row of points: many short windows vote, the best stretches are kept.

A robust search in the manner of MSAC, but over a fixed set of windows instead of random pairs,
so that the same profile always gives the same answer. Every window's line is judged by the best
*stretch* of points it explains: a point on the stretch counts by its distance, an outlier within
the stretch costs a little, and points before and after it do not count. A few slightly curved
lines come out, straight from the sides of the groove and from whatever reflections look alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.frames import Array

Index = NDArray[np.intp]

WINDOWS: Final = (10, 20, 40, 80)
"""Lengths of the windows, in points."""

THINNED: Final = 210
"""About how many points the search looks at: noise is correlated over more than what it skips."""

GAP_COST: Final = 0.15
"""What an outlier costs a stretch, in points."""

CURVATURE_SPREAD: Final = 3.0
"""Standard deviation of a side's curvature coefficient, 1/m: pipes of a radius of 170 mm."""

KEPT: Final = 20
"""Most segments kept."""


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """m slightly curved segments: ``centre + s direction + (c0 + c1 s + c2 s²) normal``.

    Directions go from the wall to the leg; the normal points away from the sensor.

    Parameters
    ----------
    centre, direction : ndarray, shape (m, 2)
        A point and the unit direction of the chord, x and z in the sensor plane, metres.
    curve : ndarray, shape (m, 3)
        Coefficients c0, c1, c2.
    first, last : ndarray, shape (m,)
        First and last point of the stretch, both inclusive.
    """

    centre: Array
    direction: Array
    curve: Array
    first: Index
    last: Index

    def __len__(self) -> int:
        return len(self.centre)

    def take(self, which: Index) -> Segments:
        """Segments at the indices `which`."""
        return Segments(*(getattr(self, name)[which] for name in self.__slots__))

    def local(self, points: Array) -> tuple[Array, Array]:
        """Coordinates of points, shape (n, 2), along and away from each chord, (m, n) each."""
        t = self.direction
        n = normals(t)
        s = t @ points.T - (t * self.centre).sum(axis=1)[:, None]
        d = n @ points.T - (n * self.centre).sum(axis=1)[:, None]
        return s, d

    def distances(self, points: Array) -> Array:
        """Signed distances of points, shape (n, 2), behind each curve, shape (m, n)."""
        s, d = self.local(points)
        c0, c1, c2 = self.curve.T[:, :, None]
        return np.asarray(d - (c0 + s * (c1 + s * c2)))


def normals(directions: Array) -> Array:
    """Unit normals, shape (..., 2), on the far side of directions that go from wall to leg."""
    return np.stack((directions[..., 1], -directions[..., 0]), axis=-1)


def thin(points: Array) -> Array:
    """Every k-th point, so that about `THINNED` are left."""
    return points[:: max(1, round(len(points) / THINNED))]


def find_segments(points: Array, tolerance: float) -> Segments:
    """Find the segments that a row of points is made of.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        x and z in metres, ordered from wall to leg, thinned.
    tolerance : float
        Distance from a segment at which a point stops supporting it, in metres.
    """
    row = thin(points)
    segments = _windows(points, tolerance)
    gain = _gains(segments.distances(row), tolerance)
    segments = _distinct(_stretched(segments, gain), gain)
    for _ in range(2):
        segments = _refitted(segments, row, tolerance)
        gain = _gains(segments.distances(row), tolerance)
        segments, score = _stretched(segments, gain)
    return _distinct((segments, score), gain)


def _windows(points: Array, tolerance: float) -> Segments:
    """Total least-squares lines through windows of several lengths, where they fit well."""
    n = len(points)
    lengths = [k for k in WINDOWS if k <= n]
    first = np.concatenate([np.arange(0, n - k + 1, k // 2) for k in lengths])
    last = first + np.concatenate([np.full(len(range(0, n - k + 1, k // 2)), k) for k in lengths])
    origin = points.mean(axis=0)
    x, z = (points - origin).T
    sums = np.zeros((5, n + 1))
    np.cumsum((x, z, x * x, x * z, z * z), axis=1, out=sums[:, 1:])
    mx, mz, xx, xz, zz = (sums[:, last] - sums[:, first]) / (last - first)
    angle = 0.5 * np.arctan2(2 * (xz - mx * mz), (xx - mx * mx) - (zz - mz * mz))
    direction = np.column_stack((np.cos(angle), np.sin(angle)))
    along = ((points[last - 1] - points[first]) * direction).sum(axis=1)
    direction[along < 0] *= -1
    centre = np.column_stack((mx, mz)) + origin
    across = direction[:, 1] ** 2 * (xx - mx * mx) + direction[:, 0] ** 2 * (zz - mz * mz)
    across -= 2 * direction[:, 0] * direction[:, 1] * (xz - mx * mz)
    good = across < (tolerance / 2) ** 2
    row = Segments(centre, direction, np.zeros((len(first), 3)), first, last - 1)
    return row.take(np.flatnonzero(good))


def _gains(distance: Array, tolerance: float) -> Array:
    """What each point adds to each stretch: one on the line, `-GAP_COST` off it."""
    scaled = distance / tolerance
    return np.maximum(1 - scaled * scaled, -GAP_COST)


def _stretched(segments: Segments, gain: Array) -> tuple[Segments, Array]:
    """Give each segment the stretch of points of the highest total gain (Kadane's algorithm)."""
    rows = np.arange(len(gain))
    total = np.cumsum(gain, axis=1)
    lowest = np.minimum(np.minimum.accumulate(total, axis=1), 0)
    rise = total - lowest + np.maximum(gain, 0) * 0
    last = rise.argmax(axis=1)
    score = rise[rows, last]
    below = lowest[rows, last]
    first = np.where(below < 0, (total == below[:, None]).argmax(axis=1) + 1, 0)
    return (
        Segments(
            segments.centre, segments.direction, segments.curve, first, np.maximum(first, last)
        ),
        score,
    )


def _distinct(scored: tuple[Segments, Array], gain: Array) -> Segments:
    """Keep the segments that are the best one over some point."""
    segments, score = scored
    index = np.arange(gain.shape[1])
    over = (segments.first[:, None] <= index) & (index <= segments.last[:, None]) & (gain > 0)
    winners = np.unique((over * score[:, None]).argmax(axis=0))
    best = winners[np.argsort(-score[winners], kind="stable")[:KEPT]]
    return segments.take(best)


def _refitted(
    scored: Segments | tuple[Segments, Array], points: Array, tolerance: float
) -> Segments:
    """Least-squares parabola through the supporting points of every segment."""
    segments = scored if isinstance(scored, Segments) else scored[0]
    index = np.arange(len(points))
    s, d = segments.local(points)
    c0, c1, c2 = segments.curve.T[:, :, None]
    w = (np.abs(d - (c0 + s * (c1 + s * c2))) < tolerance).astype(float)
    w *= (segments.first[:, None] <= index) & (index <= segments.last[:, None])
    ws = w * s
    wss = ws * s
    m0, m1, m2 = w.sum(1), ws.sum(1), wss.sum(1)
    m3, m4 = (wss * s).sum(1), (wss * s * s).sum(1)
    b = np.stack(((w * d).sum(1), (ws * d).sum(1), (wss * d).sum(1)), axis=1)
    prior = (tolerance / 2 / CURVATURE_SPREAD) ** 2
    a = np.array([[m0 + 1e-9, m1, m2], [m1, m2 + 1e-15, m3], [m2, m3, m4 + prior]])
    scale = np.array([1.0, 1e-2, 1e-4])
    a *= scale[:, None, None] * scale[:, None]
    curve = np.linalg.solve(a.transpose(2, 0, 1), (b * scale)[:, :, None])[:, :, 0] * scale
    return Segments(segments.centre, segments.direction, curve, segments.first, segments.last)
