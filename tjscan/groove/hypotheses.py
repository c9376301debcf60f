"""From the long outer sides to the whole groove: lines between them, and the best hypothesis.

Between the two outer sides few points may be left of a side, the rest hidden by reflections.
So many pairs of points propose lines there, and the template is laid over them by dynamic
programming. A hypothesis's corners are the intersections of neighbours, and each point pays, up to
a limit, for its distance to the side that its ray would hit: before its start and after its
end a side counts for nothing. That cost is a sum over pairs of neighbours, so the cheapest of
all hypotheses, and every rival to it, is found without trying them one by one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove.budget import SearchBudget
from tjscan.groove.curves import CubicCurve
from tjscan.groove.models import GrooveModel, SideModel, TurnBounds
from tjscan.groove.segments import CurvedSegments, Index

PAIR_LAGS: Final = (2, 4, 7, 12, 20, 35, 60, 110)
"""How many points apart the pairs are that propose a line."""

GAP_COST: Final = 0.15
"""What a point costs the stretch it lies in, in points, unless the line explains it."""

STRETCH_BLOCK: Final = 6
"""Points between the ends that a stretch may have."""

SUPPORT_GAIN: Final = 0.2
"""Gain from which a line counts as explaining a point."""

OUTER_MARGIN: Final = 10
"""Points of the outer sides that may belong to the sides between them."""

FEWEST_INNER_POINTS: Final = 4
"""Points that must support an inner side."""

LEAST_SUPPORT_SHARE: Final = 0.12
"""Share of an inner side's points that must support it."""

SUPPORT_NEIGHBOURS: Final = 4
"""Points on either side of one that tell, with it, whether it lies on a side."""

DISTINCT_DISTANCE: Final = 1e-3
"""Chains that differ less than this at every corner are the same one, in metres."""

MOST_REFINED: Final = 3
"""Most hypotheses looked at more closely."""

MOST_COMPARED: Final = 150
"""Most hypotheses of which the distinct ones are sought."""

RIVAL_MARGIN: Final = 12.0
"""By how many outliers a hypothesis may be dearer than the cheapest and still be looked at."""

NEAREST_RANGE: Final = 0.02
"""Least distance of anything from the sensor, in metres."""

CORNER_ROOM: Final = 30e-3
"""How far a corner may lie outside all points, in metres."""


@dataclass(frozen=True, slots=True, eq=False)
class PolylineHypothesis:
    """Hypothesis of a groove: one curve for every side, from wall to leg, and the corners.

    Parameters
    ----------
    sides : tuple of CubicCurve
    corners : ndarray, shape (k - 1, 2)
        Where neighbours meet, x and z in metres.
    cost : float
        What all points pay, in outliers.
    """

    sides: tuple[CubicCurve, ...]
    corners: Array
    cost: float


@dataclass(frozen=True, slots=True, eq=False)
class _Lines:
    """Straight lines with what they cost in a region; the running sums have shape (m, n + 1).

    `before` and `after` are the corners and turns with the outer side before or after them, if
    there is one.
    """

    point: Array
    direction: Array
    paid: Array
    support: Array
    before: tuple[Array, Array] | None = None
    after: tuple[Array, Array] | None = None


def bearing_tangents(points: Array) -> Array:
    """Tangents of bearings of points, shape (..., 2), from the sensor; grow from wall to leg."""
    return np.asarray(-points[..., 0] / points[..., 1])


def outer_side_pairs(
    segments: CurvedSegments, model: GrooveModel, count: int, most: int
) -> list[tuple[int, int, float]]:
    """Pairs of segments that may be the first and the last side, likeliest first.

    A pair is the better the more points it explains, and the fewer of the `count` points lie
    outside it: those no side can explain. That difference is the third number.
    """
    t = segments.direction
    sin = t[:, None, 0] * t[None, :, 1] - t[:, None, 1] * t[None, :, 0]
    turned = np.arctan2(sin, t @ t.T)
    middle = (segments.first + segments.last) // 2
    allowed = (turned >= model.across.least) & (turned <= model.across.most)
    allowed &= segments.last[:, None] <= middle[None, :]
    allowed &= middle[:, None] <= segments.first[None, :]
    first = segments.score - segments.first
    last = segments.score - (count - 1 - segments.last)
    score = np.where(allowed, first[:, None] + last[None, :], -np.inf)
    order = np.argsort(-score, axis=None, kind="stable")[:most]
    likely = [k for k in order.tolist() if np.isfinite(score.flat[k])]
    return [(*divmod(k, len(segments)), float(score.flat[k])) for k in likely]


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def best_hypotheses(
    model: GrooveModel,
    points: Array,
    tangents: Array,
    outer: tuple[CubicCurve, CubicCurve],
    until: int,
    since: int,
    tolerance: float,
    budget: SearchBudget,
) -> list[PolylineHypothesis]:
    """Cheapest hypothesis between two outer sides, and its distinct rivals; none if nothing fits.

    Parameters
    ----------
    model : GrooveModel
    points : ndarray, shape (n, 2)
        x and z in metres, ordered from wall to leg.
    tangents : ndarray, shape (n,)
        Their bearings, rising.
    outer : tuple of CubicCurve
        The outer sides.
    until, since : int
        Last point of the first side's stretch, and first point of the last side's.
    tolerance : float
        Distance at which a point stops supporting a side, in metres.
    budget : SearchBudget
    """
    d_first, d_last = (side.signed_distances(points) / tolerance for side in outer)
    lo = max(end_of_support(np.abs(d_first[: until + 1]) < 1) - OUTER_MARGIN, 0)
    hi = len(points) - max(end_of_support(np.abs(d_last[since:][::-1]) < 1) - OUTER_MARGIN, 0)
    if hi - lo < FEWEST_INNER_POINTS * (len(model.sides) - 2):
        return []
    region, u = points[lo:hi], tangents[lo:hi]
    outside = float(_costs(d_first[:lo]).sum() + _costs(d_last[hi:]).sum())
    paid, support = _running(np.array((d_first[lo:hi], d_last[lo:hi])))
    nowhere = np.zeros((1, 2))
    ends = [_Lines(nowhere, nowhere, paid[k : k + 1], support[k : k + 1]) for k in (0, 1)]
    lines, scaled = _proposals(region, d_first[lo:hi], d_last[lo:hi], tolerance, budget.proposals)
    if not len(lines):
        return []
    # What a point adds to the stretch it lies in.
    gains = scaled * scaled
    np.subtract(1, gains, out=gains)
    np.maximum(gains, 0, out=gains)
    gains -= np.float32(GAP_COST)
    inner = len(model.sides) - 2
    layers = [ends[0]]
    for k in range(inner):
        before = (outer[0], model.turns[0]) if k == 0 else None
        after = (outer[1], model.turns[-1]) if k == inner - 1 else None
        layers.append(
            _pool(
                lines,
                scaled,
                gains,
                region,
                u,
                before,
                after,
                model.sides[k + 1].longest,
                budget.pool,
            )
        )
    layers.append(ends[1])
    if any(len(layer.point) == 0 for layer in layers):
        return []
    return _cheapest(model, layers, u, outer, region, outside)


def end_of_support(support: NDArray[np.bool_]) -> int:
    """Index after the last point around which most points support a side."""
    if not len(support):
        return 0
    near = np.convolve(support, _SUPPORT_WINDOW)[
        SUPPORT_NEIGHBOURS : SUPPORT_NEIGHBOURS + len(support)
    ]
    where = (near > SUPPORT_NEIGHBOURS).nonzero()[0]
    return int(where[-1]) + 1 if len(where) else 0


_SUPPORT_WINDOW: Final = np.ones(2 * SUPPORT_NEIGHBOURS + 1)


def _costs(scaled: Array) -> Array:
    """What points at scaled distances pay."""
    return np.minimum(scaled * scaled, 1)


def _running(scaled: Array) -> tuple[Array, Array]:
    """Running sums of costs and of support, shape (m, n) to (m, n + 1)."""
    m, n = scaled.shape
    cost = np.minimum(scaled * scaled, 1)
    support, paid = np.zeros((m, n + 1)), np.zeros((m, n + 1))
    np.cumsum(1 - cost, axis=1, out=support[:, 1:])
    np.cumsum(cost, axis=1, out=paid[:, 1:])
    return paid, support


def _proposals(
    region: Array, d_first: Array, d_last: Array, tolerance: float, most: int
) -> tuple[Array, Array]:
    """Lines through pairs of points, (m, 4), and the points' scaled distances, (m, n)."""
    # What an outer side explains needs no other line, except near the region's ends.
    free = np.flatnonzero((np.abs(d_first) > 0.6) & (np.abs(d_last) > 0.6))
    pairs = [(free[:-k], free[k:]) for k in PAIR_LAGS if k < len(free)]
    if not pairs:
        return np.zeros((0, 4)), np.zeros((0, len(region)))
    a, b = (np.concatenate(v) for v in zip(*pairs, strict=True))
    every = -(-len(a) // most)
    a, b = a[::every], b[::every]
    p, q = region.T[:, a], region.T[:, b]
    t = q - p
    length = np.hypot(t[0], t[1])
    good = length > 3 * tolerance
    p, t = p[:, good], t[:, good] / length[good]
    # Scaled distances need no double precision; small arrays stay in the cache.
    origin = region[len(region) // 2]
    n = np.array((t[1], -t[0])) / tolerance
    d = n.T.astype(np.float32) @ (region - origin).T.astype(np.float32)
    x, z = p - origin[:, None]
    d -= (n[0] * x + n[1] * z)[:, None].astype(np.float32)
    return np.concatenate((p, t)).T, d


def _pool(
    lines: Array,
    scaled: Array,
    gains: Array,
    region: Array,
    u: Array,
    before: tuple[CubicCurve, TurnBounds] | None,
    after: tuple[CubicCurve, TurnBounds] | None,
    longest: float,
    most: int,
) -> _Lines:
    """The lines that may be an inner side: for every point the one that explains most.

    A line next to an outer side is judged by its best stretch that begins at their corner and
    is no longer than `longest`.
    """
    n = scaled.shape[1]
    keep = np.ones(len(lines), dtype=bool)
    bounds = [np.zeros(len(lines), dtype=np.intp), np.full(len(lines), n)]
    met: list[tuple[Array, Array] | None] = [None, None]
    for i, (neighbour, following) in enumerate(((before, True), (after, False))):
        if neighbour is None:
            continue
        side, allowed = neighbour
        corner, turned = _meet_outer(side, lines[:, :2], lines[:, 2:], after=following)
        met[i] = corner, turned
        keep &= (turned >= allowed.least) & (turned <= allowed.most)
        keep &= np.isfinite(corner[:, 0]) & (corner[:, 1] > 0)
        corner = np.where(keep[:, None], corner, 1.0)
        bounds[i] = np.searchsorted(u, bearing_tangents(corner))
        end = corner + (longest if following else -longest) * lines[:, 2:]
        end[:, 1] = np.maximum(end[:, 1], NEAREST_RANGE)
        bounds[1 - i] = np.searchsorted(u, bearing_tangents(end))
    which = np.flatnonzero(keep)
    if not len(which):
        return _Lines(lines[:0, :2], lines[:0, 2:], np.zeros((0, 1)), np.zeros((0, 1)))
    if before is None and after is None:
        best = which[_one_by_one(gains[which] + np.float32(GAP_COST), most)]
    else:
        index = np.arange(n)
        mine = index >= bounds[0][which, None]
        mine &= index < bounds[1][which, None]
        gain = np.where(mine, gains[which], np.float32(0))
        # Stretches end at every few points: that is near enough, and quicker to sum.
        blocks = np.add.reduceat(gain, np.arange(0, n, STRETCH_BLOCK), axis=1)
        if before is None:
            blocks = blocks[:, ::-1]
        score = blocks.cumsum(axis=1).max(axis=1)
        order = np.argsort(-score, kind="stable")
        order = order[: max(np.count_nonzero(score > 0), 1)]
        # Of the lines that explain a point the best one claims it.
        claims = gain[order] > SUPPORT_GAIN - GAP_COST
        winners = np.zeros(len(order), dtype=np.bool_)
        winners[claims.argmax(axis=0)[claims.any(axis=0)]] = True
        winners &= score[order] > 0
        best = which[order[winners][:most]]
    ends = [None if m is None else (m[0][best], m[1][best]) for m in met]
    return _Lines(lines[best, :2], lines[best, 2:], *_running(scaled[best]), *ends)


def _one_by_one(gain: Array, most: int) -> Index:
    """Lines that explain most of what those before them left over."""
    gain, found = gain.copy(), []
    for _ in range(most):
        best = int(gain.sum(axis=1).argmax())
        explained = gain[best] > SUPPORT_GAIN
        if np.count_nonzero(explained) < FEWEST_INNER_POINTS:
            break
        found.append(best)
        gain[:, explained] = 0
    return np.array(found, dtype=np.intp)


@dataclass(frozen=True, slots=True, eq=False)
class _Joint:
    """Every line of one layer with every line of the next: arrays of shape (m1, m2, ...)."""

    corner: Array
    place: Index
    pay: Array
    until: Array
    since: Array


def _cheapest(
    model: GrooveModel,
    layers: list[_Lines],
    u: Array,
    outer: tuple[CubicCurve, CubicCurve],
    region: Array,
    outside: float,
) -> list[PolylineHypothesis]:
    """Dynamic programming over the layers; `total` keeps the last three of a hypothesis apart."""
    box = (region.min(axis=0) - CORNER_ROOM).tolist(), (region.max(axis=0) + CORNER_ROOM).tolist()
    joints = []
    for k, bounds in enumerate(model.turns):
        a, b = layers[k], layers[k + 1]
        if b.before is not None:
            corner, turned = b.before[0][None], b.before[1][None]
        elif a.after is not None:
            corner, turned = a.after[0][:, None], a.after[1][:, None]
        else:
            corner, turned = _meet(a, b)
        joints.append(_joint(a, b, corner, turned, bounds, u, box))
    value, choices = joints[0].pay, []
    for k in range(1, len(joints)):
        fits = _fits(joints[k - 1], joints[k], model.sides[k])
        total = np.where(fits, value[:, :, None], np.inf) + joints[k].pay[None]
        if k < len(joints) - 1:
            choices.append(total.argmin(axis=0))
            value = total.min(axis=0)
    constant = outside + float(layers[-1].paid[0, -1])
    costs = total.ravel()
    most = float(costs.min()) + RIVAL_MARGIN
    likely = np.flatnonzero((costs <= most) & (costs < np.inf))
    found: list[PolylineHypothesis] = []
    for flat in likely[np.argsort(costs[likely], kind="stable")[:MOST_COMPARED]].tolist():
        start, last = divmod(flat, total.shape[2])
        hypothesis = [*divmod(start, total.shape[1]), last]
        for choice in reversed(choices):
            hypothesis.insert(0, int(choice[hypothesis[0], hypothesis[1]]))
        corners = np.array(
            [j.corner[hypothesis[i], hypothesis[i + 1]] for i, j in enumerate(joints)]
        )
        if all(np.abs(corners - c.corners).max() > DISTINCT_DISTANCE for c in found):
            inner = [_curve(layers[k], hypothesis[k]) for k in range(1, len(hypothesis) - 1)]
            cost = float(costs[flat]) + constant
            found.append(PolylineHypothesis((outer[0], *inner, outer[1]), corners, cost))
            if len(found) == MOST_REFINED:
                break
    return found


def _curve(lines: _Lines, i: int) -> CubicCurve:
    (x, z), (tx, tz) = lines.point[i], lines.direction[i]
    return CubicCurve(float(x), float(z), float(tx), float(tz))


def _meet(a: _Lines, b: _Lines) -> tuple[Array, Array]:
    """Corners, shape (m1, m2, 2), and turns of two layers of lines."""
    t, r = a.direction[:, None], b.direction[None]
    w = b.point[None] - a.point[:, None]
    sin = t[..., 0] * r[..., 1] - t[..., 1] * r[..., 0]
    cos = t[..., 0] * r[..., 0] + t[..., 1] * r[..., 1]
    s = (w[..., 0] * r[..., 1] - w[..., 1] * r[..., 0]) / sin
    return a.point[:, None] + s[..., None] * t, np.arctan2(sin, cos)


def _meet_outer(
    outer: CubicCurve, points: Array, directions: Array, *, after: bool
) -> tuple[Array, Array]:
    """Corners, (m, 2), and turns of an outer side with lines after it (or before it).

    In the side's own coordinates a line is ``(s0 + r ts, d0 + r td)``. It meets the parabola at
    the root of a quadratic in s that is there for a straight side, too.
    """
    s0, d0 = outer.local_coordinates(points)
    ts = directions @ np.array((outer.tx, outer.tz))
    td = directions @ np.array((outer.tz, -outer.tx))
    slope = td / ts
    b, c = outer.c1 - slope, outer.c0 - d0 + slope * s0
    s = -2 * c / (b + np.copysign(np.sqrt(b * b - 4 * outer.c2 * c), b))
    height = outer.c0 + s * (outer.c1 + s * outer.c2)
    bent = np.arctan(outer.c1 + 2 * s * outer.c2)
    corner = np.empty((len(s), 2))
    corner[:, 0] = outer.cx + s * outer.tx + height * outer.tz
    corner[:, 1] = outer.cz + s * outer.tz - height * outer.tx
    # A direction at angle a against the chord turns the other way round in (s, d).
    turned = np.arctan2(-td, ts) + bent
    return corner, turned if after else -turned


def _joint(
    a: _Lines,
    b: _Lines,
    corner: Array,
    turned: Array,
    bounds: TurnBounds,
    u: Array,
    box: tuple[list[float], list[float]],
) -> _Joint:
    """What each pair of neighbours pays; infinite where they can't be neighbours."""
    allowed = (turned >= bounds.least) & (turned <= bounds.most)
    for axis, low, high in zip((0, 1), *box, strict=True):
        allowed &= (corner[..., axis] > low) & (corner[..., axis] < high)
    corner = np.where(allowed[..., None], corner, 1.0)
    place = u.searchsorted(bearing_tangents(corner))
    i, j = np.arange(len(a.paid))[:, None], np.arange(len(b.paid))[None]
    pay = np.where(allowed, a.paid[i, place] - b.paid[j, place], np.inf)
    return _Joint(corner, place, pay, a.support[i, place], b.support[j, place])


def _fits(before: _Joint, after: _Joint, side: SideModel) -> NDArray[np.bool_]:
    """Whether a line can stand between two neighbours, shape (m1, m2, m3)."""
    span = after.place[None] - before.place[:, :, None]
    good = after.until[None] - before.since[:, :, None]
    gap = after.corner[None] - before.corner[:, :, None]
    square = gap[..., 0] ** 2 + gap[..., 1] ** 2
    fits = (span > 0) & (good >= np.maximum(LEAST_SUPPORT_SHARE * span, FEWEST_INNER_POINTS * 0.7))
    fits &= square > side.shortest**2
    return np.asarray(fits & (square < side.longest**2))
