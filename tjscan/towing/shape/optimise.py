"""Newton's method for the shape, as long as no limit is near."""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.chain import (
    chain_gradient,
    chain_hessian,
    place_links,
    pose_constraints,
)
from tjscan.towing.shape.compiled import Indices, compiled
from tjscan.towing.shape.linear import (
    add_squares,
    constrained_step,
    factorise_convex,
    largest_diagonal,
    least_squares_multipliers,
)
from tjscan.towing.shape.problem import shape_terms
from tjscan.towing.shape.pull_rows import add_curvature, force_after, put_force

LONGEST = 0.5
"""Radians that a joint turns at most in one step."""


@compiled
def newton_shape(
    angles: Array,
    most: int,
    tolerance: float,
    estimate: Array,
    root: Array,
    length: float,
    scale: Array,
    targets: Array,
    moved: Indices,
    costs: Array,
    walls: Array,
    corners: Array,
    starts: Indices,
    discs: Array,
    fixed: Indices,
    poses: Array,
) -> tuple[int, float, float]:
    """Minimise the objective with poses of links for constraints and no limits, in place.

    Newton steps of the Lagrangian with its exact Hessian, made convex where it must be, and a line
    search on the objective with an exact penalty; a second-order correction saves full steps.

    Parameters
    ----------
    angles : ndarray, shape (N,)
        Where to begin; then the result.
    most : int
        Iterations.
    tolerance : float
        Largest entry of the Lagrangian's gradient at which the search ends. It ends too where a
        step promises to gain less than 1e-6 of the objective.

    Returns
    -------
    iterations : int
    residual : float
        Largest entry of the Lagrangian's gradient.
    violation : float
        Largest of what the constraints are off by.

    See Also
    --------
    shape_terms, pose_constraints : for the others.
    """
    n, m = len(angles), 3 * len(fixed)
    links, terms = np.empty((n, 5)), np.empty(5)
    joint, point, turn = np.empty((n, 2)), np.empty((n, 5)), np.zeros((n, 2))
    gradient, step, trial, second = np.empty(n), np.empty(n), np.empty(n), np.zeros(n)
    hessian, factor, rows = np.empty((n, n)), np.zeros((n, n)), np.zeros((m, n))
    c, after_c, y = np.zeros(m), np.zeros(m), np.zeros(m)
    after_rows, force = np.zeros((m, n)), np.zeros(2)
    penalty, shift, residual, violation, iteration, done = 0.0, 0.0, 0.0, 0.0, 0, False
    place_links(angles, root, length, links)
    f = shape_terms(
        angles, estimate, links, scale, targets, moved, costs,
        walls, corners, starts, discs, terms, joint, point,
    )  # fmt: skip
    pose_constraints(links, root, fixed, poses, c, rows)
    while True:
        chain_gradient(joint, point, turn, links, length, gradient)
        residual = least_squares_multipliers(rows, gradient, y)
        violation = np.abs(c).max() if m > 0 else 0.0
        if done or iteration >= most or (residual < tolerance and violation < 1e-9):
            break
        iteration += 1
        for e in range(len(fixed)):
            point[fixed[e], 0] += y[3 * e]
            point[fixed[e], 1] += y[3 * e + 1]
        put_force(moved, costs, links, force, point)
        chain_hessian(joint, point, turn, links, length, hessian)
        weight = add_squares(rows, hessian)
        least = 1e-4 * largest_diagonal(hessian)
        add_curvature(moved, costs, links, root, hessian)
        shift = factorise_convex(hessian, shift, factor, least)
        constrained_step(factor, rows, gradient, c, step, y)
        force_after(moved, costs, links, root, step, force)
        off = np.abs(c).sum()
        if m > 0:
            penalty = max(penalty, 2.0 * np.abs(y - weight * c).max())
        slope = gradient @ step - penalty * off
        share = min(1.0, LONGEST / max(np.abs(step).max(), 1e-300))
        merit, corrected, better = f + penalty * off, False, False
        for _ in range(30):
            for i in range(n):
                trial[i] = angles[i] + share * step[i] + (second[i] if corrected else 0.0)
            place_links(trial, root, length, links)
            f = shape_terms(
                trial, estimate, links, scale, targets, moved, costs,
                walls, corners, starts, discs, terms, joint, point,
            )  # fmt: skip
            pose_constraints(links, root, fixed, poses, after_c, after_rows)
            reached = f + penalty * np.abs(after_c).sum()
            if reached <= merit + 1e-4 * share * slope + 1e-12 * abs(merit):
                better = True
                break
            if share == 1.0 and not corrected and m > 0:
                corrected = True
                constrained_step(factor, rows, np.zeros(n), after_c, second, y)
                continue
            corrected = False
            share *= 0.5
        if not better:
            break
        angles[:] = trial
        c[:] = after_c
        rows[:] = after_rows
        done = -slope < 1e-6 * max(1.0, abs(f)) and (m == 0 or np.abs(c).max() < 1e-8)
    return iteration, residual, violation
