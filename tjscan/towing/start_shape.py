"""Where a tow may begin: best shapes of many searches, on either side of every pillar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.area import Area, Obstacles
from tjscan.towing.cable import Cable
from tjscan.towing.distance import obstacle_distances
from tjscan.towing.estimate import MOST, newton_estimate
from tjscan.towing.limited import optimise_limited
from tjscan.towing.limits import KEPT, HardLimits
from tjscan.towing.optimise import newton_shape
from tjscan.towing.shape_problem import ShapeProblem

GRID: Final = 5
"""Places along either side of the area through which a search's first shape leads."""

ALIKE: Final = 0.05
"""Metres of mean distance between links, within which two shapes are the same."""


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
    found: list[StartShape] = []
    for guess in first_shapes(problem.cable, area, welder_pose):
        angles = guess.copy()
        iterations, _, off = newton_shape(angles, 10 * MOST, 1e-4, *problem.arguments)
        if off > 1e-6 or limits.rows(angles)[:, 0].min(initial=0.0) < KEPT:
            shape = optimise_limited(problem, limits, guess, most=5 * MOST)
            angles, off = shape.angles, shape.constraint
            iterations += shape.iterations
            if off > 1e-6 or limits.rows(angles)[:, 0].min(initial=0.0) < KEPT:
                continue
        found.append(StartShape(angles, problem.terms(angles).total, iterations))
    found.sort(key=lambda shape: shape.f)
    return _distinct(problem.cable, found)


def first_shapes(cable: Cable, area: Area, welder_pose: Array) -> list[Array]:
    """Shapes of least energy from root to welder, led over places all over the area."""
    free = Obstacles.of_area(area)
    low, high = area.outline.min(axis=0), area.outline.max(axis=0)
    share = (np.arange(GRID) + 0.5) / GRID
    places = np.stack(np.meshgrid(*(low + (high - low) * share[:, None]).T), -1).reshape(-1, 2)
    places = places[obstacle_distances(places, *free.arrays)[0].min(axis=1) > 0]
    root = np.array(cable.root, dtype=float)
    shapes: list[Array] = []
    for place in places:
        from_root, to_welder = (np.hypot(*(place - end[:2])) for end in (root, welder_pose))
        if from_root + to_welder > cable.length:
            continue
        there = round(cable.links * from_root / (from_root + to_welder))
        held = np.array((min(max(there, 1), cable.links - 2), cable.links - 1), dtype=np.int64)
        poses = np.array(((*place, 0.0), welder_pose))
        for bend in (-1.0, 1.0):
            angles = np.full(cable.links, bend * 0.5 * np.pi / cable.links)
            newton_estimate(
                angles,
                root,
                cable.link_length,
                held,
                poses,
                STIFF,
                np.zeros((cable.links, 2)),
                np.zeros(cable.links),
                10 * MOST,
            )
            if all(np.abs(angles - other).max() > 0.1 for other in shapes):
                shapes.append(angles)
    return shapes


STIFF: Final = np.array(((1e2, 0.0), (1e6, 1e6)))
"""The place may give way, the tip may not; the heading at the place is free."""


def _distinct(cable: Cable, shapes: list[StartShape]) -> list[StartShape]:
    kept: list[StartShape] = []
    for shape in shapes:
        lies = cable.poses(shape.angles)[:, :2]
        apart = (np.hypot(*(cable.poses(k.angles)[:, :2] - lies).T).mean() for k in kept)
        if all(distance > ALIKE for distance in apart):
            kept.append(shape)
    return kept
