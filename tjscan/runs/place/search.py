"""Search for the fewest places of an arm's base from which a whole groove is scanned.

Every place of a grid about the joint is tried: where along the groove the flange gets, in one
branch of the inverse kinematics and without a jump, off singularities, clear of everything. Of the
arcs that are reached, the fewest that cover the groove with overlaps are taken.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np

from tjscan.core.frames import Array, Mask, inverse_pose, pose, rot_z
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.tool_reach import JOINT_JUMP_ANGLE

AZIMUTHS_TRIED: Final = 120
"""Places round the groove at which the arm is tried: 3° apart."""

SIDE_STEP, DISTANCE_STEP, HEIGHT_STEP = np.pi / 6, 0.1, 0.15
"""Of the bases that are tried first: the side of the joint, and shares of the arm's reach."""

SIDES_TRIED: Final = SIDE_STEP * np.arange(12, dtype=np.float64)
DISTANCES_TRIED: Final = 0.35 + DISTANCE_STEP * np.arange(7, dtype=np.float64)
HEIGHTS_TRIED: Final = -0.5 + HEIGHT_STEP * np.arange(10, dtype=np.float64)

AXIS_STEP, AXIS_TURN = 0.25, np.pi / 12
"""Of a carrier's axes: a share of the arm's reach, and an angle."""

COARSE_STRIDE: Final = 4
"""Of the azimuths at which it is looked first whether anything hinders the arm."""

GROOVE_SECTORS: Final = 12
SEEDS_OF_SECTOR, LOOKED_AT_OF_SECTOR = 2, 6
"""Arcs, by the sector in which their middle lies: the best ones about whose bases nearer ones are
tried, and of all then those that are looked at azimuth by azimuth."""

FEWEST_DEGREES: Final = 40.0
"""Shorter arcs are no station."""

Place = tuple[float, ...]
"""Of a base: side of the joint, radians, distance and height, shares of the reach; or values of a
carrier's axes, metres and radians."""

BaseAt = Callable[[Place], Array | None]
"""Gives the pose T_w_b of a base at a place, or None where none may stand."""

Hindrance = Callable[[Array], Callable[[Array], bool]]
"""Gives for a base, T_w_b, what tells whether joint angles are hindered there."""


@dataclass(frozen=True, slots=True, eq=False)
class ReachedArc:
    """What a base reaches of a groove in one sweep.

    Parameters
    ----------
    place : tuple of float
        Of the base in the search.
    T_w_b : ndarray, shape (4, 4)
        Where the base stands, in frame w, metres.
    first, count : int
        Number of the first azimuth, and how many are reached from there on.
    q : ndarray, shape (count, 6)
        Joint angles there, radians, within their limits and without jumps.
    """

    place: Place
    T_w_b: Array
    first: int
    count: int
    q: Array

    @property
    def last(self) -> int:
        """Number of the last azimuth; a turn more where the arc runs over the first one."""
        return self.first + self.count - 1

    def without_ends(self, count: int) -> ReachedArc:
        """The arc without so many azimuths at either end."""
        return _part(self, count, self.count - 2 * count)


def reach_of_arm(kinematics: Kinematics) -> float:
    """Metres of upper arm and forearm; what is beyond them can be turned to and fro."""
    links = kinematics.link_poses(np.zeros(len(kinematics.lower)))[:, :3, 3]
    return float(np.sort(np.linalg.norm(np.diff(links, axis=0), axis=1))[-2:].sum())


def base_about(place: Place, origin_w: Array, reach: float, mount: Array) -> Array:
    """Pose T_w_b, shape (4, 4), of a base at a side of a joint, turned towards it.

    Parameters
    ----------
    place : tuple of float
        Side, distance and height.
    origin_w : ndarray, shape (3,)
        Middle of the groove, metres.
    reach : float
        Of the arm, metres.
    mount : ndarray, shape (4, 4)
        How a base is mounted that is turned towards x.
    """
    side, far, high = place
    beside = np.array((far * np.cos(side), far * np.sin(side), high))
    return np.asarray(pose(rot_z(side + np.pi), origin_w + reach * beside) @ mount)


class BaseSearch:
    """Search for bases from which an arm reaches long arcs of a groove.

    Parameters
    ----------
    kinematics : Kinematics
        Of an arm with a closed form of its inverse.
    T_w_f : ndarray, shape (n, 4, 4)
        Flange poses round the groove, the last one before the first.
    grid : sequence of ndarray
        Coordinates of the places that are tried first, each evenly spaced.
    base_at : BaseAt
        Where the base is then.
    hindrance : Hindrance
        What is in the arm's way.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        T_w_f: Array,
        grid: Sequence[Array],
        base_at: BaseAt,
        hindrance: Hindrance,
    ) -> None:
        self._kinematics, self._T_w_f, self._grid = kinematics, T_w_f, grid
        self._base_at, self._hindrance = base_at, hindrance
        self._least = round(FEWEST_DEGREES / 360 * len(T_w_f))
        self.longest_unhindered = 0
        """Azimuths that a base reaches in one sweep if nothing were in its way."""

    def arcs(self) -> list[ReachedArc]:
        """Long arcs that are reached, clear of everything, from all sides."""
        found = self._coarse(product(*(values.tolist() for values in self._grid)))
        seeds = {arc.place for arc, _ in self._best(found, SEEDS_OF_SECTOR)}
        steps = np.array([values[1] - values[0] for values in self._grid]) / 2
        ways = product((-1, 0, 1), repeat=len(steps))
        around = [np.array(way) * steps for way in ways if any(way)]
        nearer = {tuple((np.array(seed) + way).tolist()) for seed in seeds for way in around}
        found += self._coarse(sorted(nearer))
        looked_at = [arc for arc, _ in self._best(found, LOOKED_AT_OF_SECTOR)]
        return [clear_part(arc, self._hindrance(arc.T_w_b)) for arc in looked_at]

    def _coarse(self, places: Iterable[Place]) -> list[tuple[ReachedArc, int]]:
        """The best arc of each base, and how many azimuths of it are clear about."""
        found = []
        for place in places:
            if (T_w_b := self._base_at(place)) is None:
                continue
            arcs = reached_arcs(self._kinematics, self._T_w_f, T_w_b, place)
            self.longest_unhindered = max([self.longest_unhindered, *(a.count for a in arcs)])
            hindered, best = self._hindrance(T_w_b), self._least - 1
            for arc in sorted(arcs, key=lambda arc: -arc.count):
                if arc.count <= best:
                    break
                clear = COARSE_STRIDE * clear_part(arc, hindered, COARSE_STRIDE).count
                if clear > best:
                    best, longest = clear, arc
            if best >= self._least:
                found.append((longest, best))
        return found

    def _best(self, arcs: list[tuple[ReachedArc, int]], each: int) -> list[tuple[ReachedArc, int]]:
        """The longest arcs of each sector of the groove."""
        n = len(self._T_w_f)
        sectors: dict[int, list[tuple[ReachedArc, int]]] = defaultdict(list)
        for arc, count in sorted(arcs, key=lambda one: -one[1]):
            sectors[(arc.first + arc.count // 2) % n * GROOVE_SECTORS // n].append((arc, count))
        return [one for sector in sectors.values() for one in sector[:each]]


def clear_part(arc: ReachedArc, hindered: Callable[[Array], bool], stride: int = 1) -> ReachedArc:
    """Longest part of an arc where nothing hinders the arm, looked at with a stride."""
    clear = np.array([not hindered(q) for q in arc.q[::stride]], dtype=bool)
    return _part(arc, *_longest_open_run(clear))


def reached_arcs(
    kinematics: Kinematics, T_w_f: Array, T_w_b: Array, place: Place = (0.0, 0.0, 0.0)
) -> list[ReachedArc]:
    """Longest arc that each branch reaches of a groove, within joint limits.

    Parameters
    ----------
    kinematics : Kinematics
        Of an arm with a closed form of its inverse.
    T_w_f : ndarray, shape (n, 4, 4)
        Flange poses round the groove, the last one before the first.
    T_w_b : ndarray, shape (4, 4)
        The base.
    place : tuple of float, optional
        The base's in a search.
    """
    q = kinematics.inverse_branches(inverse_pose(T_w_b) @ T_w_f)
    found = []
    for branch in np.moveaxis(q, 1, 0):
        turn = np.roll(branch, -1, axis=0) - branch
        turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
        with np.errstate(invalid="ignore"):
            joined = np.abs(turn).max(axis=1) < JOINT_JUMP_ANGLE
        first, count = longest_run(joined)
        if count == 0:
            continue
        count = min(count + 1, len(branch))  # n joints of neighbours join n + 1
        path = np.unwrap(branch[np.arange(first, first + count) % len(branch)], axis=0)
        found.append(_within_limits(kinematics, ReachedArc(place, T_w_b, first, count, path)))
    return found


def fewest_stations(
    arcs: Sequence[ReachedArc], azimuths: int, overlap: int, most: int
) -> tuple[ReachedArc, ...]:
    """The fewest arcs that cover a groove all round; of as many, those with the most to spare.

    Parameters
    ----------
    arcs : sequence of ReachedArc
    azimuths : int
        Round the groove.
    overlap : int
        Azimuths that neighbouring arcs have to share.
    most : int
        Stations at most; none are given if they are not enough.
    """
    best: tuple[int, float, tuple[ReachedArc, ...]] = (most + 1, -np.inf, ())
    for start in arcs:
        chosen, last = [start], start.last
        while last < start.first + azimuths + overlap - 1 and len(chosen) < best[0]:
            # Each in its latest turn that still shares enough with what is covered so far.
            turns = [(last - overlap + 1 - arc.first) // azimuths for arc in arcs]
            reach, following = max(
                ((arc.last + azimuths * turn, arc) for arc, turn in zip(arcs, turns, strict=True)),
                key=lambda item: item[0],
            )
            if reach <= last:
                break
            chosen.append(following)
            last = reach
        spare = last - (start.first + azimuths + overlap - 1)
        if spare >= 0 and (len(chosen), -spare) < best[:2]:
            best = (len(chosen), -spare, tuple(chosen))
    return best[2]


def longest_run(holds: Mask) -> tuple[int, int]:
    """First of the longest run on a ring, and its length; all of it if there is no end."""
    n = len(holds)
    if holds.all():
        return 0, n
    ends = int(np.flatnonzero(~holds)[0])
    first, count = _longest_open_run(np.roll(holds, -ends))
    return (first + ends) % n, count


def _longest_open_run(holds: Mask) -> tuple[int, int]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], holds, [False]))))
    if not len(edges):
        return 0, 0
    starts, ends = edges[::2], edges[1::2]
    i = int((ends - starts).argmax())
    return int(starts[i]), int(ends[i] - starts[i])


def _part(arc: ReachedArc, first: int, count: int) -> ReachedArc:
    part = slice(first, first + count)
    return replace(arc, first=arc.first + first, count=count, q=arc.q[part])


def _within_limits(kinematics: Kinematics, arc: ReachedArc) -> ReachedArc:
    """Longest part that a whole number of turns of each joint brings within its limits."""
    middle = (kinematics.lower + kinematics.upper) / 2
    centre = (arc.q.min(axis=0) + arc.q.max(axis=0)) / 2
    q = arc.q - 2 * np.pi * np.round((centre - middle) / (2 * np.pi))
    inside = np.asarray((kinematics.joint_limit_excess(q) <= 0).all(axis=1))
    return _part(replace(arc, q=q), *_longest_open_run(inside))
