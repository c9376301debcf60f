"""One side of a groove as a shallow cubic over its chord, and where two sides meet."""

from __future__ import annotations

from math import hypot, sqrt
from typing import Final, NamedTuple

import numpy as np

from tjscan.core.frames import Array

STEEPEST_SLOPE: Final = 1.5
"""Largest slope over its chord that a side may have where it meets its neighbour."""

_FARTHEST_CORNER: Final = 1.0  # metres along a side: no corner lies there
_PARALLEL_SINE: Final = 1e-3  # sine below which two sides do not meet
_SETTLED_STEP: Final = 1e-10  # metres


class CubicCurve(NamedTuple):
    """Cubic curve over a chord: ``centre + s direction + (c0 + c1 s + c2 s² + c3 s³) normal``.

    The direction runs from the wall to the leg, the normal (tz, -tx) away from the sensor.
    """

    cx: float
    cz: float
    tx: float
    tz: float
    c0: float = 0.0
    c1: float = 0.0
    c2: float = 0.0
    c3: float = 0.0

    def local_coordinates(self, points: Array) -> tuple[Array, Array]:
        """Coordinates of points, shape (n, 2), along and away from the chord, (n,) each."""
        x, z = points[:, 0] - self.cx, points[:, 1] - self.cz
        return x * self.tx + z * self.tz, x * self.tz - z * self.tx

    def height_and_slope(self, s: float) -> tuple[float, float]:
        """Height over the chord and slope at s."""
        return (
            self.c0 + s * (self.c1 + s * (self.c2 + s * self.c3)),
            self.c1 + s * (2 * self.c2 + 3 * s * self.c3),
        )

    def signed_distances(self, points: Array) -> Array:
        """Signed distances of points, shape (n, 2), from the curve, positive behind it, (n,)."""
        s, d = self.local_coordinates(points)
        return np.asarray(d - (self.c0 + s * (self.c1 + s * (self.c2 + s * self.c3))))

    def points_at(self, s: float) -> tuple[float, float]:
        """Point of the curve at s."""
        q, _ = self.height_and_slope(s)
        return self.cx + s * self.tx + q * self.tz, self.cz + s * self.tz - q * self.tx

    def tangent_at(self, s: float) -> tuple[float, float]:
        """Unit tangent of the curve at s."""
        _, slope = self.height_and_slope(s)
        scale = 1 / hypot(1.0, slope)
        return (self.tx + slope * self.tz) * scale, (self.tz - slope * self.tx) * scale

    def position_along_chord(self, x: float, z: float) -> float:
        """Parameter s of a point, along the chord."""
        return (x - self.cx) * self.tx + (z - self.cz) * self.tz

    def rebased_at_tangent(self, s: float) -> CubicCurve:
        """Nearly the same curve, written over its tangent at s."""
        q, slope = self.height_and_slope(s)
        square = 1 + slope * slope
        scale = 1 / sqrt(square)
        return CubicCurve(
            self.cx + s * self.tx + q * self.tz,
            self.cz + s * self.tz - q * self.tx,
            (self.tx + slope * self.tz) * scale,
            (self.tz - slope * self.tx) * scale,
            0.0,
            0.0,
            (self.c2 + 3 * s * self.c3) / (square * sqrt(square)),
            self.c3,
        )


def intersect_curves(a: CubicCurve, b: CubicCurve, start: float) -> tuple[float, float] | None:
    """Intersection of two curves: values of s on `a` and on `b`, by Newton's method from `start`.

    None where they do not meet near enough to say.
    """
    ax, az, atx, atz, a0, a1, a2, a3 = a
    bx, bz, btx, btz, b0, b1, b2, b3 = b
    rx, rz = ax - bx, az - bz
    along, away = rx * btx + rz * btz, rx * btz - rz * btx
    cos, sin = atx * btx + atz * btz, atx * btz - atz * btx
    s = start
    for _ in range(12):
        q, dq = a0 + s * (a1 + s * (a2 + s * a3)), a1 + s * (2 * a2 + 3 * s * a3)
        sb = along + s * cos - q * sin
        qb, dqb = b0 + sb * (b1 + sb * (b2 + sb * b3)), b1 + sb * (2 * b2 + 3 * sb * b3)
        slope = sin + dq * cos - dqb * (cos - dq * sin)
        if abs(slope) < _PARALLEL_SINE:
            return None
        step = (away + s * sin + q * cos - qb) / slope
        s -= step
        if abs(step) < _SETTLED_STEP:
            break
    if not abs(s) < _FARTHEST_CORNER or abs(dq) > STEEPEST_SLOPE or abs(dqb) > STEEPEST_SLOPE:
        return None
    q, _ = a.height_and_slope(s)
    return s, along + s * cos - q * sin
