"""The shape where a limit is near: sequential quadratic programs, solved by ProxQP.

A slack that is punished exactly keeps every program soluble. What of it remains at the end is how
far the limits can't be kept: such a shape is never sent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import proxsuite

from tjscan.core.frames import Array
from tjscan.towing.shape.chain import chain_gradient, chain_hessian, place_links, pose_constraints
from tjscan.towing.shape.compiled import Indices, compiled
from tjscan.towing.shape.limits import COLUMNS, SPARE, HardLimits, limit_gradients, limit_rows
from tjscan.towing.shape.linear import (
    add_squares,
    constrained_step,
    factorise_convex,
    largest_diagonal,
    least_squares_multipliers,
)
from tjscan.towing.shape.problem import ShapeProblem, shape_terms
from tjscan.towing.shape.pull_rows import add_curvature, force_after, put_force

BAND: Final = 0.05
"""Metres of margin below which a limit stands in the program: some steps of a slow vehicle."""

LONGEST: Final = 0.2
"""Radians that a joint turns at most in one step."""

SLACK: Final = 1e3
"""What a metre of slack costs; the objective is 100 at worst and changes by some tens a metre."""

SOLVED: Final = proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED


OUTER: Final = 100
"""Iterations of ProxQP; 10 to 50 are usual. One without a solution would take it minutes."""

INNER: Final = 20
"""Its steps in each of them; one or two are usual."""

MOST_ACTIVE: Final = 20
"""Rows that may be active in a guess; beyond, ProxQP looks for them."""


@dataclass(frozen=True, slots=True, eq=False)
class LimitedShape:
    """Where the search ended.

    Parameters
    ----------
    angles : ndarray, shape (N,)
    iterations : int
    constraint : float
        Largest of what fixed links are off by.
    pressed : ndarray, shape (R, 10)
        Rows of limits that hold the shape where it is, see `limits.COLUMNS`.
    """

    angles: Array
    iterations: int
    constraint: float
    pressed: Array


class _Look:
    """All that is known at a shape: objective, constraints, rows of limits that are near."""

    def __init__(self, problem: ShapeProblem, limits: HardLimits) -> None:
        n, m = problem.cable.links, 3 * len(problem.fixed)
        self.of_problem, self.of_limits = problem.arguments, limits.arguments
        self.angles, self.links, self.terms = np.empty(n), np.empty((n, 5)), np.empty(5)
        self.joint, self.point = np.empty((n, 2)), np.empty((n, 5))
        self.c, self.jacobian = np.zeros(m), np.zeros((m, n))
        self.all_rows = np.empty((128, COLUMNS))
        self.f, self.off, self.worst, self.used = 0.0, 0.0, 0.0, 0

    def at(self, angles: Array, band: float) -> None:
        """Look at other angles."""
        self.angles[:] = angles
        while True:
            self.f, self.off, self.worst, self.used = _assess(
                self.angles, self.links, self.terms, self.joint, self.point, self.c,
                self.jacobian, self.all_rows, band, self.of_problem, self.of_limits,
            )  # fmt: skip
            if self.used <= len(self.all_rows):
                return
            self.all_rows = np.empty((2 * self.used, COLUMNS))

    @property
    def rows(self) -> Array:
        """Rows of limits that are near, shape (R, 10)."""
        return self.all_rows[: self.used]


@compiled
def _assess(
    angles: Array, links: Array, terms: Array, joint: Array, point: Array, c: Array,
    jacobian: Array, rows: Array, band: float, of_problem: Any, of_limits: Any,
) -> tuple[float, float, float, int]:  # fmt: skip
    """Fill all that `_Look` holds; objective, constraints' sum, worst limit, number of rows."""
    (
        estimate, root, length, scale, targets, moved, costs,
        walls, corners, starts, discs, fixed, poses,
    ) = of_problem  # fmt: skip
    place_links(angles, root, length, links)
    f = shape_terms(
        angles, estimate, links, scale, targets, moved, costs,
        walls, corners, starts, discs, terms, joint, point,
    )  # fmt: skip
    pose_constraints(links, root, fixed, poses, c, jacobian)
    used = limit_rows(angles, links, band, rows, *of_limits)
    worst = 0.0
    for r in range(min(used, len(rows))):
        worst = max(worst, -rows[r, 0])
    return f, np.abs(c).sum(), worst, used


@compiled
def _model(
    links: Array, joint: Array, point: Array, jacobian: Array, rows: Array, fixed: Indices,
    root: Array, length: float, moved: Indices, costs: Array, force: Array,
    y: Array, z: Array, shift: float,
    gradient: Array, hessian: Array, factor: Array, gradients: Array,
) -> float:  # fmt: skip
    """Gradient, convex Hessian of the Lagrangian, its factor and shift; derivatives of rows."""
    n = len(joint)
    turn = np.zeros((n, 2))
    chain_gradient(joint, point, turn, links, length, gradient[:n])
    if len(z) == 0:
        least_squares_multipliers(jacobian, gradient[:n], y)
    for e in range(len(fixed)):
        point[fixed[e], 0] += y[3 * e]
        point[fixed[e], 1] += y[3 * e + 1]
    if len(z) == len(rows):
        for r in range(len(rows)):
            if z[r] != 0.0 and rows[r, 9] != 6.0:
                i, j = int(rows[r, 3]), int(rows[r, 6])
                if i >= 0:
                    point[i, 0] += z[r] * rows[r, 1]
                    point[i, 1] += z[r] * rows[r, 2]
                if j >= 0:
                    point[j, 0] -= z[r] * rows[r, 1]
                    point[j, 1] -= z[r] * rows[r, 2]
    put_force(moved, costs, links, force, point)
    square = np.empty((n, n))
    chain_hessian(joint, point, turn, links, length, square)
    add_squares(jacobian, square)
    least = 1e-4 * largest_diagonal(square)
    add_curvature(moved, costs, links, root, square)
    shift = factorise_convex(square, shift, factor, least)
    for i in range(n):
        for j in range(i):
            hessian[i, j] = square[i, j]
            hessian[j, i] = square[i, j]
        hessian[i, i] = square[i, i] + shift
    limit_gradients(rows, root, links, gradients)
    return shift


@compiled
def _guess_active(
    factor: Array, jacobian: Array, c: Array, C: Array, rows: Array, gradient: Array,
    step: Array, y: Array, z: Array,
) -> bool:  # fmt: skip
    """Solve a program by adding the worst row and dropping those that pull; True if that ends.

    What it then found meets all conditions of the program's solution, with no slack.
    """
    n, m = len(step), len(c)
    active = np.zeros(len(rows), np.bool_)
    for _ in range(MOST_ACTIVE):
        count = m + active.sum()
        A, b, multipliers = np.empty((count, n)), np.empty(count), np.empty(count)
        A[:m], b[:m], k = jacobian, c, m
        for r in range(len(rows)):
            if active[r]:
                A[k], b[k] = C[r, :n], rows[r, 0]
                k += 1
        constrained_step(factor, A, gradient[:n], b, step, multipliers)
        worst, which, k, settled = -1e-9, -1, m, True
        for r in range(len(rows)):
            z[r] = 0.0
            if active[r]:
                z[r] = multipliers[k]
                k += 1
                if z[r] > 1e-9:
                    active[r], settled = False, False
            margin = rows[r, 0] + (C[r, :n] * step).sum()
            if margin < worst:
                worst, which = margin, r
        if settled and which < 0:
            y[:] = multipliers[:m]
            return bool(np.abs(z).sum() < SLACK)
        if which >= 0:
            if active[which]:
                return False
            active[which] = True
    return False


def optimise_limited(
    problem: ShapeProblem, limits: HardLimits, start: Array, *, most: int = 40
) -> LimitedShape:
    """Best shape near `start` that keeps all limits.

    Parameters
    ----------
    problem : ShapeProblem
    limits : HardLimits
    start : ndarray, shape (N,)
        Angles, radians.
    most : int
        Programs.

    Notes
    -----
    The search ends where a step promises less than 1e-7 of the objective, or where none gains.
    """
    n, bound = len(start), problem.cable.joint_limit - SPARE
    now, after = _Look(problem, limits), _Look(problem, limits)
    now.at(np.clip(start, -bound, bound), BAND)
    y, z = np.zeros(len(now.c)), np.zeros(0)
    fix, shift, band, iteration = 1.0, 0.0, BAND, 0
    gradient, hessian = np.full(n + 1, SLACK), np.zeros((n + 1, n + 1))
    hessian[n, n] = 1.0
    factor, force = np.zeros((n, n)), np.zeros(2)
    root, (moved, costs) = problem.root, problem.costs
    while iteration < most:
        iteration += 1
        rows = now.rows
        C = np.ones((len(rows), n + 1))
        shift = _model(
            now.links, now.joint, now.point, now.jacobian, rows, problem.fixed,
            root, problem.cable.link_length, moved, costs, force, y, z, shift,
            gradient, hessian, factor, C,
        )  # fmt: skip
        step, z, left, reach = np.empty(n), np.empty(len(rows)), 0.0, 1.0
        if not _guess_active(factor, now.jacobian, now.c, C, rows, gradient, step, y, z):
            step, left, y, z, reach = _solve_program(gradient, hessian, now, C)
        if reach == 0.0:
            break
        force_after(moved, costs, now.links, root, step, force)
        fix = max(fix, 2 * float(np.abs(y).max(initial=0.0)))
        slope = float(gradient[:n] @ step) - fix * reach * now.off
        slope -= SLACK * max(now.worst - left, 0.0)
        merit = now.f + fix * now.off + SLACK * now.worst
        share, better = min(1.0, LONGEST / max(float(np.abs(step).max()), 1e-300)), False
        for _ in range(12):
            after.at(now.angles + share * step, band)
            reached = after.f + fix * after.off + SLACK * after.worst
            if reached <= merit + 1e-4 * share * slope + 1e-10 * abs(merit):
                better = True
                break
            share *= 0.5
        if not better:
            if len(z) == 0 or band > BAND:
                break
            band *= 3.0  # a limit out of the program may stand in the way
            now.at(now.angles.copy(), band)
            z = np.zeros(0)
            continue
        now, after = after, now
        if -slope < 1e-7 * max(1.0, abs(now.f)) and np.abs(now.c).max() < 1e-7:
            break
    rows = now.rows
    pressed = rows[(rows[:, 0] < 1e-5) & (np.abs(z) > 1e-6)] if len(z) == len(rows) else rows[:0]
    return LimitedShape(now.angles, iteration, float(np.abs(now.c).max()), pressed)


def _solve_program(
    gradient: Array, hessian: Array, now: _Look, C: Array
) -> tuple[Array, float, Array, Array, float]:
    """Step, slack left, multipliers of constraints and rows, and the share of c that is met.

    Joints at their limits may not let the whole of the constraints be met in one step.
    """
    n, m = len(gradient) - 1, len(now.c)
    A = np.zeros((m, n + 1))
    A[:, :n] = now.jacobian
    rows = np.zeros((len(C) + 1, n + 1))
    rows[:-1] = C
    rows[-1, n] = 1.0
    low, high = np.append(-now.rows[:, 0], 0.0), np.full(len(rows), 1e20)
    reach = 1.0
    while reach > 1e-3:
        qp = proxsuite.proxqp.dense.QP(n + 1, m, len(rows))
        qp.settings.eps_abs = 1e-8
        qp.init(hessian, gradient, A, -reach * now.c, rows, low, high)
        qp.settings.max_iter, qp.settings.max_iter_in = OUTER, INNER
        qp.solve()
        found = qp.results
        if found.info.status == SOLVED:
            return found.x[:n], max(float(found.x[n]), 0.0), found.y, found.z[:-1], reach
        reach *= 0.25
    return np.zeros(n), now.worst, np.zeros(m), np.zeros(0), 0.0
