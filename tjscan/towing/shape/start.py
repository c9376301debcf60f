"""Where a tow may begin: best shapes of many searches, on either side of every pillar.

They begin with paths of a given length between two poses: arcs and straight pieces, through poses
between. From one pose to the next leads the shortest path of arc, straight piece and arc: Dubins
(1957), On curves of minimal length with a constraint on average curvature. The poses between are
moved until the whole has the length.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tjscan.core.frames import Array
from tjscan.towing.shape.area import Floor
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.limited import LIMIT_VIOLATION_COST, optimise_within_limits
from tjscan.towing.shape.limits import LEAST_KEPT_MARGIN, LimitedProblem, worst_margin
from tjscan.towing.shape.problem import minimise_objective

TURN_SIDES: Final = ((1, 1), (1, -1), (-1, 1), (-1, -1))
"""To which the two arcs turn: 1 is left."""

LEAD_DIRECTIONS: Final = 12
"""Directions in which a bend is led away, and its headings there."""

BEND_BASE_SHARES: Final = (0.25, 0.5, 0.75)
"""Of the line between the ends, from where a single bend is led away."""

TRIED_RADII: Final = 4
"""Of arcs, each twice the one before."""

MEANDER_LANE_WIDTHS_IN_RADII: Final = (2.2, 4.4)
"""Radii from one lane of a meander to the next: two would make half circles of its bends."""

SMALLEST_TRIED_RADIUS_FACTOR: Final = 1.05
"""Times the least radius is the smallest: links are chords, and are yet to be fitted."""

TRIED_OFFSETS: Final = 48
"""Places along a direction between which a length may be met."""

OFFSET_HALVINGS: Final = 24
"""Of the way between two of them."""

LENGTH_TOLERANCE: Final = 1e-3
"""Share of the length within which it is met: nearer is a matter for the chain's own solver."""

MOST_START_SHAPES: Final = 12
"""First shapes from which the best one is looked for, of the many that are made."""

MOST_BENDS: Final = 4
"""Of a meander at most, tried where shapes with fewer end nowhere."""

SAME_SHAPE_DISTANCE: Final = 0.01
"""Share of the cable's length that links of two shapes are apart in the mean, below which they are
the same."""

MOST_NEWTON_STEPS: Final = 150
"""Of a search, at most."""

MOST_CLOSING_STEPS: Final = 10
"""Steps that bring a shape to the welder's pose; three or four are usual."""

MOST_QUADRATIC_PROGRAMS: Final = 60
"""Of a search for a shape that a limit is in the way of, at most."""


def start_shapes(limits: LimitedProblem, area: Floor, welder_pose: Array) -> list[Array]:
    """Shapes that keep all limits, best first; none if there is none. Angles of shape (N,).

    Parameters
    ----------
    limits : LimitedProblem
        Of a problem with no weight of change and pace: there is nothing to stay near to.
    area : Floor
    welder_pose : ndarray, shape (3,)
    """
    for shapes in first_shapes(limits.problem.cable, area, welder_pose):
        if found := _search_shapes(limits, area, shapes):
            return found
    return []


def first_shapes(cable: Cable, area: Floor, welder_pose: Array) -> Iterator[list[Array]]:
    """Shapes of arcs and straight pieces from root to welder: bent once, then in more lanes."""
    root, middles = np.array(cable.root), (np.arange(cable.links) + 0.5) * cable.link_length
    given = root, welder_pose, cable.length, cable.least_bend_radius
    low, high = area.outline.min(axis=0), area.outline.max(axis=0)
    share = np.array((0.25, 0.5, 0.75))
    centres = np.stack(np.meshgrid(*(low + (high - low) * share[:, None]).T), -1).reshape(-1, 2)
    for bends in range(1, 1 + MOST_BENDS):
        paths = (
            one_bend_headings(*given) if bends == 1 else meander_headings(*given, bends, centres)
        )
        headings = (np.interp(middles, path[:, 0], path[:, 1]) for path in paths)
        yield [cable.angles(along) for along in headings]


def _search_shapes(limits: LimitedProblem, area: Floor, shapes: list[Array]) -> list[Array]:
    """What searches from the most promising of some shapes end with."""
    problem, cable = limits.problem, limits.problem.cable

    def objective(angles: Array) -> float:
        return problem.terms(angles).total

    def cost(angles: Array) -> float:
        return objective(angles) - LIMIT_VIOLATION_COST * worst_margin(limits.rows(angles))

    centres = [
        *(pillar.mean(axis=0) for pillar in area.pillars),
        *(disc[:2] for disc in problem.obstacles.discs),
    ]
    guesses = _distinct_shapes(cable, sorted(shapes, key=cost), centres)[:MOST_START_SHAPES]
    searched = (search_shape(limits, guess) for guess in guesses)
    found = sorted((angles for angles in searched if angles is not None), key=objective)
    return sorted(_distinct_shapes(cable, found, centres), key=objective)


def search_shape(limits: LimitedProblem, guess: Array) -> Array | None:
    """Best shape near a guess, angles of shape (N,), radians; None if it keeps no limits."""
    angles = guess.copy()
    minimise_objective(angles, MOST_NEWTON_STEPS, 1e-4, *limits.problem.plain)
    begins = iter((guess, _slackened(limits, guess)))
    while not _close_on_welder_pose(limits, angles):
        if (begin := next(begins, None)) is None:
            return None
        angles = optimise_within_limits(limits, begin, most=MOST_QUADRATIC_PROGRAMS).angles.copy()
    return angles


def _slackened(limits: LimitedProblem, angles: Array) -> Array:
    """A shape whose pieces between vehicles wind to either side by turns, as far as pull demands.

    Of a straight piece no small turn makes the chord shorter. Headings that go as a cosine of
    amplitude a make it a² / 4 of its length shorter.
    """
    ends = np.array((0, *(link + 1 for link in limits.team.held_links)))
    counts, step = np.diff(ends), limits.arrays.length
    slack = np.maximum(1 - limits.arrays.longest / (counts * step), 0.0)
    phase = np.interp(np.arange(len(angles)) + 0.5, ends, np.pi * np.arange(len(ends)))
    turned = np.repeat(2 * np.sqrt(slack), counts) * np.cos(phase)
    return np.asarray(angles + np.diff(turned, prepend=0.0))


def _close_on_welder_pose(limits: LimitedProblem, angles: Array) -> bool:
    """Take a shape to the welder's pose by least changes, in place; whether it keeps its limits.

    A search that ends at its last step is still a little off.
    """
    for _ in range(MOST_CLOSING_STEPS):
        off, rows = limits.problem.constraint(angles)
        if np.abs(off).max() < 1e-9:
            return worst_margin(limits.rows(angles)) >= LEAST_KEPT_MARGIN
        angles -= np.linalg.lstsq(rows, off)[0]
    return False


def _distinct_shapes(cable: Cable, shapes: list[Array], centres: list[Array]) -> list[Array]:
    """Shapes that differ from all before them; the first on each side of everything first."""
    sides: dict[tuple[int, ...], list[tuple[Array, Array]]] = {}
    for angles in shapes:
        line = cable.line(angles)
        kept = sides.setdefault(tuple(_count_turns_around(line, centre) for centre in centres), [])
        if len(kept) < MOST_START_SHAPES and all(
            np.hypot(*(line - other).T).mean() > SAME_SHAPE_DISTANCE * cable.length
            for _, other in kept
        ):
            kept.append((angles, line))
    return [angles for each in zip_longest(*sides.values()) for angles, _ in filter(None, each)]


def _count_turns_around(line: Array, centre: Array) -> int:
    """How often a line goes round a place: no cable on a floor gets from one number to another."""
    x, y = (line - centre).T
    sight = np.unwrap(np.arctan2(y, x))
    straight = np.arctan2(y[-1], x[-1]) - np.arctan2(y[0], x[0])
    return round(float(sight[-1] - sight[0] - straight) / (2 * np.pi))


def one_bend_headings(start: Array, end: Array, length: float, least_radius: float) -> Array:
    """Headings along paths from pose to pose through one pose between, off to any side.

    Parameters
    ----------
    start, end : ndarray, shape (3,)
        x, y, metres, and heading, radians.
    length : float
        Of every path, metres.
    least_radius : float
        Of the arcs, metres.

    Returns
    -------
    ndarray, shape (M, 7, 2)
        Of each path its corners: how far along, metres, and the heading there, radians, not
        wrapped. In between it changes evenly.
    """
    turns = 2 * np.pi * np.arange(LEAD_DIRECTIONS) / LEAD_DIRECTIONS
    share, way, heading, radius = _all_combinations(
        BEND_BASE_SHARES, turns, turns, _radii_to_try(least_radius)
    )
    bases = start[:2] + share[..., None] * (end - start)[:2]
    off = np.stack((np.cos(way), np.sin(way)), axis=-1)
    return _paths_of_length(start, end, length, bases, off, heading, radius[:, 0])


def meander_headings(
    start: Array, end: Array, length: float, least_radius: float, bends: int, centres: Array
) -> Array:
    """Headings along paths from pose to pose that go to and fro in lanes.

    Parameters
    ----------
    start, end, length, least_radius
        See `one_bend_headings`.
    bends : int
        From lane to lane, two or more.
    centres : ndarray, shape (C, 2)
        Of meanders, metres.

    Returns
    -------
    ndarray, shape (M, 3 + 3 bends + 1, 2)
        See `one_bend_headings`.
    """
    turns = 2 * np.pi * np.arange(LEAD_DIRECTIONS) / LEAD_DIRECTIONS
    which, axis, first, radius, lane = _all_combinations(
        np.arange(len(centres)),
        turns,
        (-1, 1),
        _radii_to_try(least_radius),
        MEANDER_LANE_WIDTHS_IN_RADII,
    )
    along = np.stack((np.cos(axis), np.sin(axis)), axis=-1)
    across = np.stack((-np.sin(axis), np.cos(axis)), axis=-1)
    place = (np.arange(bends) - (bends - 1) / 2) * lane * radius
    bases = centres[which] + place[..., None] * along
    off = (first * (-1) ** np.arange(bends))[..., None] * across
    heading = np.broadcast_to(axis, place.shape)
    return _paths_of_length(start, end, length, bases, off, heading, radius[:, 0])


def _all_combinations(*values: ArrayLike) -> list[NDArray[Any]]:
    """All combinations of some values, each of shape (M, 1)."""
    return [each.reshape(-1, 1) for each in np.meshgrid(*values, indexing="ij")]


def _radii_to_try(least: float) -> Array:
    return np.asarray(SMALLEST_TRIED_RADIUS_FACTOR * least * 2.0 ** np.arange(TRIED_RADII))


def _paths_of_length(
    start: Array, end: Array, length: float, bases: Array, off: Array, heading: Array, radius: Array
) -> Array:
    """Paths through poses led from `bases` along `off` so far that they have the length.

    Parameters
    ----------
    start, end, length
        See `one_bend_headings`.
    bases, off : ndarray, shape (M, K, 2)
    heading : ndarray, shape (M, K)
    radius : ndarray, shape (M,)
    """

    def paths(which: NDArray[np.intp], far: Array) -> Array:
        places = bases[which] + far[:, None, None] * off[which]
        between = np.concatenate((places, heading[which, :, None]), axis=-1)
        return _path_through(start, between, end, radius[which])

    everyone = np.arange(len(bases))
    fars = np.linspace(0.0, 0.5 * length, TRIED_OFFSETS)
    longer = np.stack(
        [paths(everyone, np.full(len(bases), far))[:, -1, 0] > length for far in fars]
    )
    step, which = np.nonzero(longer[1:] != longer[:-1])
    low, high, rises = fars[step], fars[step + 1], longer[step + 1, which]
    for _ in range(OFFSET_HALVINGS):
        middle = 0.5 * (low + high)
        above = (paths(which, middle)[:, -1, 0] > length) == rises
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    made = paths(which, low)
    # Where shortest paths change sides their length jumps: past it, nothing was met.
    return made[np.abs(made[:, -1, 0] - length) < LENGTH_TOLERANCE * length]


def _path_through(start: Array, between: Array, end: Array, radius: Array) -> Array:
    """Corners of paths through poses between, shape (M, K, 3), with arcs of radii, shape (M,)."""
    last = np.broadcast_to(start, (len(between), 3))
    whole = np.zeros((len(between), 1, 2))
    whole[:, 0, 1] = start[2]
    for pose in (*between.swapaxes(0, 1), np.broadcast_to(end, last.shape)):
        piece = _shortest_path(last, pose, radius)
        piece = piece[:, 1:] - piece[:, :1] + whole[:, -1:]
        whole, last = np.concatenate((whole, piece), axis=1), pose
    return whole


def _shortest_path(start: Array, end: Array, radius: Array) -> Array:
    """Corners of shortest paths of arc, straight piece, arc, shape (M, 4, 2)."""
    begin = start[:, 2]
    best = np.full((len(radius), 4, 2), np.inf)
    for first, last in TURN_SIDES:
        a = _circle_centre(start, first * radius)
        b = _circle_centre(end, last * radius)
        dx, dy = (b - a).T
        apart, ahead = np.hypot(dx, dy), np.arctan2(dy, dx)
        # Straight pieces between circles turned in opposite ways cross the line of their centres.
        share = np.divide(
            (first - last) * radius, apart, out=np.full(len(apart), 2.0), where=apart > 1e-12
        )
        possible = np.abs(share) <= 1.0 if first != last else np.ones(len(apart), bool)
        share = np.where(possible, share, 0.0) if first != last else np.zeros(len(apart))
        heading = ahead + np.arcsin(share)
        turn = (first * (heading - begin)) % (2 * np.pi)
        back = (last * (end[:, 2] - heading)) % (2 * np.pi)
        straight = apart * np.sqrt(1 - share**2)
        along = np.cumsum((np.zeros(len(apart)), radius * turn, straight, radius * back), axis=0)
        on = begin + first * turn
        headings = np.stack((begin, on, on, on + last * back))
        shorter = possible & (along[-1] < best[:, -1, 0])
        best[shorter] = np.stack((along, headings), axis=-1).swapaxes(0, 1)[shorter]
    return best


def _circle_centre(pose: Array, radius: Array) -> Array:
    """Of a circle to the left, for a radius above 0, of a pose."""
    x, y, heading = pose.T
    return np.stack((x - radius * np.sin(heading), y + radius * np.cos(heading)), axis=-1)
