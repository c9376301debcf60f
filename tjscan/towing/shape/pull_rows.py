"""The cost of the pull at the welder in Newton's method: its curvature kept apart.

It is a thousand times as stiff as all others, for a place of one link. Its gradient, where a search
begins, would bend the Hessian so much that only tiny steps were convex; but it vanishes with the
first step, all but the force with which the other terms hold against it. So that force takes its
place, as a multiplier does that of a constraint, and the curvature is added as rows squared.
"""

from __future__ import annotations

from tjscan.core.frames import Array
from tjscan.towing.shape.chain import turned_way
from tjscan.towing.shape.compiled import Indices, compiled
from tjscan.towing.shape.pull import PULL_TERM


@compiled
def put_force(moved: Indices, costs: Array, links: Array, force: Array, point: Array) -> None:
    """Put a force, shape (2,), for the pull's share in what the links contribute.

    See Also
    --------
    shape_problem.shape_terms : for moved, costs and point.
    """
    for m in range(len(moved)):
        if costs[m, 0] == PULL_TERM:
            k = moved[m]
            x, y = links[k, 0] - costs[m, 1], links[k, 1] - costs[m, 2]
            point[k, 0] += force[0] - costs[m, 4] - costs[m, 6] * x - costs[m, 7] * y
            point[k, 1] += force[1] - costs[m, 5] - costs[m, 7] * x - costs[m, 8] * y
            for c in range(2, 5):
                point[k, c] -= costs[m, c + 4]


@compiled
def add_curvature(moved: Indices, costs: Array, links: Array, root: Array, matrix: Array) -> None:
    """Add the pull's curvature to a Hessian's lower triangle."""
    for m in range(len(moved)):
        if costs[m, 0] == PULL_TERM:
            for i in range(moved[m] + 1):
                x, y = turned_way(i, moved[m], links, root)
                by_x = costs[m, 6] * x + costs[m, 7] * y
                by_y = costs[m, 7] * x + costs[m, 8] * y
                for j in range(i + 1):
                    x, y = turned_way(j, moved[m], links, root)
                    matrix[i, j] += by_x * x + by_y * y


@compiled
def force_after(
    moved: Indices, costs: Array, links: Array, root: Array, step: Array, force: Array
) -> None:
    """The pull's gradient by its link's place after a step of the angles, shape (2,), filled."""
    for m in range(len(moved)):
        if costs[m, 0] == PULL_TERM:
            k = moved[m]
            x, y = links[k, 0] - costs[m, 1], links[k, 1] - costs[m, 2]
            for i in range(k + 1):
                way = turned_way(i, k, links, root)
                x += way[0] * step[i]
                y += way[1] * step[i]
            force[0] = costs[m, 4] + costs[m, 6] * x + costs[m, 7] * y
            force[1] = costs[m, 5] + costs[m, 7] * x + costs[m, 8] * y
