"""What other readings of the same points add to the uncertainty of the likeliest one.

A run of reflections beside a bevel may look as good as the bevel. Then noise says little about
how far the corners may be off: the other reading says more, by how likely it is (Bayesian model
averaging).
"""

from __future__ import annotations

from math import exp, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove.background import JUMP_DISTANCE, find_runs
from tjscan.groove.fitted_profile import (
    FittedProfile,
    OrderedProfilePoints,
    points_on_sides,
)
from tjscan.groove.models import GrooveModel
from tjscan.groove.segments import Index

POINT_LOG_ODDS: Final = 0.25
"""Logarithm of the odds that one point explained more is worth: points of a reflection come in
runs, and noise is correlated, so that a point counts for a part of an independent one."""

LEAST_ODDS: Final = 0.01
"""Readings less likely than this, over the likeliest, are left out."""

REFLECTION_DISTANCE: Final = 3e-3
"""How far reflections lie off the surface, in metres."""

TOUCHING_SHARE: Final = JUMP_DISTANCE / (sqrt(3) * REFLECTION_DISTANCE)
"""Share of the reflections that end so near the surface, by chance, that no jump shows."""

FAR_DISTANCE: Final = 0.6e-3
"""Farther from its side, in metres, a point is a reflection."""

MOST_REFLECTED: Final = 0.25
"""Greatest probability that a side which hangs together with no other is a reflection."""

MEETING_REACH, FEWEST_MEETING, FEWEST_HIDING = 1.5e-3, 2, 3
"""Points of a side, so near a corner in metres, that show it there; and points between two sides
that hide how one goes over into the other."""

SAME_READING_DISTANCE: Final = 0.05e-3
"""Readings whose corners differ by less, in metres, are one."""


def odds(excess: float) -> float:
    """Odds of a reading against one whose cost is less by `excess`, in outliers."""
    return exp(-POINT_LOG_ODDS * excess)


def form_probability(
    model: GrooveModel, fitted: FittedProfile, others: list[tuple[float, GrooveModel]]
) -> float:
    """Probability that the groove has the form of the likeliest reading.

    Each form counts once, by its own likeliest reading. What reflections hide may be of any form:
    it is known no better than the share of points that are none.

    Parameters
    ----------
    model : GrooveModel
    fitted : FittedProfile
        The likeliest reading.
    others : list of (float, GrooveModel)
        Of the others, with how much more they cost, in outliers.
    """
    least: dict[str, float] = {}
    for excess, other in others:
        if other is not model:
            least[other.name] = min(excess, least.get(other.name, excess))
    seen = 1 - reflection_probability(fitted)
    return seen / (1 + sum(odds(excess) for excess in least.values()))


def matched_corners(a: GrooveModel, b: GrooveModel) -> list[tuple[int, int]]:
    """Pairs of corners, of a and of b, that are the same corner of a groove: its ends."""
    pairs = [(0, 0)]
    last_a, last_b = len(a.sides) - 2, len(b.sides) - 2
    for k in range(min(last_a, last_b)):
        before_a, before_b = a.sides[last_a - k], b.sides[last_b - k]
        if a.sides[last_a - k + 1].name != b.sides[last_b - k + 1].name:
            break
        if before_a.bead != before_b.bead:
            break
        pairs.append((last_a - k, last_b - k))
    return pairs


def rival_covariance(
    model: GrooveModel,
    fitted: FittedProfile,
    rivals: list[tuple[float, GrooveModel, FittedProfile]],
) -> Array:
    """Second moment, about the likeliest reading, of where others have its corners.

    Parameters
    ----------
    model : GrooveModel
    fitted : FittedProfile
        The likeliest reading, of k sides.
    rivals : list of (float, GrooveModel, FittedProfile)
        Others, with how much more they cost, in outliers.

    Returns
    -------
    ndarray, shape (2 k, 2 k)
        Of the corners' coordinates; nothing for the angles of wall and leg, the last two.
    """
    moments: list[tuple[float, Array]] = []
    for excess, other, found in sorted(rivals, key=lambda r: r[0]):
        weight = odds(excess)
        if weight < LEAST_ODDS:
            break
        away = np.zeros(2 * len(model.sides))
        for i, j in matched_corners(model, other):
            away[2 * i : 2 * i + 2] = found.corners[j] - fitted.corners[i]
        known = (np.zeros_like(away), *(v for _, v in moments))
        if min(np.abs(away - v).max() for v in known) > SAME_READING_DISTANCE:
            moments.append((weight, away))
    covariance = np.zeros((2 * len(model.sides),) * 2)
    total = 1 + sum(weight for weight, _ in moments)
    for weight, away in moments:
        covariance += weight / total * np.outer(away, away)
    return covariance


def reflection_probability(fitted: FittedProfile) -> float:
    """Probability that a side which hangs together with no other one is a reflection.

    It is the share of the profile's points that are reflections, estimated with half a point
    more, for none may be seen by chance.
    """
    far = np.count_nonzero(np.abs(fitted.residuals) > FAR_DISTANCE)
    return min((far + 0.5) / (len(fitted.residuals) + 1), MOST_REFLECTED)


def share_in_long_stretches(
    row: OrderedProfilePoints, residuals: Array, least: int, *, jumping: float = 1.0
) -> float:
    """Share of a profile's points that lie far off its sides, in stretches of so many at least.

    It is how probable it is that a side of `least` points is such a stretch itself. One that goes
    over into another side may be spatter, or light that grows out of the surface; then the like
    of these count.

    Parameters
    ----------
    row : OrderedProfilePoints
    residuals : ndarray, shape (n,)
        How far its points lie behind their sides, in metres.
    least : int
        Number of points.
    jumping : float
        How much those count that jump off the surface at both ends: `TOUCHING_SHARE` for a side that
        only one end shows to go over into another.
    """
    first, stop, hangs = _far_stretches(row, residuals)
    length = stop - first
    counted = length >= least
    share = float((length * counted) @ np.where(hangs.any(axis=0), 1.0, jumping))
    return min(share / len(residuals), MOST_REFLECTED)


def _far_stretches(
    row: OrderedProfilePoints, residuals: Array
) -> tuple[Index, Index, NDArray[np.bool_]]:
    """Stretches of points far off their sides.

    First points, points after the last ones, and whether they begin and end without a jump,
    shape (2, m).
    """
    far = np.concatenate(([False], np.abs(residuals) > FAR_DISTANCE, [False]))
    first, stop = (far[1:] != far[:-1]).nonzero()[0].reshape(-1, 2).T
    cut = np.zeros(len(far), dtype=np.bool_)
    if len(first):
        cut[find_runs(row.points, row.columns).first] = cut[len(residuals)] = True
    return first, stop, ~np.array((cut[first], cut[stop]))


def sides_that_meet(fitted: FittedProfile) -> NDArray[np.bool_]:
    """At which corners the points of one side go over into those of the next, shape (k - 1,).

    Both are seen there, and few others lie between them. A side that is drawn on from far away
    meets another one as well, and so does a reflection.
    """
    on = points_on_sides(fitted)
    found = np.zeros(len(fitted.corners), dtype=np.bool_)
    for i, (s_before, s_after) in enumerate(fitted.places):
        start, middle, end = fitted.edges[i : i + 3]
        before = start + np.flatnonzero(on[start:middle])[-FEWEST_MEETING:]
        after = middle + np.flatnonzero(on[middle:end])[:FEWEST_MEETING]
        if min(len(before), len(after)) < FEWEST_MEETING:
            continue
        away = np.concatenate((fitted.along[before] - s_before, fitted.along[after] - s_after))
        between = after[0] - before[-1] - 1
        found[i] = between < FEWEST_HIDING and np.abs(away).max() < MEETING_REACH
    return found


def left_out_covariance(
    row: OrderedProfilePoints, model: GrooveModel, fitted: FittedProfile
) -> Array:
    """What it adds, shape (2 k, 2 k), that steel beside a corner lies on neither of its sides.

    Points that hang together with what is seen before and after them are no reflections. Where
    such points begin at a corner, the side that should go on there may be theirs: as probably as
    they are many among its points.

    Parameters are those of `reflection_covariance`.
    """
    covariance = np.zeros((2 * len(model.sides),) * 2)
    first, stop, hangs = _far_stretches(row, fitted.residuals)
    whole = hangs.all(axis=0)
    for a, b in zip(first[whole].tolist(), stop[whole].tolist(), strict=True):
        for i, places in enumerate(fitted.places):
            for k, point in ((i, b - 1), (i + 1, a)):
                edges = fitted.edges[k : k + 2]
                if model.sides[k].bead or not edges[0] <= point < edges[1]:
                    continue
                if abs(float(fitted.along[point]) - places[k - i]) > MEETING_REACH:
                    continue
                probability = (b - a) / (b - a + float(fitted.counts[k]))
                off = float(np.median(np.abs(fitted.residuals[a:b])))
                own, move = slice(2 * i, 2 * i + 2), off * _sideways(fitted, i, k)
                covariance[own, own] += probability * np.outer(move, move)
    return covariance


def _sideways(fitted: FittedProfile, i: int, k: int) -> Array:
    """How far corner i moves along its other side if side k moves sideways by one, shape (2,)."""
    own = fitted.curves[k].tangent_at(fitted.places[i][k - i])
    other = 2 * i + 1 - k
    tx, tz = fitted.curves[other].tangent_at(fitted.places[i][other - i])
    return np.array((tx, tz)) / (tx * own[1] - tz * own[0])


def reflection_covariance(
    row: OrderedProfilePoints, model: GrooveModel, fitted: FittedProfile
) -> Array:
    """What it adds, shape (2 k, 2 k), that a side between others may be no surface.

    Parameters
    ----------
    row : OrderedProfilePoints
    model : GrooveModel
    fitted : FittedProfile
        Of k sides.
    """
    covariance = np.zeros((2 * len(model.sides),) * 2)
    meets = sides_that_meet(fitted)
    for k, side in enumerate(model.sides[1:-1], 1):
        if side.bead:
            continue
        if meets[k - 1 : k + 1].any():
            points = int(fitted.counts[k])
            probability = share_in_long_stretches(row, fitted.residuals, points, jumping=0.0)
        else:
            probability = reflection_probability(fitted)
        if not probability:
            continue
        away = np.zeros(len(covariance))
        for i in (k - 1, k):
            away[2 * i : 2 * i + 2] = REFLECTION_DISTANCE * _sideways(fitted, i, k)
        covariance += probability * np.outer(away, away)
    return covariance
