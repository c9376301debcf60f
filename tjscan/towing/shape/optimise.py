"""Newton's method for the shape, as long as no limit is near.

The cost of the pull at the welder is a thousand times as stiff as all other terms, for the place of
one link. Its gradient at the beginning of a search would bend the Hessian so much that only tiny
steps were convex; but it vanishes with the first step, all but the force with which the other terms
hold against it. So that force takes its place, as a multiplier does that of a constraint, and the
curvature is added as rows squared.
"""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.chain import chain_gradient, chain_hessian, turned_way
from tjscan.towing.shape.compiled import Indices, compiled, inlined
from tjscan.towing.shape.linear import (
    add_squares,
    constrained_step,
    factorise_convex,
    largest_diagonal,
    least_squares_multipliers,
)
from tjscan.towing.shape.problem import ShapeArrays, ShapeState, evaluate_shape, make_state
from tjscan.towing.shape.pull import PULL_TERM

LONGEST_TURN = 0.5
"""Radians that a joint turns at most in one step."""


@inlined
def add_multipliers(problem: ShapeArrays, y: Array, point: Array) -> None:
    """Add the forces of the constraints' multipliers, shape (3 E,), to those of the links."""
    fixed = problem.fixed
    for e in range(len(fixed)):
        point[fixed[e], 0] += y[3 * e]
        point[fixed[e], 1] += y[3 * e + 1]


@compiled
def replace_pull(moved: Indices, costs: Array, links: Array, force: Array, point: Array) -> None:
    """Put a force, shape (2,), for the pull's share in what the links contribute."""
    for m in range(len(moved)):
        if costs[m, 0] == PULL_TERM:
            k = moved[m]
            x, y = links[k, 0] - costs[m, 1], links[k, 1] - costs[m, 2]
            point[k, 0] += force[0] - costs[m, 4] - costs[m, 6] * x - costs[m, 7] * y
            point[k, 1] += force[1] - costs[m, 5] - costs[m, 7] * x - costs[m, 8] * y
            for c in range(2, 5):
                point[k, c] -= costs[m, c + 4]


@compiled
def add_pull_curvature(
    moved: Indices, costs: Array, links: Array, root: Array, matrix: Array
) -> None:
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
def pull_after(
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


@inlined
def convex_hessian(
    problem: ShapeArrays,
    state: ShapeState,
    force: Array,
    shift: float,
    hessian: Array,
    factor: Array,
) -> tuple[float, float]:
    """Hessian of the Lagrangian and its factor, made convex; the shift and the rows' weight.

    Parameters
    ----------
    problem : ShapeArrays
    state : ShapeState
        Its parts hold the forces of all multipliers.
    force : ndarray, shape (2,)
        Of the pull, see `replace_pull`.
    shift : float
        Of the diagonal, in the step before.
    hessian, factor : ndarray, shape (N, N)
        Filled: lower triangles.
    """
    links, moved, costs = state.links, problem.moved, problem.costs
    replace_pull(moved, costs, links, force, state.parts.point)
    chain_hessian(state.parts, links, problem.length, hessian)
    weight = add_squares(state.jacobian, hessian)
    least = 1e-4 * largest_diagonal(hessian)
    add_pull_curvature(moved, costs, links, problem.root, hessian)
    return factorise_convex(hessian, shift, factor, least), weight


@compiled
def newton_shape(angles: Array, most: int, tolerance: float, problem: ShapeArrays) -> int:
    """Minimise the objective with poses of links for constraints and no limits, in place.

    Newton steps of the Lagrangian with its exact Hessian, made convex if it is not, and a line
    search on the objective with an exact penalty; a second-order correction saves full steps.

    Parameters
    ----------
    angles : ndarray, shape (N,)
        Start of the search; then the result.
    most : int
        Iterations.
    tolerance : float
        Largest entry of the Lagrangian's gradient at which the search ends. It ends too when a
        step promises to gain less than 1e-6 of the objective.
    problem : ShapeArrays

    Returns
    -------
    int
        Iterations.
    """
    n, m = len(angles), 3 * len(problem.fixed)
    state, after = make_state(n, len(problem.fixed)), make_state(n, len(problem.fixed))
    gradient, step, trial, second = np.empty(n), np.empty(n), np.empty(n), np.zeros(n)
    hessian, factor = np.empty((n, n)), np.zeros((n, n))
    y, force = np.zeros(m), np.zeros(2)
    penalty, shift, iteration, done = 0.0, 0.0, 0, False
    f = evaluate_shape(angles, problem, state)
    while True:
        chain_gradient(state.parts, state.links, problem.length, gradient)
        residual = least_squares_multipliers(state.jacobian, gradient, y)
        violation = np.abs(state.constraint).max() if m > 0 else 0.0
        if done or iteration >= most or (residual < tolerance and violation < 1e-9):
            break
        iteration += 1
        add_multipliers(problem, y, state.parts.point)
        shift, weight = convex_hessian(problem, state, force, shift, hessian, factor)
        constrained_step(factor, state.jacobian, gradient, state.constraint, step, y)
        pull_after(problem.moved, problem.costs, state.links, problem.root, step, force)
        off = np.abs(state.constraint).sum()
        if m > 0:
            penalty = max(penalty, 2.0 * np.abs(y - weight * state.constraint).max())
        slope = gradient @ step - penalty * off
        share = min(1.0, LONGEST_TURN / max(np.abs(step).max(), 1e-300))
        merit, corrected, better = f + penalty * off, False, False
        for _ in range(30):
            for i in range(n):
                trial[i] = angles[i] + share * step[i] + (second[i] if corrected else 0.0)
            f = evaluate_shape(trial, problem, after)
            reached = f + penalty * np.abs(after.constraint).sum()
            if reached <= merit + 1e-4 * share * slope + 1e-12 * abs(merit):
                better = True
                break
            if share == 1.0 and not corrected and m > 0:
                corrected = True
                constrained_step(factor, state.jacobian, np.zeros(n), after.constraint, second, y)
                continue
            corrected = False
            share *= 0.5
        if not better:
            break
        angles[:] = trial
        state, after = after, state
        settled = m == 0 or np.abs(state.constraint).max() < 1e-8
        done = -slope < 1e-6 * max(1.0, abs(f)) and settled
    return iteration
