"""The shape near a limit: sequential quadratic programs, solved by ProxQP.

Two slacks that are punished exactly keep every program soluble: one of clearances of discs, which
may come quicker than vehicles can drive, and one of all other limits. What of them remains at the
end is how far the limits can't be kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import proxsuite

from tjscan.core.frames import Array
from tjscan.towing.shape import linear
from tjscan.towing.shape.area import Obstacles
from tjscan.towing.shape.chain import chain_gradient, chain_hessian
from tjscan.towing.shape.compiled import compiled
from tjscan.towing.shape.limits import (
    ROW_TYPE,
    SPARE_MARGIN,
    LimitArrays,
    LimitedProblem,
    LimitKind,
    LimitRows,
    RowBuffer,
    add_margin_changes,
    fill_limit_rows,
    limit_gradients,
)
from tjscan.towing.shape.problem import (
    ShapeArrays,
    ShapeState,
    add_multipliers,
    derivatives_of_state,
    evaluate_shape,
    factorise_lagrangian,
    new_shape_state,
    pull_gradient_after_step,
)

LIMIT_INCLUSION_MARGIN: Final = 0.05
"""Metres of margin below which a limit is in the program: some steps of a slow vehicle."""

LONGEST_JOINT_TURN: Final = 0.2
"""Radians that a joint turns at most in one step."""

LIMIT_VIOLATION_COST: Final = 1e3
"""Cost of a metre of slack; the objective is 100 at worst and changes by some tens a metre."""

TRIALS_OF_A_LENGTH: Final = 3
"""Of steps: as it is, corrected for the curvature of constraints, and corrected again."""

MOST_TRIALS: Final = 5 * TRIALS_OF_A_LENGTH
"""Of a whole step, and of ever shorter ones."""

LARGEST_CLOSED_MISS: Final = 1e-4
"""Metres by which a limit is missed at most that the last step closes."""

LEAST_CLOSED_MISS: Final = 1e-8
"""Metres and radians of such a miss that are not worth a step."""

LEAST_SLACK_GAIN: Final = 0.05
"""Of the merit, that of 0.05 mm of slack, which a step must promise while limits can't be kept:
less changes nothing that is said or done."""

LEAST_MULTIPLIER: Final = 1e-6
"""Of a row that holds the shape: the objective's change by its metres."""

SPEED_VIOLATION_FACTOR: Final = 3.0
"""How much more a metre counts that a vehicle can't drive: no clearance is worth it."""

ACTIVE_ROW_SOFTNESS: Final = 1e-10
"""Metres by which an active row gives way to its multiplier, each: equal rows then share one."""

ACTIVE_STEP_TOLERANCE: Final = 1e-3
"""Radians by which the step may differ from ProxQP's; by more, other rows are active."""

QP_SOLVED: Final = proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED

MOST_OUTER_ITERATIONS: Final = 100
"""Of ProxQP; 10 to 50 are usual. One without a solution would take it minutes."""

MOST_INNER_ITERATIONS: Final = 20
"""Its steps in each of them; one or two are usual."""

MOST_ACTIVE_ROUNDS: Final = 20
"""In which rows that are active are sought; beyond, ProxQP looks for them."""


@dataclass(frozen=True, slots=True, eq=False)
class LimitedShape:
    """Result of the search.

    Parameters
    ----------
    angles : ndarray, shape (N,)
    iterations : int
    pressed : ndarray of `limits.ROW_TYPE`, shape (R,)
        Rows of limits that hold the shape where it is.
    """

    angles: Array
    iterations: int
    pressed: LimitRows


class _QuadraticProgram(NamedTuple):
    """A quadratic program in the step, without its slack.

    Parameters
    ----------
    gradient : ndarray, shape (N,)
    factor : ndarray, shape (N, 6)
        Of the Hessian with a shift, see `linear.factorise_shifted`.
    force : ndarray, shape (2,)
        Of the pull at the welder, see `problem.replace_pull`.
    """

    gradient: Array
    factor: Array
    force: Array


class _ShapeIterate:
    """All that is known at a shape: objective, constraints, rows of limits that are near."""

    def __init__(self, limits: LimitedProblem) -> None:
        problem, n = limits.problem, limits.problem.cable.links
        self.angles, self.state = np.empty(n), new_shape_state(n, len(problem.fixed))
        self.plain_state = tuple(self.state)
        self._given = *problem.plain, tuple(limits.arrays)
        self._rows, self._used = np.empty(128 + n, dtype=ROW_TYPE), 0
        self.f, self.off, self.worst = 0.0, 0.0, 0.0

    def move_to(self, angles: Array, band: float) -> None:
        """Evaluate other angles."""
        self.angles[:] = angles
        while True:
            self.f, self.off, self.worst, self._used = _evaluate_shape(
                self.angles, *self._given, self.plain_state, self._rows, band
            )
            if self._used <= len(self._rows):
                return
            self._rows = np.empty(2 * self._used, dtype=ROW_TYPE)

    def merit(self, fix: float) -> float:
        """Objective with penalties: `fix` for constraints, `LIMIT_VIOLATION_COST` for limits."""
        return self.f + fix * self.off + LIMIT_VIOLATION_COST * self.worst

    @property
    def rows(self) -> LimitRows:
        """Rows of limits that are near, shape (R,)."""
        return self._rows[: self._used]


@compiled
def _evaluate_shape(
    angles: Array,
    plain_problem: Any,
    plain_obstacles: Any,
    plain_limits: Any,
    plain_state: Any,
    rows: LimitRows,
    band: float,
) -> tuple[float, float, float, int]:
    """Fill state and rows; objective, constraints' sum, worst limits' sum, number of rows.

    The worst limits are that of discs, and that of all else.
    """
    problem, state = ShapeArrays(*plain_problem), ShapeState(*plain_state)
    limits, obstacles = LimitArrays(*plain_limits), Obstacles(*plain_obstacles)
    f = evaluate_shape(angles, problem, obstacles, state)
    room = RowBuffer(rows, np.zeros(1, np.int64), band)
    fill_limit_rows(room, angles, state.links, limits, obstacles)
    used, worst, worst_disc = room.total[0], 0.0, 0.0
    for r in range(min(used, len(rows))):
        counts = SPEED_VIOLATION_FACTOR if rows[r].kind == LimitKind.SPEED else 1.0
        if rows[r].disc >= 0:
            worst_disc = max(worst_disc, -rows[r].margin)
        else:
            worst = max(worst, -rows[r].margin * counts)
    return f, np.abs(state.constraint).sum(), worst + worst_disc, used


@compiled
def _add_limit_forces(rows: LimitRows, z: Array, point: Array) -> None:
    """Add the forces of the multipliers of rows to those of the links."""
    for r in range(len(rows)):
        row = rows[r]
        if z[r] != 0.0 and row.kind != LimitKind.JOINT:
            if row.link >= 0:
                point[row.link, 0] += z[r] * row.grows_x
                point[row.link, 1] += z[r] * row.grows_y
            if row.other >= 0:
                point[row.other, 0] -= z[r] * row.grows_x
                point[row.other, 1] -= z[r] * row.grows_y


@compiled
def _solve_by_active_set(
    program: _QuadraticProgram,
    root: Array,
    state: ShapeState,
    rows: LimitRows,
    step: Array,
    y: Array,
    z: Array,
) -> bool:
    """Solve a program by adding the worst row and dropping those that pull; True if that ends.

    Rows of pulls and turns are of different pieces of cable and vehicles, and any number may be
    active in a long one: all that a step breaks are added together. A row is solved for once, when
    it is added first. What is found meets all conditions of the program's solution, with no slack.
    """
    n, m, used, wanted = len(step), len(state.constraint), 0, len(state.constraint)
    free, margins = -program.gradient, np.empty(len(rows))
    linear.back_substitute(program.factor, free)
    room = m + MOST_ACTIVE_ROUNDS + np.count_nonzero(rows["kind"] >= LimitKind.TAUT.value)
    gradients, solved, schur = np.empty((room, n)), np.empty((room, n)), np.empty((room, room))
    active, row_of, place_of = np.zeros(room), np.empty(room, np.int64), np.full(len(rows), -1)
    gradients[:m], missed = state.jacobian, np.empty(room)
    missed[:m], active[:m] = state.constraint, 1.0
    for _ in range(MOST_ACTIVE_ROUNDS):
        for place in range(used, wanted):
            solved[place] = gradients[place]
            linear.back_substitute(program.factor, solved[place])
            missed[place] += gradients[place] @ free
            schur[place, : place + 1] = solved[: place + 1] @ gradients[place]
            schur[: place + 1, place] = schur[place, : place + 1]
        used = wanted
        held, multipliers = np.flatnonzero(active[:used]), np.zeros(used)
        multipliers[held] = linear.solve_schur(schur[held][:, held], missed[held])
        step[:] = free - multipliers @ solved[:used]
        z[:], settled = 0.0, True
        for place in range(m, used):
            z[row_of[place]] = multipliers[place]
            if multipliers[place] > 1e-9:
                active[place], settled = 0.0, False
        add_margin_changes(rows, step, root, state.links, margins)
        worst = margins.argmin() if len(rows) else -1
        if worst < 0 or margins[worst] >= -1e-9:
            if settled:
                y[:] = multipliers[:m]
                return bool(np.abs(z).sum() < LIMIT_VIOLATION_COST)
            continue
        if place_of[worst] >= 0 and active[place_of[worst]]:
            return False
        for r in range(len(rows)):
            if r == worst or (rows[r].kind >= LimitKind.TAUT and margins[r] < -1e-9):
                if place_of[r] < 0:
                    row_of[wanted], missed[wanted], place_of[r] = r, rows[r].margin, wanted
                    new, wanted = gradients[wanted : wanted + 1], wanted + 1
                    limit_gradients(rows[r : r + 1], root, state.links, new)
                active[place_of[r]] = 1.0
    return False


@compiled
def _fill_quadratic_program(
    plain_problem: Any,
    plain_state: Any,
    rows: LimitRows,
    y: Array,
    last_z: Array,
    shift: float,
    plain_program: Any,
) -> tuple[float, bool, Array, Array]:
    """Fill a program, and guess its solution.

    Returns the Hessian's shift, whether the guess is the solution, the step, and the multipliers of
    the rows; those of the constraints are filled.
    """
    problem, state = ShapeArrays(*plain_problem), ShapeState(*plain_state)
    program = _QuadraticProgram(*plain_program)
    chain_gradient(derivatives_of_state(state), state.links, problem.length, program.gradient)
    if len(last_z) == 0:
        linear.least_squares_multipliers(state.jacobian, program.gradient, y)
    add_multipliers(problem, y, state.point)
    if len(last_z) == len(rows):
        _add_limit_forces(rows, last_z, state.point)
    shift, _ = factorise_lagrangian(problem, state, program.force, shift, program.factor)
    step, z = np.empty(len(state.links)), np.empty(len(rows))
    solved = _solve_by_active_set(program, problem.root, state, rows, step, y, z)
    return shift, solved, step, z


def optimise_within_limits(limits: LimitedProblem, start: Array, *, most: int = 40) -> LimitedShape:
    """Best shape near `start` that keeps all limits.

    Parameters
    ----------
    limits : LimitedProblem
        With their problem.
    start : ndarray, shape (N,)
        Angles, radians.
    most : int
        Programs.

    Notes
    -----
    The search ends when a step promises less than 1e-7 of the objective, or when none gains.
    """
    n, bound = len(start), limits.problem.cable.joint_limit - SPARE_MARGIN
    arrays, has_pull = limits.problem.arrays, limits.problem.pull is not None
    now, after = _ShapeIterate(limits), _ShapeIterate(limits)
    now.move_to(np.clip(start, -bound, bound), LIMIT_INCLUSION_MARGIN)
    y, z = np.zeros(len(now.state.constraint)), np.zeros(0)
    fix, shift, band, iteration = 1.0, 0.0, LIMIT_INCLUSION_MARGIN, 0
    program = _QuadraticProgram(np.empty(n), np.empty((n, 6)), np.zeros(2))
    plain, plain_program = tuple(arrays), tuple(program)
    while iteration < most:
        iteration += 1
        rows, left, reach = now.rows, 0.0, 1.0
        shift, solved, step, z = _fill_quadratic_program(
            plain, now.plain_state, rows, y, z, shift, plain_program
        )
        if not solved:
            step, left, y, z, reach = _solve_program(limits, program.gradient, shift, now)
        if reach == 0.0:
            break
        if has_pull:
            moved, costs, root = arrays.moved, arrays.costs, arrays.root
            pull_gradient_after_step(moved, costs, now.state.links, root, step, program.force)
        fix = max(fix, 2 * max(map(abs, y.tolist()), default=0.0))
        slope = float(program.gradient @ step) - fix * reach * now.off
        slope -= LIMIT_VIOLATION_COST * max(now.worst - left, 0.0)
        merit = now.merit(fix)
        share = min(1.0, LONGEST_JOINT_TURN / max(float(np.abs(step).max()), 1e-300))
        correction = np.zeros(n)
        for trial in range(MOST_TRIALS):
            after.move_to(now.angles + share * step + correction, band)
            if after.merit(fix) <= merit + 1e-4 * share * slope + 1e-10 * abs(merit):
                break
            if trial % TRIALS_OF_A_LENGTH < TRIALS_OF_A_LENGTH - 1:
                missed = after.state.constraint - (1 - share * reach) * now.state.constraint
                held = rows[np.abs(z) > LEAST_MULTIPLIER] if len(z) == len(rows) else rows[:0]
                way = share * step
                correction += _correct_for_curvature(limits, now, after, held, way, missed)
            else:
                correction, share = np.zeros(n), 0.25 * share
        else:
            if len(z) == 0 or band > LIMIT_INCLUSION_MARGIN:
                break
            band *= 3.0  # a limit out of the program may be in the way
            now.move_to(now.angles.copy(), band)
            z = np.zeros(0)
            continue
        now, after = after, now
        ends = -slope < 1e-7 * max(1.0, abs(now.f)) and np.abs(now.state.constraint).max() < 1e-7
        if ends or (left > LARGEST_CLOSED_MISS and -slope < LEAST_SLACK_GAIN):
            break
    rows = now.rows
    holds = (
        (rows["margin"] < 1e-5) & (np.abs(z) > LEAST_MULTIPLIER)
        if len(z) == len(rows)
        else slice(0)
    )
    pressed = rows[holds].copy()
    near = rows[(np.abs(rows["margin"]) < LARGEST_CLOSED_MISS) & (rows["disc"] < 0)]
    changes = np.append(-now.state.constraint, -np.minimum(near["margin"], 0.0))
    if np.abs(changes).max() > LEAST_CLOSED_MISS:
        closed = now.angles + np.linalg.lstsq(_held_gradients(limits, now, near), changes)[0]
        after.move_to(closed, band)
        if after.merit(fix) <= now.merit(fix) + LARGEST_CLOSED_MISS:
            now = after
    return LimitedShape(now.angles, iteration, pressed)


def _correct_for_curvature(
    limits: LimitedProblem,
    now: _ShapeIterate,
    after: _ShapeIterate,
    rows: LimitRows,
    step: Array,
    missed: Array,
) -> Array:
    """Least further step that makes up for what a step misses constraints and limits by.

    Those miss what curvature takes from their linear change. Without such a correction only tiny
    steps gain (Maratos, 1978).

    Parameters
    ----------
    limits : LimitedProblem
    now, after : _ShapeIterate
        Before the step, and after it, as far as it is corrected.
    rows : ndarray of `limits.ROW_TYPE`
        Limits that hold the shape.
    step : ndarray, shape (N,)
        Uncorrected, radians.
    missed : ndarray, shape (3 E,)
        By the constraints.
    """
    links, moved, gradients = now.state.links, after.state.links, _held_gradients(limits, now, rows)
    lost = gradients[len(missed) :] @ step
    ends, moved_ends = links[:, 0] + 1j * links[:, 1], moved[:, 0] + 1j * moved[:, 1]
    turned = np.exp(1j * (moved[:, 2] - links[:, 2]))
    for link, x, y, sign in (("link", "x", "y", 1), ("other", "other_x", "other_y", -1)):
        which, place = rows[link], rows[x] + 1j * rows[y]
        way = moved_ends[which] + turned[which] * (place - ends[which]) - place
        change = rows["grows_x"] * way.real + rows["grows_y"] * way.imag
        lost -= sign * np.where(which >= 0, change, 0.0)
    lost[rows["kind"] == LimitKind.JOINT] = 0.0
    return np.asarray(np.linalg.lstsq(gradients, np.append(-missed, lost))[0])


def _held_gradients(limits: LimitedProblem, now: _ShapeIterate, rows: LimitRows) -> Array:
    """Derivatives of constraints and of rows by the angles, shape (3 E + R, N)."""
    links, count = now.state.links, len(now.state.constraint)
    gradients = np.vstack((now.state.jacobian, np.empty((len(rows), len(links)))))
    limit_gradients(rows, limits.arrays.root, links, gradients[count:])
    return gradients


def _solve_program(
    limits: LimitedProblem, objective_gradient: Array, shift: float, now: _ShapeIterate
) -> tuple[Array, float, Array, Array, float]:
    """Step, slack left, multipliers of constraints and rows, and the share of c that is met.

    Joints and speeds have no slack. They may not let the whole of the constraints be met in one
    step.
    """
    constraint, jacobian, links = now.state.constraint, now.state.jacobian, now.state.links
    m, n = jacobian.shape
    hessian, gradient = np.eye(n + 2), np.append(objective_gradient, 2 * [LIMIT_VIOLATION_COST])
    chain_hessian(derivatives_of_state(now.state), links, limits.arrays.length, hessian[:n, :n])
    hessian[:n, :n] += shift * np.eye(n)
    margins, kinds, of_disc = now.rows["margin"], now.rows["kind"], now.rows["disc"] >= 0
    is_hard = (kinds == LimitKind.JOINT) | (kinds == LimitKind.SPEED) | (kinds == LimitKind.TURN)
    A, rows = np.zeros((m, n + 2)), np.eye(len(margins) + 2, n + 2, n - len(margins))
    A[:, :n] = jacobian
    limit_gradients(now.rows, limits.arrays.root, links, rows)
    rows[:-2, n], rows[:-2, n + 1] = ~is_hard & ~of_disc, of_disc
    low, high = np.append(-margins, (0.0, 0.0)), np.full(len(rows), 1e20)
    reach = 1.0
    while reach > 1e-3:
        qp = proxsuite.proxqp.dense.QP(n + 2, m, len(rows))
        qp.settings.eps_abs = 1e-8
        qp.init(hessian, gradient, A, -reach * constraint, rows, low, high)
        qp.settings.max_iter, qp.settings.max_iter_in = MOST_OUTER_ITERATIONS, MOST_INNER_ITERATIONS
        qp.solve()
        found = qp.results
        if found.info.status == QP_SOLVED:
            # ProxQP's last digits depend on where its memory is: what it found active is solved.
            held, z = np.abs(found.z) > LEAST_MULTIPLIER, np.zeros(len(rows))
            active = np.vstack((A, rows[held]))
            soft = -ACTIVE_ROW_SOFTNESS * np.eye(len(active))
            right = np.concatenate((-gradient, -reach * constraint, low[held]))
            solution = np.linalg.solve(np.block([[hessian, active.T], [active, soft]]), right)
            step, y, z[held] = np.split(solution, (n + 2, n + 2 + m))
            if not np.allclose(step, found.x, rtol=0.0, atol=ACTIVE_STEP_TOLERANCE):
                step, y, z = found.x, found.y, found.z
            return step[:n], float(np.maximum(step[n:], 0.0).sum()), y, z[:-2], reach
        reach *= 0.25
    return np.zeros(n), now.worst, np.zeros(m), np.zeros(0), 0.0
