"""The shape where a limit is near: sequential quadratic programs, solved by ProxQP.

A slack that is punished exactly keeps every program soluble. What of it remains at the end is how
far the limits can't be kept: such a shape is never sent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import proxsuite

from tjscan.core.frames import Array
from tjscan.towing.shape.chain import chain_gradient
from tjscan.towing.shape.compiled import compiled, plain_tuple
from tjscan.towing.shape.limits import (
    ROW_TYPE,
    SPARE_MARGIN,
    HardLimits,
    LimitArrays,
    LimitKind,
    LimitRows,
    limit_gradients,
    limit_rows,
    name_limits,
)
from tjscan.towing.shape.linear import constrained_step, least_squares_multipliers
from tjscan.towing.shape.optimise import add_multipliers, convex_hessian, pull_after
from tjscan.towing.shape.problem import (
    ShapeArrays,
    ShapeProblem,
    evaluate_shape,
    name_problem,
    name_state,
    new_state,
)

NEAR_BAND: Final = 0.05
"""Metres of margin below which a limit is in the program: some steps of a slow vehicle."""

LONGEST_TURN: Final = 0.2
"""Radians that a joint turns at most in one step."""

SLACK_COST: Final = 1e3
"""Cost of a metre of slack; the objective is 100 at worst and changes by some tens a metre."""

QP_SOLVED: Final = proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED

OUTER_ITERATIONS: Final = 100
"""Of ProxQP; 10 to 50 are usual. One without a solution would take it minutes."""

INNER_ITERATIONS: Final = 20
"""Its steps in each of them; one or two are usual."""

MOST_ACTIVE: Final = 20
"""Rows that may be active in a guess; beyond, ProxQP looks for them."""


@dataclass(frozen=True, slots=True, eq=False)
class LimitedShape:
    """Result of the search.

    Parameters
    ----------
    angles : ndarray, shape (N,)
    iterations : int
    constraint : float
        Largest of what fixed links are off by.
    pressed : ndarray of `limits.ROW_TYPE`, shape (R,)
        Rows of limits that hold the shape where it is.
    """

    angles: Array
    iterations: int
    constraint: float
    pressed: LimitRows


class _Program(NamedTuple):
    """A quadratic program in the step and the slack.

    Parameters
    ----------
    gradient : ndarray, shape (N + 1,)
    hessian : ndarray, shape (N + 1, N + 1)
    factor : ndarray, shape (N, N)
        Of the Hessian without the slack.
    force : ndarray, shape (2,)
        Of the pull at the welder, see `optimise.replace_pull`.
    """

    gradient: Array
    hessian: Array
    factor: Array
    force: Array


class _Iterate:
    """All that is known at a shape: objective, constraints, rows of limits that are near."""

    def __init__(self, problem: ShapeArrays, limits: LimitArrays) -> None:
        n = len(problem.estimate)
        self.angles, self.state = np.empty(n), new_state(n, len(problem.fixed))
        self.plain_state = plain_tuple(self.state)
        self._problem, self._limits = plain_tuple(problem), plain_tuple(limits)
        self._rows, self._used = np.empty(128, dtype=ROW_TYPE), 0
        self.f, self.off, self.worst = 0.0, 0.0, 0.0

    def move_to(self, angles: Array, band: float) -> None:
        """Evaluate other angles."""
        self.angles[:] = angles
        while True:
            self.f, self.off, self.worst, self._used = _evaluate(
                self.angles, self._problem, self._limits, self.plain_state, self._rows, band
            )
            if self._used <= len(self._rows):
                return
            self._rows = np.empty(2 * self._used, dtype=ROW_TYPE)

    def merit(self, fix: float) -> float:
        """Objective with exact penalties: `fix` for the constraints, `SLACK_COST` for limits."""
        return self.f + fix * self.off + SLACK_COST * self.worst

    @property
    def rows(self) -> LimitRows:
        """Rows of limits that are near, shape (R,)."""
        return self._rows[: self._used]


@compiled
def _evaluate(
    angles: Array,
    plain_problem: Any,
    plain_limits: Any,
    plain_state: Any,
    rows: LimitRows,
    band: float,
) -> tuple[float, float, float, int]:
    """Fill state and rows; objective, constraints' sum, worst limit, number of rows."""
    problem, state = name_problem(plain_problem), name_state(plain_state)
    limits = name_limits(plain_limits)
    f = evaluate_shape(angles, problem, state)
    used = limit_rows(angles, state.links, band, rows, limits)
    worst = 0.0
    for r in range(min(used, len(rows))):
        worst = max(worst, -rows[r].margin)
    return f, np.abs(state.constraint).sum(), worst, used


@compiled
def _model(
    plain_problem: Any,
    plain_state: Any,
    rows: LimitRows,
    y: Array,
    z: Array,
    shift: float,
    plain_program: Any,
    gradients: Array,
) -> float:
    """Fill the program and the derivatives of its rows; returns the Hessian's shift."""
    problem, state = name_problem(plain_problem), name_state(plain_state)
    program = _Program(*plain_program)
    n, point = len(state.links), state.parts.point
    chain_gradient(state.parts, state.links, problem.length, program.gradient[:n])
    if len(z) == 0:
        least_squares_multipliers(state.jacobian, program.gradient[:n], y)
    add_multipliers(problem, y, point)
    if len(z) == len(rows):
        for r in range(len(rows)):
            row = rows[r]
            if z[r] != 0.0 and row.kind != LimitKind.JOINT:
                if row.link >= 0:
                    point[row.link, 0] += z[r] * row.grows_x
                    point[row.link, 1] += z[r] * row.grows_y
                if row.other >= 0:
                    point[row.other, 0] -= z[r] * row.grows_x
                    point[row.other, 1] -= z[r] * row.grows_y
    square = np.empty((n, n))
    shift, _ = convex_hessian(problem, state, program.force, shift, square, program.factor)
    for i in range(n):
        for j in range(i):
            program.hessian[i, j] = square[i, j]
            program.hessian[j, i] = square[i, j]
        program.hessian[i, i] = square[i, i] + shift
    limit_gradients(rows, problem.root, state.links, gradients)
    return shift


@compiled
def _guess_active(
    plain_program: Any, plain_state: Any, C: Array, rows: LimitRows, step: Array, y: Array, z: Array
) -> bool:
    """Solve a program by adding the worst row and dropping those that pull; True if that ends.

    What it then found meets all conditions of the program's solution, with no slack.
    """
    program, state = _Program(*plain_program), name_state(plain_state)
    n, m = len(step), len(state.constraint)
    active = np.zeros(len(rows), np.bool_)
    for _ in range(MOST_ACTIVE):
        count = m + active.sum()
        A, b, multipliers = np.empty((count, n)), np.empty(count), np.empty(count)
        A[:m], b[:m], k = state.jacobian, state.constraint, m
        for r in range(len(rows)):
            if active[r]:
                A[k], b[k] = C[r, :n], rows[r].margin
                k += 1
        constrained_step(program.factor, A, program.gradient[:n], b, step, multipliers)
        worst, which, k, settled = -1e-9, -1, m, True
        for r in range(len(rows)):
            z[r] = 0.0
            if active[r]:
                z[r] = multipliers[k]
                k += 1
                if z[r] > 1e-9:
                    active[r], settled = False, False
            margin = rows[r].margin + (C[r, :n] * step).sum()
            if margin < worst:
                worst, which = margin, r
        if settled and which < 0:
            y[:] = multipliers[:m]
            return bool(np.abs(z).sum() < SLACK_COST)
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
    The search ends when a step promises less than 1e-7 of the objective, or when none gains.
    """
    n, bound, arrays = len(start), problem.cable.joint_limit - SPARE_MARGIN, problem.arrays
    now, after = _Iterate(arrays, limits.arrays), _Iterate(arrays, limits.arrays)
    now.move_to(np.clip(start, -bound, bound), NEAR_BAND)
    y, z = np.zeros(len(now.state.constraint)), np.zeros(0)
    fix, shift, band, iteration = 1.0, 0.0, NEAR_BAND, 0
    program = _Program(
        np.full(n + 1, SLACK_COST), np.zeros((n + 1, n + 1)), np.zeros((n, n)), np.zeros(2)
    )
    program.hessian[n, n] = 1.0
    plain, plain_program = plain_tuple(arrays), plain_tuple(program)
    while iteration < most:
        iteration += 1
        rows = now.rows
        C = np.ones((len(rows), n + 1))
        shift = _model(plain, now.plain_state, rows, y, z, shift, plain_program, C)
        step, z, left, reach = np.empty(n), np.empty(len(rows)), 0.0, 1.0
        if not _guess_active(plain_program, now.plain_state, C, rows, step, y, z):
            step, left, y, z, reach = _solve_program(program, now, C)
        if reach == 0.0:
            break
        pull_after(arrays.moved, arrays.costs, now.state.links, arrays.root, step, program.force)
        fix = max(fix, 2 * float(np.abs(y).max(initial=0.0)))
        slope = float(program.gradient[:n] @ step) - fix * reach * now.off
        slope -= SLACK_COST * max(now.worst - left, 0.0)
        merit = now.merit(fix)
        share = min(1.0, LONGEST_TURN / max(float(np.abs(step).max()), 1e-300))
        for _ in range(12):
            after.move_to(now.angles + share * step, band)
            if after.merit(fix) <= merit + 1e-4 * share * slope + 1e-10 * abs(merit):
                break
            share *= 0.5
        else:
            if len(z) == 0 or band > NEAR_BAND:
                break
            band *= 3.0  # a limit out of the program may be in the way
            now.move_to(now.angles.copy(), band)
            z = np.zeros(0)
            continue
        now, after = after, now
        if -slope < 1e-7 * max(1.0, abs(now.f)) and np.abs(now.state.constraint).max() < 1e-7:
            break
    rows, off = now.rows, float(np.abs(now.state.constraint).max())
    holds = (rows["margin"] < 1e-5) & (np.abs(z) > 1e-6) if len(z) == len(rows) else slice(0)
    return LimitedShape(now.angles, iteration, off, rows[holds])


def _solve_program(
    program: _Program, now: _Iterate, C: Array
) -> tuple[Array, float, Array, Array, float]:
    """Step, slack left, multipliers of constraints and rows, and the share of c that is met.

    Joints at their limits may not let the whole of the constraints be met in one step.
    """
    constraint, jacobian = now.state.constraint, now.state.jacobian
    m, n = jacobian.shape
    A, rows = np.zeros((m, n + 1)), np.zeros((len(C) + 1, n + 1))
    A[:, :n], rows[:-1], rows[-1, n] = jacobian, C, 1.0
    low, high = np.append(-now.rows["margin"], 0.0), np.full(len(rows), 1e20)
    reach = 1.0
    while reach > 1e-3:
        qp = proxsuite.proxqp.dense.QP(n + 1, m, len(rows))
        qp.settings.eps_abs = 1e-8
        qp.init(program.hessian, program.gradient, A, -reach * constraint, rows, low, high)
        qp.settings.max_iter, qp.settings.max_iter_in = OUTER_ITERATIONS, INNER_ITERATIONS
        qp.solve()
        found = qp.results
        if found.info.status == QP_SOLVED:
            return found.x[:n], max(float(found.x[n]), 0.0), found.y, found.z[:-1], reach
        reach *= 0.25
    return np.zeros(n), now.worst, np.zeros(m), np.zeros(0), 0.0
