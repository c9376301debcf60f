"""Reflections and other readings of the same points: what they cost, and what they leave uncertain.

Light that took another way comes back as a whole run of points, which jumps off the surface at
one end or both. Its points hang together, so that they are no more worth explaining than a few
independent ones. A run that leaves a side without a jump is steel: it has to be explained.

A run of reflections beside a bevel may look as good as the bevel. Then noise shows little about
how far the corners may be off: the other reading shows more, by how likely it is (Bayesian model
averaging).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array, stretches_of_true_values
from tjscan.groove import kernel
from tjscan.groove.settings import GrooveModel
from tjscan.groove.sides import (
    LEAST_NOISE,
    OUTLIER_SIGMAS,
    FittedProfile,
    GrooveFit,
    Index,
    end_of_support,
)
from tjscan.laser.profile import Profile

JUMP_DISTANCE, JUMP_STEEPNESS = 0.5e-3, 1.5
"""Neighbouring points of one surface lie no farther apart than this, in metres, with this many
times the distance of their neighbours."""

LEAST_COLUMNS_OF_HOLE: Final = 6
"""Columns without points after which nothing shows whether a surface goes on."""

RUN_COST, POINT_COST = 3.0, 0.35
"""What a run of reflections costs, in outliers, and each of its points."""


POINT_LOG_ODDS: Final = 0.25
"""Logarithm of the odds that one point explained more is worth: points of a reflection come in
runs, and noise is correlated, so that a point counts for a part of an independent one."""

LEAST_READING_ODDS: Final = 0.01
"""Readings less likely than this, over the likeliest, are left out."""

REFLECTION_DISTANCE: Final = 3e-3
"""How far reflections lie off the surface, in metres."""

SHARE_ENDING_AT_SURFACE: Final = JUMP_DISTANCE / (sqrt(3) * REFLECTION_DISTANCE)
"""Share of the reflections that end so near the surface, by chance, that no jump shows."""

LEAST_REFLECTION_DISTANCE: Final = 0.6e-3
"""Farther from its side, in metres, a point is a reflection."""

MOST_REFLECTION_PROBABILITY: Final = 0.25
"""Greatest probability that a side which hangs together with no other is a reflection."""

MEETING_REACH: Final = 1.5e-3
"""Points of a side, so near a corner in metres, that show it there."""

FEWEST_HIDING: Final = 3
"""Points between two sides that show steel: fewer are strays."""

THICKEST_SCALE: Final = 0.5e-3
"""What hangs together with a side, and is farther off it, in metres, is no mill scale."""

LEAST_CAP, MOST_CAP = 5e-3, 30e-3
CAP_HEIGHT: Final = 0.5e-3
"""Width and least height of a seam weld's cap, in metres."""

MOST_CAP_FOOT_SHARE: Final = 0.5
"""An end of a cap is lower than this share of its height: it grows out of the surface."""

MOST_CAP_STEP_SHARE: Final = 0.4
"""Neighbouring points of a cap differ in height by less than this share of it."""


@dataclass(frozen=True, slots=True, eq=False)
class PointRuns:
    """Runs of points that hang together, in the order of a row.

    Parameters
    ----------
    first : ndarray of int, shape (m,)
        First point of each run.
    count : ndarray of int, shape (m,)
        Its number of points.
    jumps : ndarray of bool, shape (m,)
        Whether it jumps off what is seen before or after it.
    """

    first: Index
    count: Index
    jumps: NDArray[np.bool_]

    def largest_cost_per_point(self) -> Array:
        """The most that each point pays, shape (n,): as part of a reflection, if its run jumps."""
        whole = np.minimum(RUN_COST / self.count + POINT_COST, 1.0)
        return np.where(self.jumps, whole, 1.0).repeat(self.count)

    def total_cost(self, costs: Array) -> Array:
        """What all points cost, in outliers, if whole runs that jump may be reflections.

        Parameters
        ----------
        costs : ndarray, shape (..., n)
            What each point pays for its distance from its side, 1 for an outlier.
        """
        paid = np.add.reduceat(costs, self.first, axis=-1)
        off = self.jumps & (np.minimum.reduceat(costs, self.first, axis=-1) >= 1)
        cheaper = np.minimum(paid, RUN_COST + POINT_COST * self.count)
        return np.asarray(np.where(off, cheaper, paid).sum(axis=-1))


def find_runs(row: Profile) -> PointRuns:
    """Divide a row of n points where neighbours jump or a wide hole lies between."""
    n = len(row.x_s)
    if kernel.compiled is not None:
        bounds, jumps = np.empty(n + 1, dtype=np.intp), np.empty(n, dtype=np.bool_)
        m = kernel.compiled.find_runs(row.x_s, row.z_s, row.columns, bounds, jumps, np.empty(n))
        return PointRuns(bounds[:m], np.diff(bounds[: m + 1]), jumps[:m])
    step, apart = np.hypot(np.diff(row.x_s), np.diff(row.z_s)), np.abs(np.diff(row.columns))
    each = np.pad(step / apart, 1, "edge") if n > 1 else step
    hole = apart > LEAST_COLUMNS_OF_HOLE
    usual = np.minimum(each[:-2], each[2:])
    jump = ~hole & (step > JUMP_DISTANCE + JUMP_STEEPNESS * usual * apart)
    bounds = np.concatenate(([0], np.flatnonzero(jump | hole) + 1, [n]))
    jumps = np.pad(jump, 1)[bounds]
    return PointRuns(bounds[:-1], np.diff(bounds), jumps[:-1] | jumps[1:])


def stretches_off_surface(
    runs: PointRuns, off: NDArray[np.bool_]
) -> tuple[Index, Index, NDArray[np.bool_]]:
    """Stretches of points off a surface that hang together.

    First points, points after the last ones, and whether they go over without a jump into the
    points before and after them, shape (2, m): what does is no reflection.
    """
    begins, padded = np.zeros(len(off) + 1, dtype=np.bool_), np.pad(off, 1)
    begins[runs.first] = begins[-1] = True
    first = np.flatnonzero(off & (begins[:-1] | ~padded[:-2]))
    stop = np.flatnonzero(off & (begins[1:] | ~padded[2:])) + 1
    return first, stop, ~np.array((begins[first], begins[stop]))


def with_doubt_from_others(best: GrooveFit, others: list[GrooveFit]) -> GrooveFit:
    """The likeliest reading with how far others are from it, and which sides may be no surface.

    Parameters
    ----------
    best : GrooveFit
    others : list of GrooveFit
        Fits of the same points, of any form of the groove, the likeliest first.
    """
    surely, runs = replace(best, fitted=without_seam_cap(best.fitted)), find_runs(best.row)
    on = surely.fitted.points_on_sides
    odds = [exp(-POINT_LOG_ODDS * (other.cost - best.cost)) for other in others]
    covariance = _covariance_of_readings(best, others, odds)
    covariance += _reflection_covariance(surely, runs, on)
    covariance += _unmodelled_steel_covariance(surely, runs, ~on)
    # Each form counts once, by its own likeliest reading. What reflections hide may be of any form.
    each = zip(reversed(others), reversed(odds), strict=True)
    forms = {other.model.name: share for other, share in each if other.model is not best.model}
    probability = (1 - reflection_probability(surely.fitted)) / (1 + sum(forms.values()))
    return replace(best, other_readings=covariance, probability=probability)


def without_seam_cap(fitted: FittedProfile) -> FittedProfile:
    """The same with a weld's cap on the leg taken for its surface; itself if it shows no cap."""
    own = fitted.spans[-1]
    s, d = fitted.along[own], -fitted.residuals[own]
    if d.max(initial=0.0) <= CAP_HEIGHT:
        return fitted
    starts, stops = stretches_of_true_values(d > 0.3 * CAP_HEIGHT)
    for a, b in zip(starts.tolist(), stops.tolist(), strict=True):
        width, height = abs(float(s[b - 1] - s[a])), float(d[a:b].max())
        # What begins at the corner hides it.
        if not (a and LEAST_CAP < width < MOST_CAP and CAP_HEIGHT < height < width / 2):
            continue
        low = min(d[a], d[b - 1]) < MOST_CAP_FOOT_SHARE * height
        if low and np.abs(np.diff(d[a:b])).max() < MOST_CAP_STEP_SHARE * height:
            residuals = fitted.residuals.copy()
            residuals[own][a:b] = 0.0
            return replace(fitted, residuals=residuals)
    return fitted


def matched_corners(a: GrooveModel, b: GrooveModel) -> list[tuple[int, int]]:
    """Pairs of corners, of a and of b, that are the same corner of a groove: its ends."""
    pairs = [(0, 0)]
    last_a, last_b = len(a.sides) - 2, len(b.sides) - 2
    for k in range(min(last_a, last_b)):
        before_a, before_b = a.sides[last_a - k], b.sides[last_b - k]
        after_a, after_b = a.sides[last_a - k + 1], b.sides[last_b - k + 1]
        same = after_a.name == after_b.name or (after_a.bead and after_b.bead)
        if not same or before_a.bead != before_b.bead:
            break
        pairs.append((last_a - k, last_b - k))
    return pairs


def _covariance_of_readings(best: GrooveFit, others: list[GrooveFit], odds: list[float]) -> Array:
    """Second moment, about the likeliest reading, of the corners of others, shape (2 k, 2 k).

    It adds nothing to the angles of wall and leg, the last two.
    """
    covariance = np.zeros((2 * len(best.model.sides),) * 2)
    likely = [share for share in odds if share >= LEAST_READING_ODDS]
    total = 1 + sum(likely)
    for other, share in zip(others, likely, strict=False):
        away = np.zeros(len(covariance))
        for i, j in matched_corners(best.model, other.model):
            away[2 * i : 2 * i + 2] = other.fitted.corners[j] - best.fitted.corners[i]
        covariance += share / total * np.outer(away, away)
    return covariance


def reflection_probability(fitted: FittedProfile) -> float:
    """Probability that a side which hangs together with no other one is a reflection.

    It is the share of the profile's points that are reflections, estimated with half a point
    more, for none may be seen by chance.
    """
    far = np.count_nonzero(np.abs(fitted.residuals) > LEAST_REFLECTION_DISTANCE)
    return min((far + 0.5) / (len(fitted.residuals) + 1), MOST_REFLECTION_PROBABILITY)


def share_in_long_stretches(
    runs: PointRuns, residuals: Array, least: int, *, jumping: float = 1.0
) -> float:
    """Share of a profile's points that lie far off its sides, in stretches of so many at least.

    It is how probable it is that a side of `least` points is such a stretch itself. One that goes
    over into another side may be spatter, or light that grows out of the surface; then the like
    of these count.

    Parameters
    ----------
    runs : PointRuns
        Of its points.
    residuals : ndarray, shape (n,)
        How far these lie behind their sides, in metres.
    least : int
        Number of points.
    jumping : float
        How much those count that jump off the surface at both ends: `SHARE_ENDING_AT_SURFACE`
        for a side that only one end shows to go over into another.
    """
    far = np.abs(residuals) > LEAST_REFLECTION_DISTANCE
    first, stop, joins = stretches_off_surface(runs, far)
    length = stop - first
    counted = length >= least
    share = float((length * counted) @ np.where(joins.any(axis=0), 1.0, jumping))
    return min(share / len(residuals), MOST_REFLECTION_PROBABILITY)


def is_outnumbered(runs: PointRuns, on: NDArray[np.bool_], fitted: FittedProfile, k: int) -> bool:
    """Whether more points that hang together lie off side k, in its place, than any do on it."""
    run = np.arange(len(runs.first)).repeat(runs.count)[fitted.spans[k]]
    count = np.bincount(run), np.bincount(run, on[fitted.spans[k]])
    return bool((count[0] - count[1]).max() >= min(count[1].max(), fitted.counts[k]))


def count_points_seen_through_face(row: Profile, fitted: FittedProfile, k: int) -> int:
    """How many points lie behind a bead, side k, on those beside it, drawn on; few are none."""
    own = fitted.spans[k]
    noise = OUTLIER_SIGMAS * np.maximum(fitted.sigmas, LEAST_NOISE)
    behind = fitted.residuals[own] > noise.max()
    if np.count_nonzero(behind) < FEWEST_HIDING:
        return 0
    points = row.points[own][behind]
    on = np.abs(fitted.distances_from_sides(points)) < noise[:, None]
    count = int(np.count_nonzero(on[k - 1] | on[k + 1]))
    return count if count >= FEWEST_HIDING else 0


def gaps_beside_corners(fitted: FittedProfile) -> Array:
    """Distance from each corner to where its sides are seen, shape (k - 1, 2), metres.

    Single points that lie on a side by chance do not show it.
    """
    found = np.zeros((len(fitted.corners), 2))
    if kernel.compiled is not None:
        points = fitted.along, fitted.residuals, fitted.keep, np.array(fitted.edges)
        kernel.compiled.gaps_beside_corners(*points, np.array(fitted.places), fitted.sigmas, found)
        return found
    on = fitted.points_on_sides
    for i, places in enumerate(fitted.places):
        for j, s in enumerate(places):
            own = fitted.spans[i + j]
            seen, away = on[own], np.abs(fitted.along[own] - s)
            if j:
                seen, away = seen[::-1], away[::-1]
            dense = end_of_support(seen)
            found[i, j] = away[seen].min() if dense == 0 else away[:dense][seen[:dense]].min()
    return found


def corners_seen_from_both_sides(fitted: FittedProfile) -> NDArray[np.bool_]:
    """At which corners the points of one side go over into those of the next, shape (k - 1,)."""
    return np.asarray(gaps_beside_corners(fitted).max(axis=1) < MEETING_REACH)


def _unmodelled_steel_covariance(fit: GrooveFit, runs: PointRuns, off: NDArray[np.bool_]) -> Array:
    """What it adds, shape (2 k, 2 k), that steel beside a corner lies on neither of its sides.

    Points that hang together with those before and after them are no reflections, nor are those
    that a side goes on with beyond its corner; it is drawn on no farther than it is long. If they
    are several, and thicker than scale, the corner beside them may be at any of them.
    """
    fitted = fit.fitted
    covariance = np.zeros((2 * len(fitted.curves),) * 2)
    first, stop, joins = stretches_off_surface(runs, off)
    lengths = [np.ptp(fitted.along[own]) for own in fitted.spans]
    for a, b, joined in zip(first, stop, joins[0] & joins[1], strict=True):
        if b - a < FEWEST_HIDING or np.abs(fitted.residuals[a:b]).max() < THICKEST_SCALE:
            continue
        points = fit.row.points[a:b]
        on = np.median(np.abs(fitted.distances_from_sides(points)), axis=1) < THICKEST_SCALE
        for i, (corner, edge) in enumerate(zip(fitted.corners, fitted.edges[1:], strict=False)):
            away = points - corner
            near = np.hypot(*away[[0, -1]].T).min()
            beside = a <= edge <= b or near < MEETING_REACH
            goes_on = near < lengths[i] and a >= edge and on[i]
            goes_on |= near < lengths[i + 1] and b <= edge and on[i + 1]
            if goes_on or (joined and beside):
                own = slice(2 * i, 2 * i + 2)
                covariance[own, own] += away.T @ away / len(away)
    return covariance


def _reflection_covariance(fit: GrooveFit, runs: PointRuns, on: NDArray[np.bool_]) -> Array:
    """What it adds, shape (2 k, 2 k), that a side between others may be no surface.

    It surely is one if it goes over, by way of others or not, into the wall or into the leg. What
    goes over only into what itself goes over into neither may be a reflection with it.
    """
    fitted, sides = fit.fitted, fit.model.sides
    covariance = np.zeros((2 * len(sides),) * 2)
    meets = corners_seen_from_both_sides(fitted)
    from_wall, from_leg = (np.logical_and.accumulate(m) for m in (meets, meets[::-1]))
    for k, side in enumerate(sides[1:-1], 1):
        hides = side.bead and is_outnumbered(runs, on, fitted, k)
        together = meets[k - 1 : k + 1]
        # A face that goes over into both sides is steel; a bevel's end may be light all the same.
        if side.bead and together.all() and not hides:
            continue
        jumping = 0.0 if from_wall[k - 1] or from_leg[len(meets) - 1 - k] else 1.0
        if side.bead:
            jumping = SHARE_ENDING_AT_SURFACE if together.any() else 1.0
        if hides:
            probability = MOST_REFLECTION_PROBABILITY
        elif side.bead or together.any():
            # A face that goes over into neither may be half of what such light makes.
            points = int(fitted.counts[k]) // (1 if together.any() else 2)
            probability = share_in_long_stretches(runs, fitted.residuals, points, jumping=jumping)
        else:
            probability = reflection_probability(fitted)
        away = np.zeros(len(covariance))
        for i in (k - 1, k):
            away[2 * i : 2 * i + 2] = REFLECTION_DISTANCE * fitted.corner_shift(i, k)
        covariance += probability * np.outer(away, away)
    return covariance
