"""The narrow root between two long sides: few points, so every pair of them is tried."""

from __future__ import annotations

from dataclasses import dataclass
from math import sin
from typing import Final

import numpy as np

from tjscan.frames import Array
from tjscan.groove.curves import Curve, meet, turn
from tjscan.groove.matching import IN_FRONT, bearing
from tjscan.groove.models import Root

LEAST_TURN: Final = 0.12
"""A root turns at least this much at either of its corners, in radians (7 degrees)."""

MOST_SAMPLES: Final = 26
"""Points among which pairs are formed."""


@dataclass(frozen=True, slots=True)
class RootSearch:
    """What came of looking for a root.

    Parameters
    ----------
    curve : Curve or None
        The best line, if any line cuts the valley off.
    gain : float
        By how many outliers it explains the points better than a sharp valley does.
    lead : float
        By how many outliers it is better than the best line with other corners.
    """

    curve: Curve | None
    gain: float
    lead: float


def find_root(
    points: Array, tangents: Array, before: Curve, after: Curve, root: Root, tolerance: float
) -> RootSearch:
    """Find the line that cuts off the valley between two long sides.

    Every pair of points that lie before both sides proposes a line; its price is that of the
    three sides together, each point charged to the side that its ray hits.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        Ordered from wall to leg.
    tangents : ndarray, shape (n,)
        Their bearings, rising.
    before, after : Curve
        The long sides on the wall's and the leg's side of the root.
    """
    nothing = RootSearch(None, 0.0, 0.0)
    met = meet(before, after, before.along(after.cx, after.cz))
    if met is None:
        return nothing
    valley = before.at(met[0])
    t1, t2 = before.tangent(met[0]), after.tangent(met[1])
    turned = turn(t1, t2)
    # A root of width w meets its sides at most w / sin(turn) from where they meet each other.
    reach = 1.2 * root.widest / max(sin(turned), 0.4) + 2e-3
    close = np.hypot(points[:, 0] - valley[0], points[:, 1] - valley[1]) < reach
    region = np.flatnonzero(close)
    if len(region) < 4:
        return nothing
    lo, hi = int(region[0]), int(region[-1]) + 1
    p, u = points[lo:hi], tangents[lo:hi]
    d1, d2 = before.distances(p) / tolerance, after.distances(p) / tolerance
    pay1, pay2 = _paid(d1[None])[0], _paid(d2[None])[0]

    at_valley = int(np.searchsorted(u, -valley[0] / valley[1]))
    sharp = pay1[at_valley] + pay2[-1] - pay2[at_valley]
    free = np.flatnonzero((d1 < -0.5) & (d2 < -0.5) & close[lo:hi])
    if len(free) < 3:
        return nothing
    free = free[:: -(-len(free) // MOST_SAMPLES)]
    i, j = np.triu_indices(len(free), k=max(1, len(free) // 5))
    a, b = p[free[i]], p[free[j]]
    t = b - a
    t = t / np.sqrt((t * t).sum(axis=1))[:, None]
    corner1 = _line_meets(a, t, np.array(valley), np.array(t1))
    corner2 = _line_meets(a, t, np.array(valley), np.array(t2))
    turn1 = np.arctan2(t1[0] * t[:, 1] - t1[1] * t[:, 0], t1[0] * t[:, 0] + t1[1] * t[:, 1])
    width = ((corner2 - corner1) * t).sum(axis=1)
    good = (turn1 > LEAST_TURN) & (turned - turn1 > LEAST_TURN)
    good &= (width > root.narrowest) & (width < root.widest)
    which = np.flatnonzero(good)
    if not len(which):
        return nothing
    a, t, corner1, corner2 = a[which], t[which], corner1[which], corner2[which]
    n = np.column_stack((t[:, 1], -t[:, 0]))
    d = n @ p.T - (n * a).sum(axis=1)[:, None]
    pay = _paid(d / tolerance)
    i1, i2 = np.searchsorted(u, bearing(corner1)), np.searchsorted(u, bearing(corner2))
    i2 = np.maximum(i1, i2)
    rows = np.arange(len(which))
    price = pay1[i1] + pay[rows, i2] - pay[rows, i1] + pay2[-1] - pay2[i2]
    best = int(price.argmin())
    apart = np.maximum(
        np.abs(corner1 - corner1[best]).max(axis=1), np.abs(corner2 - corner2[best]).max(axis=1)
    )
    others = price[apart > 1e-3]
    lead = float(others.min() - price[best]) if len(others) else np.inf
    m = 0.5 * (corner1[best] + corner2[best])
    curve = Curve(float(m[0]), float(m[1]), float(t[best, 0]), float(t[best, 1]))
    return RootSearch(curve, float(sharp - price[best]), lead)


def _paid(scaled: Array) -> Array:
    """Running sum of the prices of points at scaled distances, shape (m, n) to (m, n + 1)."""
    price = np.minimum(scaled * scaled, 1)
    price[scaled < -1] = IN_FRONT
    paid = np.zeros((len(price), price.shape[1] + 1))
    np.cumsum(price, axis=1, out=paid[:, 1:])
    return paid


def _line_meets(a: Array, t: Array, b: Array, u: Array) -> Array:
    """Where lines a + s t, shape (m, 2) each, meet the line b + r u."""
    with np.errstate(divide="ignore", invalid="ignore"):
        s = ((b[0] - a[:, 0]) * u[1] - (b[1] - a[:, 1]) * u[0]) / (t[:, 0] * u[1] - t[:, 1] * u[0])
        return np.asarray(a + s[:, None] * t)
