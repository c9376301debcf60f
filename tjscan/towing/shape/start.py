"""Where a tow may begin: best shapes of many searches, on either side of every pillar."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.arcs import bent_once, meanders
from tjscan.towing.shape.area import Area
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.limited import SLACK_COST, optimise_limited
from tjscan.towing.shape.limits import KEPT_MARGIN, HardLimits
from tjscan.towing.shape.optimise import newton_shape
from tjscan.towing.shape.problem import ShapeProblem

MOST_SEARCHES: Final = 12
"""First shapes from which the best one is looked for, of the many that are made."""

MOST_BENDS: Final = 4
"""Of a meander at most, tried where shapes with fewer end nowhere."""

SAME_SHAPE: Final = 0.01
"""Share of the cable's length that links of two shapes are apart in the mean, below which they are
the same."""

NEWTON_STEPS: Final = 150
"""Of a search, at most."""

CLOSING_STEPS: Final = 10
"""Steps that bring a shape to the welder's pose; three or four are usual."""

MOST_PROGRAMS: Final = 60
"""Of a search for a shape that a limit is in the way of, at most."""


@dataclass(frozen=True, slots=True, eq=False)
class StartShape:
    """A shape that a search ended with.

    Parameters
    ----------
    angles : ndarray, shape (N,)
        Radians.
    f : float
        The objective there.
    iterations : int
    """

    angles: Array
    f: float
    iterations: int


def start_shapes(
    problem: ShapeProblem, limits: HardLimits, area: Area, welder_pose: Array
) -> list[StartShape]:
    """Shapes that keep all limits, best first; none if there is none.

    Parameters
    ----------
    problem : ShapeProblem
        With no weight of change and pace: there is nothing to stay near to.
    limits : HardLimits
    area : Area
    welder_pose : ndarray, shape (3,)
    """
    for shapes in first_shapes(problem.cable, area, welder_pose):
        found = _search(problem, limits, area, shapes)
        if found:
            return found
    return []


def first_shapes(cable: Cable, area: Area, welder_pose: Array) -> Iterator[list[Array]]:
    """Shapes of arcs and straight pieces from root to welder: bent once, then in more lanes."""
    root, middles = np.array(cable.root), (np.arange(cable.links) + 0.5) * cable.link_length
    given = root, welder_pose, cable.length, cable.least_bend_radius
    low, high = area.outline.min(axis=0), area.outline.max(axis=0)
    share = np.array((0.25, 0.5, 0.75))
    centres = np.stack(np.meshgrid(*(low + (high - low) * share[:, None]).T), -1).reshape(-1, 2)
    for bends in range(1, 1 + MOST_BENDS):
        paths = bent_once(*given) if bends == 1 else meanders(*given, bends, centres)
        headings = (np.interp(middles, path[:, 0], path[:, 1]) for path in paths)
        yield [cable.angles(along) for along in headings]


def _search(
    problem: ShapeProblem, limits: HardLimits, area: Area, shapes: list[Array]
) -> list[StartShape]:
    """What searches from the most promising of some shapes end with."""
    cable = problem.cable
    costs = [
        problem.terms(angles).total - SLACK_COST * _margin(limits, angles) for angles in shapes
    ]
    ranked = [shapes[k] for k in np.argsort(costs, kind="stable")]
    centres = [
        *(pillar.mean(axis=0) for pillar in area.pillars),
        *(disc[:2] for disc in limits.obstacles.discs),
    ]
    found: list[StartShape] = []
    for guess in _distinct(cable, ranked, centres)[:MOST_SEARCHES]:
        angles = guess.copy()
        iterations = newton_shape(angles, NEWTON_STEPS, 1e-4, problem.arrays)
        if not _close(problem, angles) or _margin(limits, angles) < KEPT_MARGIN:
            shape = optimise_limited(problem, limits, guess, most=MOST_PROGRAMS)
            angles = shape.angles.copy()
            iterations += shape.iterations
            if not _close(problem, angles) or _margin(limits, angles) < KEPT_MARGIN:
                continue
        found.append(StartShape(angles, problem.terms(angles).total, iterations))
    found.sort(key=lambda shape: shape.f)
    kept = _distinct(cable, [shape.angles for shape in found], centres)
    return [shape for shape in found if any(shape.angles is angles for angles in kept)]


def _close(problem: ShapeProblem, angles: Array) -> bool:
    """Take a shape to the welder's pose by least changes, in place; whether it gets there.

    A search that ends at its last step is still a little off.
    """
    for _ in range(CLOSING_STEPS):
        off, rows = problem.constraint(angles)
        if np.abs(off).max() < 1e-9:
            return True
        angles -= np.linalg.lstsq(rows, off)[0]
    return False


def _margin(limits: HardLimits, angles: Array) -> float:
    """Of the limit that is broken worst; 0 if none is."""
    return float(limits.rows(angles)["margin"].min(initial=0.0))


def _distinct(cable: Cable, shapes: list[Array], centres: list[Array]) -> list[Array]:
    """Shapes of which none lies like one before it; the first on each side of everything first."""
    sides: dict[tuple[int, ...], list[tuple[Array, Array]]] = {}
    for angles in shapes:
        line = cable.line(angles)
        kept = sides.setdefault(tuple(_turns(line, centre) for centre in centres), [])
        if len(kept) < MOST_SEARCHES and all(
            np.hypot(*(line - other).T).mean() > SAME_SHAPE * cable.length for _, other in kept
        ):
            kept.append((angles, line))
    return [angles for each in zip_longest(*sides.values()) for angles, _ in filter(None, each)]


def _turns(line: Array, centre: Array) -> int:
    """How often a line goes round a place: no cable on a floor gets from one number to another."""
    x, y = (line - centre).T
    sight = np.unwrap(np.arctan2(y, x))
    straight = np.arctan2(y[-1], x[-1]) - np.arctan2(y[0], x[0])
    return round(float(sight[-1] - sight[0] - straight) / (2 * np.pi))
