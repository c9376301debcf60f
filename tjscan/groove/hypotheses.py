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
from tjscan.groove.segments import CurvedSegments
from tjscan.groove.settings import GrooveModel, SearchBudget, SideModel, TurnBounds
from tjscan.groove.sides import (
    CubicCurve,
    Index,
    OrderedProfilePoints,
    Polyline,
    bearing_tangents,
    end_of_support,
)

LINE_PAIR_LAGS: Final = (2, 4, 7, 12, 20, 35, 60, 110)
"""How many points apart the pairs are that propose a line."""

STRETCH_OUTLIER_COST: Final = 0.15
"""What a point costs the stretch it lies in, in points, unless the line explains it."""

STRETCH_BLOCK_POINTS: Final = 6
"""Points between the ends that a stretch may have."""

LEAST_SUPPORT_GAIN: Final = 0.2
"""Gain from which a line counts as explaining a point."""

OUTER_MARGIN_POINTS: Final = 10
"""Points of the outer sides that may belong to the sides between them."""

FEWEST_INNER_POINTS: Final = 4
"""Points that must support an inner side."""

LEAST_SUPPORT_SHARE: Final = 0.12
"""Share of an inner side's points that must support it."""

LEAST_DISTANCE_OF_RIVALS: Final = 1e-3
"""Chains that differ less than this at every corner are the same one, in metres."""

MOST_HYPOTHESES_REFINED: Final = 3
"""Most hypotheses looked at more closely."""

MOST_HYPOTHESES_COMPARED: Final = 150
"""Most hypotheses of which the distinct ones are sought."""

RIVAL_COST_MARGIN: Final = 12.0
"""By how many outliers a hypothesis may be dearer than the cheapest and still be looked at."""

LEAST_SENSOR_RANGE: Final = 0.02
"""Least distance of anything from the sensor, in metres."""

CORNER_DISTANCE_BEYOND_POINTS: Final = 30e-3
"""How far a corner may lie outside all points, in metres."""


_Neighbour = tuple[CubicCurve, TurnBounds]
"""An outer side, and by how much the side beside it may turn from it."""


@dataclass(frozen=True, slots=True, eq=False)
class _PointsBetweenOuterSides:
    """The n points between two outer sides, shape (n, 2), and their bearings' tangents, (n,)."""

    points: Array
    tangents: Array


@dataclass(frozen=True, slots=True, eq=False)
class _ProposedLines:
    """Lines through pairs of points: points and directions, shape (m, 4).

    The points' scaled distances from them and what each adds to a stretch have shape (m, n).
    """

    lines: Array
    distances: Array
    gains: Array


@dataclass(frozen=True, slots=True, eq=False)
class _LineCosts:
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
    row: OrderedProfilePoints,
    outer: tuple[CubicCurve, CubicCurve],
    stretches: tuple[int, int],
    tolerance: float,
    budget: SearchBudget,
) -> list[Polyline]:
    """Cheapest hypothesis between two outer sides, and its distinct rivals; none if nothing fits.

    Parameters
    ----------
    model : GrooveModel
    row : OrderedProfilePoints
    outer : tuple of CubicCurve
        The outer sides.
    stretches : tuple of int
        Last point of the first side's stretch, and first point of the last side's.
    tolerance : float
        Distance at which a point stops supporting a side, in metres.
    budget : SearchBudget
    """
    until, since = stretches
    d_first = outer[0].signed_distances(row.points) / tolerance
    d_last = outer[1].signed_distances(row.points) / tolerance
    lo = max(end_of_support(np.abs(d_first[: until + 1]) < 1) - OUTER_MARGIN_POINTS, 0)
    behind = end_of_support(np.abs(d_last[since:][::-1]) < 1) - OUTER_MARGIN_POINTS
    hi = len(row.points) - max(behind, 0)
    inner = len(model.sides) - 2
    if hi - lo < FEWEST_INNER_POINTS * inner:
        return []
    outside = float(_point_costs(d_first[:lo]).sum() + _point_costs(d_last[hi:]).sum())
    scaled = np.array((d_first[lo:hi], d_last[lo:hi]))
    region = _PointsBetweenOuterSides(row.points[lo:hi], row.tangents[lo:hi])
    lines, distances = _propose_lines(region.points, scaled, tolerance, budget.proposals)
    if not len(lines):
        return []
    paid, support = _running_costs_and_support(scaled)
    nowhere = np.zeros((1, 2))
    first, last = (
        _LineCosts(nowhere, nowhere, paid[k : k + 1], support[k : k + 1]) for k in (0, 1)
    )
    # What a point adds to its stretch.
    gains = distances * distances
    np.subtract(1, gains, out=gains)
    np.maximum(gains, 0, out=gains)
    gains -= np.float32(STRETCH_OUTLIER_COST)
    proposed = _ProposedLines(lines, distances, gains)
    layers = [first]
    for k in range(inner):
        before = (outer[0], model.turns[0]) if k == 0 else None
        after = (outer[1], model.turns[-1]) if k == inner - 1 else None
        longest = model.sides[k + 1].longest
        layers.append(_select_inner_lines(proposed, region, (before, after), longest, budget.pool))
    layers.append(last)
    if any(len(layer.point) == 0 for layer in layers):
        return []
    return _find_cheapest_chains(model, layers, region, outer, outside)


def _point_costs(scaled: Array) -> Array:
    """What points at scaled distances pay."""
    return np.minimum(scaled * scaled, 1)


def _running_costs_and_support(scaled: Array) -> tuple[Array, Array]:
    """Running sums of costs and of support, shape (m, n) to (m, n + 1)."""
    m, n = scaled.shape
    cost = np.minimum(scaled * scaled, 1)
    support, paid = np.zeros((m, n + 1)), np.zeros((m, n + 1))
    np.cumsum(1 - cost, axis=1, out=support[:, 1:])
    np.cumsum(cost, axis=1, out=paid[:, 1:])
    return paid, support


def _propose_lines(region: Array, outer: Array, tolerance: float, most: int) -> tuple[Array, Array]:
    """Lines through pairs of points, (m, 4), and the points' scaled distances, (m, n).

    Those from the two outer sides are `outer`, shape (2, n).
    """
    # What an outer side explains needs no other line, except near the region's ends.
    free = np.flatnonzero((np.abs(outer) > 0.6).all(axis=0))
    pairs = [(free[:-k], free[k:]) for k in LINE_PAIR_LAGS if k < len(free)]
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


def _select_inner_lines(
    proposed: _ProposedLines,
    region: _PointsBetweenOuterSides,
    neighbours: tuple[_Neighbour | None, _Neighbour | None],
    longest: float,
    most: int,
) -> _LineCosts:
    """The lines that may be an inner side: for every point the one that explains most.

    A line next to an outer side is judged by its best stretch that begins at their corner and
    is no longer than `longest`.
    """
    lines, n = proposed.lines, len(region.points)
    keep = np.ones(len(lines), dtype=bool)
    bounds = [np.zeros(len(lines), dtype=np.intp), np.full(len(lines), n)]
    met: list[tuple[Array, Array] | None] = [None, None]
    for i, neighbour in enumerate(neighbours):
        if neighbour is None:
            continue
        side, allowed = neighbour
        following = i == 0
        corner, turned = _intersect_outer_side(side, lines[:, :2], lines[:, 2:], after=following)
        met[i] = corner, turned
        keep &= (turned >= allowed.least) & (turned <= allowed.most)
        keep &= np.isfinite(corner[:, 0]) & (corner[:, 1] > 0)
        corner = np.where(keep[:, None], corner, 1.0)
        bounds[i] = np.searchsorted(region.tangents, bearing_tangents(corner))
        end = corner + (longest if following else -longest) * lines[:, 2:]
        end[:, 1] = np.maximum(end[:, 1], LEAST_SENSOR_RANGE)
        bounds[1 - i] = np.searchsorted(region.tangents, bearing_tangents(end))
    which = np.flatnonzero(keep)
    if not len(which):
        return _LineCosts(lines[:0, :2], lines[:0, 2:], np.zeros((0, 1)), np.zeros((0, 1)))
    if neighbours == (None, None):
        gains = proposed.gains[which] + np.float32(STRETCH_OUTLIER_COST)
        best = which[_select_greedily(gains, most)]
    else:
        index = np.arange(n)
        own = (index >= bounds[0][which, None]) & (index < bounds[1][which, None])
        gain = np.where(own, proposed.gains[which], np.float32(0))
        best = which[_select_by_best_stretch(gain, most, backward=neighbours[0] is None)]
    ends = [None if m is None else (m[0][best], m[1][best]) for m in met]
    return _LineCosts(
        lines[best, :2],
        lines[best, 2:],
        *_running_costs_and_support(proposed.distances[best]),
        *ends,
    )


def _select_by_best_stretch(gain: Array, most: int, *, backward: bool) -> Index:
    """Lines that explain some point best, by the best stretches from their first or last point."""
    # Stretches end at every few points: that is near enough, and quicker to sum.
    blocks = np.add.reduceat(gain, np.arange(0, gain.shape[1], STRETCH_BLOCK_POINTS), axis=1)
    if backward:
        blocks = blocks[:, ::-1]
    score = blocks.cumsum(axis=1).max(axis=1)
    order = np.argsort(-score, kind="stable")
    order = order[: max(np.count_nonzero(score > 0), 1)]
    # Of the lines that explain a point the best one claims it.
    claims = gain[order] > LEAST_SUPPORT_GAIN - STRETCH_OUTLIER_COST
    winners = np.zeros(len(order), dtype=np.bool_)
    winners[claims.argmax(axis=0)[claims.any(axis=0)]] = True
    winners &= score[order] > 0
    return order[winners][:most]


def _select_greedily(gain: Array, most: int) -> Index:
    """Lines that explain most of what those before them left over."""
    gain, found = gain.copy(), []
    for _ in range(most):
        best = int(gain.sum(axis=1).argmax())
        explained = gain[best] > LEAST_SUPPORT_GAIN
        if np.count_nonzero(explained) < FEWEST_INNER_POINTS:
            break
        found.append(best)
        gain[:, explained] = 0
    return np.array(found, dtype=np.intp)


@dataclass(frozen=True, slots=True, eq=False)
class _NeighbourPairs:
    """Every line of one layer with every line of the next: arrays of shape (m1, m2, ...)."""

    corner: Array
    place: Index
    pay: Array
    until: Array
    since: Array


def _find_cheapest_chains(
    model: GrooveModel,
    layers: list[_LineCosts],
    region: _PointsBetweenOuterSides,
    outer: tuple[CubicCurve, CubicCurve],
    outside: float,
) -> list[Polyline]:
    """Dynamic programming over the layers; `total` keeps the last three of a hypothesis apart."""
    box = (
        (region.points.min(axis=0) - CORNER_DISTANCE_BEYOND_POINTS).tolist(),
        (region.points.max(axis=0) + CORNER_DISTANCE_BEYOND_POINTS).tolist(),
    )
    joints = []
    for k, bounds in enumerate(model.turns):
        a, b = layers[k], layers[k + 1]
        if b.before is not None:
            corner, turned = b.before[0][None], b.before[1][None]
        elif a.after is not None:
            corner, turned = a.after[0][:, None], a.after[1][:, None]
        else:
            corner, turned = _intersect_layers(a, b)
        joints.append(_pair_neighbours(a, b, corner, turned, bounds, region.tangents, box))
    value, choices = joints[0].pay, []
    for k in range(1, len(joints)):
        between = _lines_fit_between_neighbours(joints[k - 1], joints[k], model.sides[k])
        total = np.where(between, value[:, :, None], np.inf) + joints[k].pay[None]
        if k < len(joints) - 1:
            choices.append(total.argmin(axis=0))
            value = total.min(axis=0)
    constant = outside + float(layers[-1].paid[0, -1])
    costs = total.ravel()
    most = float(costs.min()) + RIVAL_COST_MARGIN
    likely = np.flatnonzero((costs <= most) & (costs < np.inf))
    found: list[Polyline] = []
    for flat in likely[
        np.argsort(costs[likely], kind="stable")[:MOST_HYPOTHESES_COMPARED]
    ].tolist():
        start, last = divmod(flat, total.shape[2])
        hypothesis = [*divmod(start, total.shape[1]), last]
        for choice in reversed(choices):
            hypothesis.insert(0, int(choice[hypothesis[0], hypothesis[1]]))
        corners = np.array(
            [j.corner[hypothesis[i], hypothesis[i + 1]] for i, j in enumerate(joints)]
        )
        if all(np.abs(corners - c.corners).max() > LEAST_DISTANCE_OF_RIVALS for c in found):
            inner = [
                _line_as_curve(layers[k], hypothesis[k]) for k in range(1, len(hypothesis) - 1)
            ]
            cost = float(costs[flat]) + constant
            found.append(Polyline((outer[0], *inner, outer[1]), corners, cost))
            if len(found) == MOST_HYPOTHESES_REFINED:
                break
    return found


def _line_as_curve(lines: _LineCosts, i: int) -> CubicCurve:
    (x, z), (tx, tz) = lines.point[i], lines.direction[i]
    return CubicCurve(float(x), float(z), float(tx), float(tz))


def _intersect_layers(a: _LineCosts, b: _LineCosts) -> tuple[Array, Array]:
    """Corners, shape (m1, m2, 2), and turns of two layers of lines."""
    t, r = a.direction[:, None], b.direction[None]
    w = b.point[None] - a.point[:, None]
    sin = t[..., 0] * r[..., 1] - t[..., 1] * r[..., 0]
    cos = t[..., 0] * r[..., 0] + t[..., 1] * r[..., 1]
    s = (w[..., 0] * r[..., 1] - w[..., 1] * r[..., 0]) / sin
    return a.point[:, None] + s[..., None] * t, np.arctan2(sin, cos)


def _intersect_outer_side(
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


def _pair_neighbours(
    a: _LineCosts,
    b: _LineCosts,
    corner: Array,
    turned: Array,
    bounds: TurnBounds,
    u: Array,
    box: tuple[list[float], list[float]],
) -> _NeighbourPairs:
    """What each pair of neighbours pays; infinite where they can't be neighbours."""
    allowed = (turned >= bounds.least) & (turned <= bounds.most)
    for axis, low, high in zip((0, 1), *box, strict=True):
        allowed &= (corner[..., axis] > low) & (corner[..., axis] < high)
    corner = np.where(allowed[..., None], corner, 1.0)
    place = u.searchsorted(bearing_tangents(corner))
    i, j = np.arange(len(a.paid))[:, None], np.arange(len(b.paid))[None]
    pay = np.where(allowed, a.paid[i, place] - b.paid[j, place], np.inf)
    return _NeighbourPairs(corner, place, pay, a.support[i, place], b.support[j, place])


def _lines_fit_between_neighbours(
    before: _NeighbourPairs, after: _NeighbourPairs, side: SideModel
) -> NDArray[np.bool_]:
    """Whether a line can be between two neighbours, shape (m1, m2, m3)."""
    span = after.place[None] - before.place[:, :, None]
    good = after.until[None] - before.since[:, :, None]
    gap = after.corner[None] - before.corner[:, :, None]
    square = gap[..., 0] ** 2 + gap[..., 1] ** 2
    fits = (span > 0) & (good >= np.maximum(LEAST_SUPPORT_SHARE * span, FEWEST_INNER_POINTS * 0.7))
    fits &= square > side.shortest**2
    return np.asarray(fits & (square < side.longest**2))
