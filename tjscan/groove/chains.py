"""The cheapest chains of candidates that a groove's form allows, exactly.

Each point pays, up to a limit, for its distance to the side that its ray would hit: before its
start and after its end a side counts for nothing. That cost is a sum over corners, so the cheapest
of all chains follows by dynamic programming over pairs of neighbours, with its rivals: of chains
that differ only before their last three sides, the cheapest. Only what a run of reflections costs
is no such sum. It is bounded from below first, and counted for the cheapest by that bound.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove import kernel
from tjscan.groove.candidates import (
    BEAD_KIND,
    BENT_KIND,
    KIND_BENDS,
    STRAIGHT_KIND,
    WELD_KIND,
    CandidateSides,
    ProjectivePoints,
    running_sums,
)
from tjscan.groove.reflections import PointRuns
from tjscan.groove.settings import LEAST_FACE_TURN, GrooveModel, SideModel
from tjscan.groove.sides import Index

FEWEST_INNER_POINTS: Final = 2.8
"""Points that must support an inner side: four at half a tolerance count as three."""

FEWEST_OUTER_POINTS: Final = 8
"""Points that must support the first side and the last."""

LEAST_SUPPORT_SHARE: Final = 0.12
"""Share of a side's points that must support it."""

LEAST_DISTANCE_OF_RIVALS: Final = 1e-3
"""Chains that differ less than this at every corner are the same one, in metres."""

MOST_CHAINS_COMPARED: Final = 150
"""Most chains among which the distinct ones are sought."""

RIVAL_COST_MARGIN: Final = 12.0
"""By how many outliers a chain may be dearer than the cheapest and still be looked at."""

CORNER_DISTANCE_BEYOND_POINTS: Final = 30e-3
"""How far a corner may be outside all points, in metres."""

SIDE_LENGTH_SLACK: Final = 0.8
"""A side may be shorter than the model's shortest, or longer than its longest, by this factor."""

WIDER_TOLERANCE_COST: Final = 0.3
"""What each point costs a side that reaches farther, times the logarithm of how much farther."""


class _Corners(NamedTuple):
    """Corners of every candidate with every other, shape (K, K, ...).

    Parameters
    ----------
    x, z : ndarray
        In metres.
    place : ndarray of int
        First point behind each.
    before, after : ndarray
        Directions in which the first candidate and the second go on there, in radians, from the
        wall to the leg and rising with depth; NaN if they do not meet.
    """

    x: Array
    z: Array
    place: Index
    before: Array
    after: Array


class SideChain(NamedTuple):
    """Candidates for the sides of a groove, in their order.

    Parameters
    ----------
    cost : float
        What all points pay, in outliers.
    sides : list of int
        Numbers of the candidates.
    corners : ndarray, shape (k - 1, 2)
        Where neighbours meet, x and z in metres.
    """

    cost: float
    sides: list[int]
    corners: Array


class ChainSearch:
    """A profile's candidates, what its points pay for them, and the corners between them.

    Parameters
    ----------
    points : ProjectivePoints
    candidates : CandidateSides
        Of K curves.
    runs : PointRuns
        Of these points.
    tolerance : float
        Distance at which a point stops supporting a side, in metres.
    """

    def __init__(
        self,
        points: ProjectivePoints,
        candidates: CandidateSides,
        runs: PointRuns,
        tolerance: float,
    ) -> None:
        self.candidates = candidates
        if kernel.compiled is not None:
            curves = candidates.coefficients, candidates.first, candidates.last
            self._search = kernel.compiled.begin_search(
                *(points.u, points.z, candidates.kind, candidates.roughness, *curves),
                *(runs.first, runs.count, runs.jumps, tolerance),
            )
            return
        reach = candidates.reaches(tolerance)
        wider = WIDER_TOLERANCE_COST * np.log(reach / tolerance)[:, None]
        paid = np.minimum(candidates.scaled_distances(points, reach) ** 2 + wider, 1)
        self._runs, self._costs = runs, paid
        sums = running_sums(paid)
        # No chain costs less than if every run that jumps off the surface were a reflection.
        least = running_sums(paid * runs.largest_cost_per_point())
        self._corners = corners = _intersect_candidates(points, candidates)
        own, place = np.arange(len(reach)), corners.place
        before, after = (own[:, None], place), (own, place)
        self._before = np.stack((place, corners.x, corners.z, place - sums[before]))
        self._after = np.stack((place, corners.x, corners.z, place - sums[after]))
        behind = paid.shape[1] - place
        shown = np.stack((self._before[3], behind - sums[:, -1] + sums[after]))
        needed = LEAST_SUPPORT_SHARE * np.stack((place, behind))
        self._begins, self._ends = shown >= np.maximum(needed, FEWEST_OUTER_POINTS)
        self._pay = least[before] - least[after]
        self._total = least[:, -1]

    def cheapest_chains(self, model: GrooveModel, most: int) -> list[SideChain]:
        """Cheapest chains of a form that differ, at most so many; none if none is allowed."""
        if kernel.compiled is not None:
            cheapest = kernel.compiled.cheapest_chains(self._search, _form_values(model), most)
            return [SideChain(c, sides, np.array(xz).reshape(-1, 2)) for c, sides, xz in cheapest]
        kinds = kinds_of_sides(model)
        layers = [np.flatnonzero(np.isin(self.candidates.kind, kind)) for kind in kinds]
        pairs = [np.ix_(*pair) for pair in pairwise(layers)]
        steps = []
        for bounds, pair in zip(model.turns, pairs, strict=True):
            turn = self._corners.before[pair] - self._corners.after[pair]
            allowed = (turn >= bounds.least) & (turn <= bounds.most)
            steps.append(np.where(allowed, self._pay[pair], np.inf))
        steps[0] = np.where(self._begins[pairs[0]], steps[0], np.inf)
        steps[-1] = np.where(self._ends[pairs[-1]], steps[-1], np.inf)
        cost, ways = steps[0], []
        for i, step in enumerate(steps[1:], 1):
            cost = np.where(
                self._may_be_side(pairs[i - 1], pairs[i], model.sides[i]),
                cost[:, :, None] + step,
                np.inf,
            )
            if i + 1 < len(steps):
                # Of those with the same last two sides the cheapest goes on.
                ways.append(cost.argmin(axis=0))
                cost = cost.min(axis=0)
        cost = (cost + self._total[layers[-1]]).ravel()
        order = np.argsort(cost)[:MOST_CHAINS_COMPARED]
        order = order[np.isfinite(cost[order])]
        if not len(order):
            return []
        last = list(np.unravel_index(order, [len(layer) for layer in layers[-3:]]))
        for way in reversed(ways):
            last.insert(0, way[last[0], last[1]])
        chains = np.transpose([layer[one] for layer, one in zip(layers, last, strict=True)])
        pair = chains[:, :-1], chains[:, 1:]
        across = self._corners.before[pair][:, 0] - self._corners.after[pair][:, -1]
        costs = self._exact_costs(chains, self._corners.place[pair])
        costs[~((across >= model.across.least) & (across <= model.across.most))] = np.inf
        corners = np.stack((self._corners.x[pair], self._corners.z[pair]), axis=-1)
        found: list[SideChain] = []
        for i in np.argsort(costs, kind="stable").tolist():
            if len(found) == most or not costs[i] < costs.min() + RIVAL_COST_MARGIN:
                break
            if all(np.abs(corners[i] - c.corners).max() > LEAST_DISTANCE_OF_RIVALS for c in found):
                found.append(SideChain(float(costs[i]), chains[i].tolist(), corners[i]))
        return found

    def _may_be_side(
        self, before: tuple[Index, ...], after: tuple[Index, ...], side: SideModel
    ) -> NDArray[np.bool_]:
        """Which candidates b between a and c may be such a side, shape (a, b, c).

        Parameters
        ----------
        before, after : tuple of ndarray
            Numbers of all a and b, and of all b and c, as `numpy.ix_` gives them.
        side : SideModel
        """
        span, x, z, support = (
            one[after] - other[before][..., None]
            for one, other in zip(self._before, self._after, strict=True)
        )
        square, least = x * x + z * z, np.maximum(LEAST_SUPPORT_SHARE * span, FEWEST_INNER_POINTS)
        fits = (span > 0) & (support >= least)
        fits &= square > (SIDE_LENGTH_SLACK * side.shortest) ** 2
        fits &= square < (side.longest / SIDE_LENGTH_SLACK) ** 2
        if side.bead:
            chord = np.arctan2(z, -x)
            fits &= self._corners.before[before][..., None] - chord > LEAST_FACE_TURN
            fits &= chord - self._corners.after[after] > LEAST_FACE_TURN
        return np.asarray(fits)

    def _exact_costs(self, chains: Index, places: Index) -> Array:
        """What all points pay if only runs that lie off a chain as a whole are reflections, (m,).

        Corners of the m chains, shape (m, k), come before the points `places`, shape (m, k - 1).
        """
        count = self._costs.shape[1]
        sizes = np.diff(places, axis=1, prepend=0, append=count)
        sides = chains.ravel().repeat(sizes.ravel()).reshape(-1, count)
        return self._runs.total_cost(self._costs.take(sides * count + np.arange(count)))


@lru_cache
def _form_values(model: GrooveModel) -> Array:
    """What the compiled kernel knows of a form, shape (k, 7)."""
    values = np.zeros((len(model.sides), 7))
    values[:, 0] = [sum(1 << kind for kind in own) for own in kinds_of_sides(model)]
    values[:, 1:4] = [(side.shortest, side.longest, side.bead) for side in model.sides]
    values[:-1, 4:6] = [(turn.least, turn.most) for turn in model.turns]
    values[:2, 6] = model.across.least, model.across.most
    return values


def kinds_of_sides(model: GrooveModel) -> list[tuple[int, ...]]:
    """Which kinds each side may be of; the face of a bead may as well be straight."""
    kinds: list[tuple[int, ...]] = []
    for side in model.sides:
        bent = BENT_KIND if side.bend > 2 * KIND_BENDS[STRAIGHT_KIND] else STRAIGHT_KIND
        bead = (WELD_KIND,) if side.roughness else (STRAIGHT_KIND, BEAD_KIND)
        kinds.append(bead if side.bead else (bent,))
    return kinds


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def _intersect_candidates(points: ProjectivePoints, candidates: CandidateSides) -> _Corners:
    """Where every candidate meets every other, behind the end of the one before; NaN if nowhere."""
    a, b, c = (v[:, None] - v[None] for v in candidates.coefficients.T)
    # The root next to where one ends and the other begins.
    middle = 0.5 * (candidates.last[:, None] + candidates.first[None])
    a, b = a + middle * (b + middle * c), b + 2 * middle * c
    root = np.sqrt(b * b - 4 * a * c)
    u = middle - 2 * a / (b + np.copysign(root, b))
    y, slope = candidates.heights_and_slopes(u)
    other_slope = candidates.coefficients[:, 1] + 2 * u * candidates.coefficients[:, 2]
    tx, tz, rx, rz = u * slope - y, -slope, u * other_slope - y, -other_slope
    before, after = np.arctan2(tz, -tx), np.arctan2(rz, -rx)
    z, spread = 1 / y, CORNER_DISTANCE_BEYOND_POINTS
    x = -u * z
    inside = y > 0
    for value, seen in ((x, points.u * -points.z), (z, points.z)):
        inside &= (value > seen.min() - spread) & (value < seen.max() + spread)
    before[~inside] = np.nan
    return _Corners(x, z, points.u.searchsorted(u), before, after)
