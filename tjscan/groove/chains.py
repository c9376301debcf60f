"""The cheapest chains of candidates that a groove's form allows, exactly.

Each point pays, up to a limit, for its distance to the side that its ray would hit: before its
start and after its end a side counts for nothing. That cost is a sum over corners, so the cheapest
of all chains follows by dynamic programming over pairs of neighbours, with its rivals: of chains
that differ only before their last three sides, the cheapest. Only what a run of reflections costs
is no such sum. It is bounded from below first, and counted for the cheapest by that bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove import kernel
from tjscan.groove.candidates import (
    BEAD_KIND,
    BENT_KIND,
    CANDIDATE_KINDS,
    STRAIGHT_KIND,
    WELD_KIND,
    CandidateSides,
)
from tjscan.groove.pieces import ProjectivePoints
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


@dataclass(frozen=True, slots=True, eq=False)
class _Corners:
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
        sums = _running_sums(paid)
        # No chain costs less than if every run that jumps off the surface were a reflection.
        least = _running_sums(paid * runs.largest_cost_per_point())
        self._corners = _intersect_candidates(points, candidates)
        own = np.arange(len(reach))
        place, x, z = self._corners.place, self._corners.x, self._corners.z
        before, after = (own[:, None], place), (own, place)
        self._before = np.stack((place, x, z, place - sums[before]), axis=-1)
        self._after = np.stack((place, x, z, place - sums[after]), axis=-1)
        behind = paid.shape[1] - place
        left = behind - sums[:, -1] + sums[after]
        self._begins = self._before[..., 3] >= np.maximum(
            LEAST_SUPPORT_SHARE * place, FEWEST_OUTER_POINTS
        )
        self._ends = left >= np.maximum(LEAST_SUPPORT_SHARE * behind, FEWEST_OUTER_POINTS)
        self._pay = least[before] - least[after]
        self._total = least[:, -1]
        self._kinds = [np.flatnonzero(candidates.kind == k) for k in range(len(CANDIDATE_KINDS))]

    def cheapest_chains(self, model: GrooveModel, most: int) -> list[SideChain]:
        """Cheapest chains of a form that differ, at most so many; none if none is allowed."""
        if kernel.compiled is not None:
            cheapest = kernel.compiled.cheapest_chains(self._search, _form_values(model), most)
            return [SideChain(c, sides, np.array(xz).reshape(-1, 2)) for c, sides, xz in cheapest]
        layers = [
            np.concatenate([self._kinds[k] for k in kinds]) for kinds in kinds_of_sides(model)
        ]
        chains, costs = np.empty((1, 0), dtype=np.intp), np.empty(0)
        for i, bounds in enumerate(model.turns):
            pair = layers[i][:, None], layers[i + 1]
            turn = self._corners.before[pair] - self._corners.after[pair]
            allowed = (turn >= bounds.least) & (turn <= bounds.most)
            if i == 0:
                allowed &= self._begins[pair]
            if i == len(model.turns) - 1:
                allowed &= self._ends[pair]
            first, second = allowed.nonzero()
            joint = np.array((layers[i][first], layers[i + 1][second]))
            if i == 0:
                chains, costs = joint, self._pay[tuple(joint)]
                continue
            chains, costs, number = self._lengthen_chains(chains, costs, joint, model.sides[i])
            if i < len(model.turns) - 1:
                # Of those with the same last two sides the cheapest goes on.
                order = np.lexsort((costs, number))
                order = order[np.diff(number[order], prepend=-1) > 0]
                chains, costs = chains[:, order], costs[order]
        if not len(costs):
            return []
        costs += self._total[chains[-1]]
        chains = chains[:, np.argsort(costs)[:MOST_CHAINS_COMPARED]].T
        pair = chains[:, :-1], chains[:, 1:]
        across = self._corners.before[pair][:, 0] - self._corners.after[pair][:, -1]
        costs = np.where(
            (across >= model.across.least) & (across <= model.across.most),
            self._exact_costs(chains, self._corners.place[pair]),
            np.inf,
        )
        corners = np.stack((self._corners.x[pair], self._corners.z[pair]), axis=-1)
        found: list[SideChain] = []
        for i in np.argsort(costs, kind="stable").tolist():
            if len(found) == most or not costs[i] < costs.min() + RIVAL_COST_MARGIN:
                break
            if all(np.abs(corners[i] - c.corners).max() > LEAST_DISTANCE_OF_RIVALS for c in found):
                found.append(SideChain(float(costs[i]), chains[i].tolist(), corners[i]))
        return found

    def _exact_costs(self, chains: Index, places: Index) -> Array:
        """What all points pay if only runs that lie off a chain as a whole are reflections, (m,).

        Corners of the m chains, shape (m, k), come before the points `places`, shape (m, k - 1).
        """
        count = self._costs.shape[1]
        sizes = np.diff(places, axis=1, prepend=0, append=count)
        sides = chains.ravel().repeat(sizes.ravel()).reshape(-1, count)
        return self._runs.total_cost(self._costs.take(sides * count + np.arange(count)))

    def _lengthen_chains(
        self, chains: Index, costs: Array, joint: Index, side: SideModel
    ) -> tuple[Index, Array, Index]:
        """Chains, shape (k, m), that end with pairs `joint`, (2, p), their costs, and which pairs.

        The last side of the chains so far, shape (k - 1, ...), has to fit as such a side.
        """
        start = joint[0].searchsorted(chains[-1])
        count = joint[0].searchsorted(chains[-1], side="right") - start
        own = np.arange(len(costs)).repeat(count)
        pair = np.arange(len(own)) + (start - count.cumsum() + count).repeat(count)
        a, (b, c) = chains[-2, own], joint[:, pair]
        span, x, z, support = (self._before[b, c] - self._after[a, b]).T
        square = x * x + z * z
        fits = (
            (span > 0) & (support >= LEAST_SUPPORT_SHARE * span) & (support >= FEWEST_INNER_POINTS)
        )
        fits &= square > (SIDE_LENGTH_SLACK * side.shortest) ** 2
        fits &= square < (side.longest / SIDE_LENGTH_SLACK) ** 2
        if side.bead:
            chord = np.arctan2(z, -x)
            fits &= self._corners.before[a, b] - chord > LEAST_FACE_TURN
            fits &= chord - self._corners.after[b, c] > LEAST_FACE_TURN
        own, pair = own[fits], pair[fits]
        longer = np.concatenate((chains[:, own], joint[1:, pair]))
        return longer, costs[own] + self._pay[longer[-2], longer[-1]], pair


@lru_cache
def _form_values(model: GrooveModel) -> Array:
    """What the compiled kernel knows of a form, shape (k, 7)."""
    kinds = [sum(1 << kind for kind in own) for own in kinds_of_sides(model)]
    turns = [*((turn.least, turn.most) for turn in model.turns), (0.0, 0.0)]
    ends = [model.across.least, model.across.most, *[0.0] * len(turns)]
    return np.array(
        [
            (kind, side.shortest, side.longest, side.bead, *turn, end)
            for kind, side, turn, end in zip(kinds, model.sides, turns, ends, strict=False)
        ]
    )


def kinds_of_sides(model: GrooveModel) -> list[tuple[int, ...]]:
    """Which kinds each side may be of; the face of a bead may as well be straight."""
    kinds: list[tuple[int, ...]] = []
    for side in model.sides:
        bent = BENT_KIND if side.bend > 2 * CANDIDATE_KINDS[STRAIGHT_KIND].bend else STRAIGHT_KIND
        bead = (WELD_KIND,) if side.roughness else (STRAIGHT_KIND, BEAD_KIND)
        kinds.append(bead if side.bead else (bent,))
    return kinds


def _running_sums(values: Array) -> Array:
    """Sums of the first 0, 1, 2 … values of each row, shape (m, n) to (m, n + 1)."""
    sums = np.zeros((len(values), values.shape[1] + 1))
    np.cumsum(values, axis=1, out=sums[:, 1:])
    return sums


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
