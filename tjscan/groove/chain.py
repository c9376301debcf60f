"""Which segments are the sides of the groove: a template laid over them by dynamic programming.

A hypothesis names a segment for every long side. Its corners are the intersections of
neighbours, and each point pays, up to a limit, for its distance to the side that its ray would
hit. Because that price is a sum over pairs of neighbours, the cheapest of all hypotheses (and
every rival to it) is found without trying them one by one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.frames import Array
from tjscan.groove.models import GrooveModel
from tjscan.groove.segments import Index, Segments

IN_FRONT: Final = 1.5
"""Price of a point before the surface, in outliers: reflections lie behind it, seldom before."""

MARGIN: Final = 0.06
"""Rivals within this share of the points are looked at more closely."""

MOST_RIVALS: Final = 4

DISTINCT: Final = 1e-3
"""Hypotheses that differ less than this at every corner are the same one, in metres."""

_NEWTON_STEPS: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One segment for every long side.

    Parameters
    ----------
    sides : Segments
        The long sides, from the wall.
    corners : ndarray, shape (m - 1, 2)
        Where neighbours meet, x and z in metres.
    cost : float
        Price of all points, in outliers.
    """

    sides: Segments
    corners: Array
    cost: float


@dataclass(frozen=True, slots=True, eq=False)
class _Pairs:
    """Every ordered pair of segments (a before b) as neighbours; arrays of shape (m, m, ...)."""

    corner: Array
    turn: Array
    place: Index


def bearing(points: Array) -> Array:
    """Tangent of the angle of points, shape (..., 2), seen from the sensor; grows wall to leg."""
    return np.asarray(-points[..., 0] / points[..., 1])


def match(
    model: GrooveModel, segments: Segments, points: Array, tolerance: float
) -> list[Hypothesis]:
    """Hypotheses by rising cost: the cheapest and its distinct rivals; none if nothing fits."""
    m, n = len(segments), len(points)
    if m < 2:
        return []
    scaled = segments.distances(points) / tolerance
    price = np.minimum(scaled * scaled, 1)
    support = np.zeros((m, n + 1))
    np.cumsum(1 - price, axis=1, out=support[:, 1:])
    price[scaled < -1] = IN_FRONT
    paid = np.zeros((m, n + 1))
    np.cumsum(price, axis=1, out=paid[:, 1:])
    pairs = _pairs(segments, points)
    place = pairs.place
    rows = np.arange(m)
    pay = paid[rows[:, None], place] - paid[rows[None, :], place]
    # Points that support the part of a side before and after a place.
    good_a = support[rows[:, None], place]
    good_b = support[:, -1][None, :] - support[rows[None, :], place]
    inside = (place > 0) & (place < n)

    terms = []
    for k, corner in enumerate(model.corners):
        allowed = inside & (pairs.turn >= corner.least) & (pairs.turn <= corner.most)
        if k == 0:
            allowed &= good_a >= 4
        if k == len(model.corners) - 1:
            allowed &= good_b >= 4
        terms.append(np.where(allowed, pay, np.inf))
    terms[-1] = terms[-1] + paid[:, -1][None, :]
    return _best_chains(model, segments, pairs, terms, support, n)


def _pairs(segments: Segments, points: Array) -> _Pairs:
    """Meet every segment's end with every other's start, by Newton's method from the chords."""
    a_c, a_t, a_q = (v[:, None] for v in (segments.centre, segments.direction, segments.curve))
    b_c, b_t, b_q = (v[None] for v in (segments.centre, segments.direction, segments.curve))
    rel = a_c - b_c
    along = _dot(rel, b_t)
    away = rel[..., 0] * b_t[..., 1] - rel[..., 1] * b_t[..., 0]
    cos = _dot(a_t, b_t)
    sin = a_t[..., 0] * b_t[..., 1] - a_t[..., 1] * b_t[..., 0]
    ends = points[segments.last] - segments.centre
    s = np.repeat(_dot(ends, segments.direction)[:, None], len(segments), axis=1)
    with np.errstate(all="ignore"):
        for _ in range(_NEWTON_STEPS):
            q, dq = _curve(a_q, s)
            sb = along + s * cos - q * sin
            f = away + s * sin + q * cos
            qb, dqb = _curve(b_q, sb)
            slope = (sin + dq * cos) - dqb * (cos - dq * sin)
            s = s - (f - qb) / slope
        q, dq = _curve(a_q, s)
        sb = along + s * cos - q * sin
        _, dqb = _curve(b_q, sb)
        normal = np.stack((a_t[..., 1], -a_t[..., 0]), axis=-1)
        corner = a_c + s[..., None] * a_t + q[..., None] * normal
        turn = np.arctan2(sin, cos) + np.arctan(dq) - np.arctan(dqb)
        low, high = points.min(axis=0) - 0.01, points.max(axis=0) + 0.01
        near = ((corner > low) & (corner < high)).all(axis=-1)
    corner = np.where(near[..., None], corner, 1.0)
    place = np.searchsorted(bearing(points), bearing(corner))
    return _Pairs(corner, np.where(near, turn, np.nan), np.where(near, place, 0))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1])


def _curve(coefficients: Array, s: Array) -> tuple[Array, Array]:
    """Value and slope of curves, shape (..., 3), at s."""
    c0, c1, c2 = coefficients[..., 0], coefficients[..., 1], coefficients[..., 2]
    return c0 + s * (c1 + s * c2), c1 + 2 * s * c2


def _fits(pairs: _Pairs, support: Array, shortest: float) -> NDArray[np.bool_]:
    """Whether b can stand between corners (a, b) and (b, c), shape (m, m, m)."""
    before, after = pairs.place[:, :, None], pairs.place[None, :, :]
    span = after - before
    rows = np.arange(len(support))
    at_start = support[rows[None, :], pairs.place]  # of b, up to corner (a, b)
    at_end = support[rows[:, None], pairs.place]  # of b, up to corner (b, c)
    good = at_end[None, :, :] - at_start[:, :, None]
    gap = pairs.corner[None, :, :] - pairs.corner[:, :, None]
    length2 = gap[..., 0] ** 2 + gap[..., 1] ** 2
    return np.asarray((span > 0) & (good >= 4) & (good >= 0.15 * span) & (length2 > shortest**2))


def _best_chains(
    model: GrooveModel,
    segments: Segments,
    pairs: _Pairs,
    terms: list[Array],
    support: Array,
    n: int,
) -> list[Hypothesis]:
    """Cheapest chains: forward over the corners, then back along the choices made."""
    value, choices = terms[0], []
    for k in range(1, len(terms)):
        fits = _fits(pairs, support, model.sides[k].shortest)
        total = np.where(fits, value[:, :, None], np.inf) + terms[k][None]
        if k < len(terms) - 1:
            choices.append(total.argmin(axis=0))
            value = total.min(axis=0)
    order = np.argsort(total, axis=None)[:200]
    costs = total.ravel()[order]
    found: list[Hypothesis] = []
    for flat, cost in zip(order, costs, strict=True):
        if not np.isfinite(cost) or cost > costs[0] + MARGIN * n or len(found) == MOST_RIVALS:
            break
        chain = [int(v) for v in np.unravel_index(flat, total.shape)]
        for choice in reversed(choices):
            chain.insert(0, int(choice[chain[0], chain[1]]))
        corners = pairs.corner[chain[:-1], chain[1:]]
        if all(np.abs(corners - h.corners).max() > DISTINCT for h in found):
            found.append(Hypothesis(segments.take(np.array(chain)), corners, float(cost)))
    return found
