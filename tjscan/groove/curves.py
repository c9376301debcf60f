"""One side of a groove as a shallow parabola over its chord: fit, corner, covariance."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, hypot
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.frames import Array

STEEPEST: Final = 0.5
"""Largest slope over its chord that a side may have where it meets its neighbour."""


@dataclass(frozen=True, slots=True)
class Curve:
    """``centre + s direction + (c0 + c1 s + c2 s²) normal``, in metres, as plain numbers.

    The direction runs from the wall to the leg, the normal (tz, -tx) away from the sensor.
    """

    cx: float
    cz: float
    tx: float
    tz: float
    c0: float = 0.0
    c1: float = 0.0
    c2: float = 0.0

    def local(self, points: Array) -> tuple[Array, Array]:
        """Coordinates of points, shape (n, 2), along and away from the chord, (n,) each."""
        x, z = points[:, 0] - self.cx, points[:, 1] - self.cz
        return x * self.tx + z * self.tz, x * self.tz - z * self.tx

    def height(self, s: float) -> tuple[float, float]:
        """Height over the chord and slope at s."""
        return self.c0 + s * (self.c1 + s * self.c2), self.c1 + 2 * s * self.c2

    def distances(self, points: Array) -> Array:
        """Signed distances of points, shape (n, 2), behind the curve, shape (n,)."""
        s, d = self.local(points)
        return np.asarray(d - (self.c0 + s * (self.c1 + s * self.c2)))

    def at(self, s: float) -> tuple[float, float]:
        """Point at s."""
        q, _ = self.height(s)
        return (self.cx + s * self.tx + q * self.tz, self.cz + s * self.tz - q * self.tx)

    def tangent(self, s: float) -> tuple[float, float]:
        """Unit tangent at s."""
        _, dq = self.height(s)
        scale = 1 / hypot(1.0, dq)
        return (self.tx + dq * self.tz) * scale, (self.tz - dq * self.tx) * scale

    def along(self, x: float, z: float) -> float:
        """The s of a point."""
        return (x - self.cx) * self.tx + (z - self.cz) * self.tz


def meet(a: Curve, b: Curve, start: float) -> tuple[float, float] | None:
    """Values of s on `a` and on `b` where they meet, by Newton's method from `start` on `a`.

    None where they do not meet near enough to say.
    """
    rx, rz = a.cx - b.cx, a.cz - b.cz
    along, away = rx * b.tx + rz * b.tz, rx * b.tz - rz * b.tx
    cos, sin = a.tx * b.tx + a.tz * b.tz, a.tx * b.tz - a.tz * b.tx
    s = start
    for _ in range(12):
        q, dq = a.height(s)
        sb = along + s * cos - q * sin
        qb, dqb = b.height(sb)
        slope = sin + dq * cos - dqb * (cos - dq * sin)
        if abs(slope) < 1e-3:
            return None
        step = (away + s * sin + q * cos - qb) / slope
        s -= step
        if abs(step) < 1e-10:
            break
    if not abs(s) < 1.0 or abs(dq) > STEEPEST or abs(dqb) > STEEPEST:
        return None
    q, _ = a.height(s)
    return s, along + s * cos - q * sin


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A curve fitted to points by least squares.

    Parameters
    ----------
    curve : Curve
    basis : ndarray, shape (k, n)
        Derivatives of the height by the k free coefficients, at all points of the side.
    inverse : ndarray, shape (k, k)
        Inverse of the normal matrix.
    residuals : ndarray, shape (n,)
        Distances behind the curve, of all points of the side, in metres.
    keep : ndarray of bool, shape (n,)
        Points the fit rests on.
    """

    curve: Curve
    basis: Array
    inverse: Array
    residuals: Array
    keep: NDArray[np.bool_]


def fit(points: Array, keep: NDArray[np.bool_], before: Curve, degree: int) -> Fit | None:
    """Least-squares line (`degree` 1) or parabola (2) through the kept points.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
    keep : ndarray of bool, shape (n,)
    before : Curve
        Where the side was thought to be: its tangent becomes the chord.
    degree : int
    """
    count = int(np.count_nonzero(keep))
    if count < degree + 2:
        return None
    kept = points[keep]
    mx, mz = float(kept[:, 0].sum()) / count, float(kept[:, 1].sum()) / count
    tx, tz = before.tangent(before.along(mx, mz))
    frame = Curve(mx, mz, tx, tz)
    s, d = frame.local(points)
    basis = np.empty((degree + 1, len(points)))
    basis[0] = 1.0
    basis[1] = s
    if degree == 2:
        np.multiply(s, s, out=basis[2])
    used = basis[:, keep]
    scale = 1.0 / np.sqrt((used * used).sum(axis=1))
    normal = (used @ used.T) * (scale[:, None] * scale)
    try:
        inverse = np.linalg.inv(normal) * (scale[:, None] * scale)
    except np.linalg.LinAlgError:
        return None
    c = inverse @ (used @ d[keep])
    residuals = d - c @ basis
    curve = Curve(mx, mz, tx, tz, float(c[0]), float(c[1]), float(c[2]) if degree == 2 else 0.0)
    return Fit(curve, basis, inverse, residuals, keep)


def turn(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Angle from direction `a` to `b`, positive in a valley, in radians."""
    return atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])
