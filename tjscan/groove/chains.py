"""The cheapest chains of candidates that a groove's form allows, exactly.

Each point pays, up to a limit, for its distance to the side that its ray would hit: before its
start and after its end a side counts for nothing. That cost is a sum over corners, so the cheapest
of all chains, and every rival to it, follow by dynamic programming over pairs of neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove.candidates import CandidateSides, kinds_of_side
from tjscan.groove.pieces import ProjectivePoints
from tjscan.groove.reflections import PointRuns
from tjscan.groove.settings import GrooveModel, SideModel
from tjscan.groove.sides import Index, Polyline

FEWEST_INNER_POINTS: Final = 4
"""Points that must support an inner side."""

FEWEST_OUTER_POINTS: Final = 8
"""Points that must support the first side and the last."""

LEAST_SUPPORT_SHARE: Final = 0.12
"""Share of an inner side's points that must support it."""

LEAST_DISTANCE_OF_RIVALS: Final = 1e-3
"""Chains that differ less than this at every corner are the same one, in metres."""

MOST_CHAINS_COMPARED: Final = 150
"""Most chains of which the distinct ones are sought."""

RIVAL_COST_MARGIN: Final = 12.0
"""By how many outliers a chain may be dearer than the cheapest and still be looked at."""

CORNER_DISTANCE_BEYOND_POINTS: Final = 30e-3
"""How far a corner may lie outside all points, in metres."""

SIDE_LENGTH_SLACK: Final = 0.8
"""A side may be shorter than the model's shortest, or longer than its longest, by this factor."""

ROUGH_WELD = 0.5e-3

FACE_BLUNTNESS: Final = 0.2
"""Share of its height by which the face of a bead may lie off a parabola."""

WIDER_TOLERANCE_COST: Final = 0.3
"""What each point costs a side that reaches farther, times the logarithm of how much farther."""


@dataclass(frozen=True, slots=True, eq=False)
class _Corners:
    """Corners of every candidate with every other, shape (K, K, ...).

    `place` is the first point behind each; `turn` by how much the second turns from the first.
    """

    xz: Array
    place: Index
    turn: Array


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
        reach = np.where(candidates.kind == 2, FACE_BLUNTNESS * candidates.bows(), tolerance)
        reach = np.maximum(reach, tolerance)
        rough = candidates.kind == 3
        reach[rough] = np.clip(2 * candidates.roughness[rough], tolerance, ROUGH_WELD)
        scaled = candidates.distances(points) / reach[:, None]
        paid = np.minimum(
            scaled * scaled + WIDER_TOLERANCE_COST * np.log(reach / tolerance)[:, None], 1
        )
        self._runs, self._costs = runs, paid
        nothing = np.zeros((len(reach), 1))
        self._support = np.concatenate((nothing, (1 - paid).cumsum(axis=1)), axis=1)
        # No chain costs less than if every run that jumps off the surface were a reflection.
        least = paid * runs.most_per_point()
        self._paid = np.concatenate((nothing, least.cumsum(axis=1)), axis=1)
        self._corners = _intersect_candidates(points, candidates)

    def cheapest_chains(self, model: GrooveModel, most: int) -> list[Polyline]:
        """Cheapest chains of a form that differ, at most so many; none if none is allowed."""
        layers = [
            np.flatnonzero(np.isin(self.candidates.kind, kinds_of_side(s))) for s in model.sides
        ]
        if min(map(len, layers)) == 0:
            return []
        joints = []
        for (a, b), bounds in zip(zip(layers, layers[1:]), model.turns, strict=False):
            pair = np.ix_(a, b)
            turn, place = self._corners.turn[pair], self._corners.place[pair]
            pay = self._paid[a[:, None], place] - self._paid[b[None], place]
            allowed = (turn >= bounds.least) & (turn <= bounds.most) & (a[:, None] != b[None])
            joints.append(np.where(allowed, pay, np.inf))
        first = layers[0][:, None], self._corners.place[np.ix_(layers[0], layers[1])]
        joints[0] = np.where(self._support[first] < FEWEST_OUTER_POINTS, np.inf, joints[0])
        last = layers[-1][None], self._corners.place[np.ix_(layers[-2], layers[-1])]
        left = self._support[layers[-1], -1] - self._support[last]
        joints[-1] = np.where(left < FEWEST_OUTER_POINTS, np.inf, joints[-1])
        value, choices = joints[0], []
        for k, side in enumerate(model.sides[1:-1], 1):
            fits = self._fits_between(layers[k - 1 : k + 2], side)
            total = np.where(fits, value[:, :, None], np.inf) + joints[k][None]
            if k < len(joints) - 1:
                choices.append(total.argmin(axis=0))
                value = total.min(axis=0)
        total = total + self._paid[layers[-1], -1]
        costs = total.ravel()
        likely = np.flatnonzero(costs < min(float(costs.min()) + RIVAL_COST_MARGIN, np.inf))
        found: list[Polyline] = []
        dearest = np.inf
        for flat in likely[np.argsort(costs[likely])[:MOST_CHAINS_COMPARED]].tolist():
            if costs[flat] > dearest:
                break
            chain = [int(i) for i in np.unravel_index(flat, total.shape)]
            for choice in reversed(choices):
                chain.insert(0, int(choice[chain[0], chain[1]]))
            own = [int(layer[i]) for layer, i in zip(layers, chain, strict=True)]
            corners = self._corners.xz[own[:-1], own[1:]]
            if all(np.abs(corners - c.corners).max() > LEAST_DISTANCE_OF_RIVALS for c in found):
                curves = tuple(self.candidates.as_curve(k) for k in own)
                found.append(Polyline(curves, corners, self._exact_cost(own)))
                dearest = min(c.cost for c in found) + RIVAL_COST_MARGIN
        return sorted(found, key=lambda c: c.cost)[:most]

    def _exact_cost(self, chain: list[int]) -> float:
        """What all points pay if only runs that lie off the chain as a whole are reflections."""
        places = self._corners.place[chain[:-1], chain[1:]].tolist()
        bounds = zip((0, *places), (*places, self._costs.shape[1]), strict=True)
        costs = [self._costs[k, a:b] for k, (a, b) in zip(chain, bounds, strict=True)]
        return float(self._runs.total_cost(np.concatenate(costs)))

    def _fits_between(self, layers: list[Index], side: SideModel) -> NDArray[np.bool_]:
        """Whether a candidate fits between two neighbours as such a side, shape (m1, m2, m3)."""
        a, b, c = layers
        before, after = np.ix_(a, b), np.ix_(b, c)
        start, end = self._corners.place[before], self._corners.place[after]
        span = end[None] - start[:, :, None]
        support = self._support[b[:, None], end][None] - self._support[b[None], start][:, :, None]
        gap = self._corners.xz[after][None] - self._corners.xz[before][:, :, None]
        length = np.hypot(gap[..., 0], gap[..., 1])
        fits = (span > 0) & (
            support >= np.maximum(LEAST_SUPPORT_SHARE * span, FEWEST_INNER_POINTS * 0.7)
        )
        fits &= length > SIDE_LENGTH_SLACK * side.shortest
        return np.asarray(fits & (length < side.longest / SIDE_LENGTH_SLACK))


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
    turn = np.arctan2(tx * rz - tz * rx, tx * rx + tz * rz)
    xz = np.stack((-u / y, 1 / y), axis=-1)
    spread = CORNER_DISTANCE_BEYOND_POINTS
    depth, across = points.z, -points.u * points.z
    inside = (y > 0) & (xz[..., 1] > depth.min() - spread) & (xz[..., 1] < depth.max() + spread)
    inside &= (xz[..., 0] > across.min() - spread) & (xz[..., 0] < across.max() + spread)
    return _Corners(xz, points.u.searchsorted(u), np.where(inside, turn, np.nan))
