"""The objective (5) of Suzuki et al. (2022), and Newton's method for it if no limit is near.

Its saturating loss (9) is ρ(f) = Σ a_i (tanh(b_i (f - c_i)) + d_i), i = 1, 2. The paper gives its
limits, 0 and 1, and its inflection, the effort target. Here both c_i are that target; the slopes b
are 4 and 1 over it, so that one curve turns steeply at the target and a gentle one gives a slope
everywhere; their shares are 0.8 and 0.2; d_i and the scale of a_i follow from the limits.

The cost of the pull at the welder is a thousand times as stiff as all other terms, for the place of
one link. Its gradient at the beginning of a search would bend the Hessian so much that only tiny
steps were convex; but it vanishes with the first step, all but the force with which the other terms
hold against it. So that force takes its place, as a multiplier does that of a constraint, and the
curvature is added as rows squared.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import exp, sqrt, tanh
from typing import Any, Final, NamedTuple

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape import chain, linear
from tjscan.towing.shape.area import Obstacles
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.chain import ChainDerivatives, place_links
from tjscan.towing.shape.compiled import Indices, compiled
from tjscan.towing.shape.distance import SignedDistance, distance_to_obstacle
from tjscan.towing.shape.estimate import PULL_TERM_INDEX, CablePull
from tjscan.towing.shape.plan import PlanTerms
from tjscan.towing.tables import TargetSettings, WeightSettings

LONGEST_JOINT_TURN: Final = 0.5
"""Radians that a joint turns at most in one step of Newton's method."""

ANGLE_CHANGE_SMOOTHING: Final = 0.02
"""Radians within which |θ - θ_init| is rounded: it has a kink at the planner's start."""

PACE_TERM_INDEX: Final = 3
"""Index of the term of the vehicles' steps."""

NEGLIGIBLE_TARGET_DISTANCES: Final = 10.0
"""Target distances beyond which an obstacle's loss is below 1e-7 and left out."""

OBSTACLE_LOSS: Final = ((0.8, 4.0), (0.2, 1.0))
"""Of the two curves; slopes over the target."""

RISING_LOSS_CURVES: Final = tuple((share / (1 + tanh(b)), b, tanh(b)) for share, b in OBSTACLE_LOSS)
"""a_i, b_i times the target, and d_i of a rising loss."""


@compiled
def rising_loss(f: float, target: float) -> tuple[float, float, float]:
    """ρ of (9) and two derivatives: 0 at 0, 1 at infinity, inflection at the target."""
    value, first, second = 0.0, 0.0, 0.0
    for a, slope, d in RISING_LOSS_CURVES:
        b = slope / target
        t = 1.0 - 2.0 / (1.0 + exp(min(2.0 * b * (f - target), 700.0)))  # tanh, in half its time
        steep = a * b * (1.0 - t * t)
        value += a * (t + d)
        first += steep
        second -= 2.0 * b * t * steep
    return value, first, second


@compiled
def one_minus_falling_loss(d: float, target: float) -> tuple[float, float, float]:
    """1 - ρ_d of (9) and two derivatives: 0 deep inside, 1 far away.

    ρ_d falls: a_i < 0 and d_i = -1, so that 1 - ρ_d is a sum of logistic curves.
    """
    value, first, second = 0.0, 0.0, 0.0
    for share, slope in OBSTACLE_LOSS:
        b = 2.0 * slope / target
        s = 1.0 / (1.0 + exp(min(-b * (d - target), 700.0)))
        steep = share * b * s * (1.0 - s)
        value += share * s
        first += steep
        second += b * (1.0 - 2.0 * s) * steep
    return value, first, second


@compiled
def obstacle_loss(
    x: float, y: float, target: float, walls: Array, corners: Array, starts: Indices, discs: Array
) -> SignedDistance:
    """1 - Π(1 - ρ_d(d_k)) over the obstacles at a point, its gradient and Hessian."""
    log_free, gx, gy, hxx, hxy, hyy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(walls) + len(starts) - 1 + len(discs)):
        d, dx, dy, dxx, dxy, dyy = distance_to_obstacle(k, x, y, walls, corners, starts, discs)
        if d > NEGLIGIBLE_TARGET_DISTANCES * target:
            continue
        q, first, second = one_minus_falling_loss(d, target)
        q = max(q, 1e-300)
        one, two = first / q, second / q - (first / q) ** 2
        log_free += np.log(q)
        gx += one * dx
        gy += one * dy
        hxx += two * dx * dx + one * dxx
        hxy += two * dx * dy + one * dxy
        hyy += two * dy * dy + one * dyy
    free = exp(log_free)
    xx, xy, yy = -free * (gx * gx + hxx), -free * (gx * gy + hxy), -free * (gy * gy + hyy)
    return 1.0 - free, -free * gx, -free * gy, xx, xy, yy


class ShapeArrays(NamedTuple):
    """The problem of a shape, as compiled functions take it.

    Parameters
    ----------
    estimate : ndarray, shape (N,)
    root : ndarray, shape (3,)
    length : float
        Of a link, metres.
    scale : ndarray, shape (3,)
        Weights of bend, obstacle and change, over N.
    targets : ndarray, shape (3,)
        Of bend (squared), distance and change.
    moved : ndarray of int, shape (Q,)
        Links whose positions cost something by themselves, see `costs`.
    costs : ndarray, shape (Q, 9)
        Of each: the index of its term, x and y of a place, the cost there, its gradient and its
        Hessian.
    fixed : ndarray of int, shape (E,)
        Links that must have the poses `fixed_poses`, shape (E, 3).
    fixed_poses : ndarray, shape (E, 3)
    """

    estimate: Array
    root: Array
    length: float
    scale: Array
    targets: Array
    moved: Indices
    costs: Array
    fixed: Indices
    fixed_poses: Array


class ShapeState(NamedTuple):
    """All that is known of one shape, filled by `evaluate_shape`.

    Parameters
    ----------
    links : ndarray, shape (N, 5)
        As `place_links` fills it.
    joint, point, turn : ndarray
        `ChainDerivatives` of the objective.
    terms : ndarray, shape (5,)
        Of the objective.
    constraint : ndarray, shape (3 E,)
        What fixed links are off by.
    jacobian : ndarray, shape (3 E, N)
        Its derivative by the angles.
    """

    links: Array
    joint: Array
    point: Array
    turn: Array
    terms: Array
    constraint: Array
    jacobian: Array


def new_shape_state(n: int, fixed: int) -> ShapeState:
    """Room for a chain of n links and a number of fixed ones."""
    links, point = np.empty((n, 5)), np.empty((n, 5))
    joint, turn = np.empty((n, 2)), np.empty((n, 2))
    constraint, jacobian = np.zeros(3 * fixed), np.zeros((3 * fixed, n))
    return ShapeState(links, joint, point, turn, np.empty(5), constraint, jacobian)


make_shape_state = compiled(new_shape_state)
"""`new_shape_state` for compiled functions: they are slow to give tuples back."""


@compiled
def derivatives_of_state(state: ShapeState) -> ChainDerivatives:
    """What joints and links contribute to the derivatives of a shape's objective."""
    return ChainDerivatives(state.joint, state.point, state.turn)


@compiled
def cost_gradient(cost: Array, x: float, y: float) -> tuple[float, float]:
    """Gradient at (x, y) of what a link's place costs by itself, see `ShapeArrays`."""
    dx, dy = x - cost[1], y - cost[2]
    return cost[4] + cost[6] * dx + cost[7] * dy, cost[5] + cost[7] * dx + cost[8] * dy


@compiled
def evaluate_shape(
    angles: Array, problem: ShapeArrays, obstacles: Obstacles, state: ShapeState
) -> float:
    """The objective at a shape; fills the state."""
    estimate, scale, targets = problem.estimate, problem.scale, problem.targets
    links, terms, joint, point = state.links, state.terms, state.joint, state.point
    walls, corners, starts, discs = obstacles
    place_links(angles, problem.root, problem.length, links)
    terms[:], state.turn[:] = 0.0, 0.0
    for i in range(len(angles)):
        a = angles[i]
        value, first, second = rising_loss(a * a, targets[0])
        terms[0] += scale[0] * value
        one, two = scale[0] * first * 2.0 * a, scale[0] * (2.0 * first + 4.0 * a * a * second)
        if i > 0 and scale[2] > 0.0:
            e = a - estimate[i]
            root = sqrt(e * e + ANGLE_CHANGE_SMOOTHING * ANGLE_CHANGE_SMOOTHING)
            value, first, second = rising_loss(root - ANGLE_CHANGE_SMOOTHING, targets[2])
            slope = e / root
            terms[2] += scale[2] * value
            one += scale[2] * first * slope
            two += scale[2] * (second * slope * slope + first * (1.0 - slope * slope) / root)
        loss = obstacle_loss(links[i, 0], links[i, 1], targets[1], walls, corners, starts, discs)
        terms[1] += scale[1] * loss[0]
        joint[i, 0], joint[i, 1] = one, two
        for m in range(5):
            point[i, m] = scale[1] * loss[m + 1]
    moved, costs = problem.moved, problem.costs
    for m in range(len(moved)):
        k, cost = moved[m], costs[m]
        x, y = links[k, 0] - cost[1], links[k, 1] - cost[2]
        gx, gy = cost_gradient(cost, links[k, 0], links[k, 1])
        terms[int(cost[0])] += cost[3] + 0.5 * ((cost[4] + gx) * x + (cost[5] + gy) * y)
        point[k, 0] += gx
        point[k, 1] += gy
        point[k, 2:] += cost[6:]
    fixed, poses = problem.fixed, problem.fixed_poses
    chain.pose_constraints(links, problem.root, fixed, poses, state.constraint, state.jacobian)
    return float(terms.sum())


@compiled
def _evaluate_plain(angles: Array, problem: Any, obstacles: Any, state: Any) -> float:
    """`evaluate_shape` of plain tuples."""
    return evaluate_shape(angles, ShapeArrays(*problem), Obstacles(*obstacles), ShapeState(*state))


@dataclass(frozen=True, eq=False)
class ShapeProblem:
    """Problem (5) with a term for the vehicles' steps, for one period.

    Parameters
    ----------
    cable : Cable
    obstacles : Obstacles
    weights : WeightSettings
    targets : TargetSettings
    estimate : ndarray, shape (N,)
        θ_init, radians.
    fixed : ndarray of int, shape (E,)
        Links that must have the poses `fixed_poses`, shape (E, 3): the welder's, and those of
        vehicles that are at rest.
    paced : ndarray of int, shape (M,)
        Links of the vehicles that drive, and where their steps begin: `pace_from`, shape (M, 3).
    period : float
        Seconds.
    pull : CablePull or None
        At the welder; None if it is not known.
    """

    cable: Cable
    obstacles: Obstacles
    weights: WeightSettings
    targets: TargetSettings
    estimate: Array
    fixed: Indices
    fixed_poses: Array
    paced: Indices
    pace_from: Array
    period: float
    pull: CablePull | None = None

    @cached_property
    def arrays(self) -> ShapeArrays:
        """The same but for the obstacles, as compiled functions take it."""
        w, targets, links = self.weights, self.targets, self.cable.links
        moved, costs = self.paced, np.zeros((len(self.paced), 9))
        costs[:, 0], costs[:, 1:3] = PACE_TERM_INDEX, self.pace_from[:, :2]
        costs[:, 6] = costs[:, 8] = 2 * w.pace / (self.period * links)
        if self.pull is not None:
            pull = self.pull.cost(w.pull / links, targets.pull, self.period)
            moved, costs = np.append(moved, self.pull.link), np.vstack((costs, pull))
        return ShapeArrays(
            self.estimate,
            np.array(self.cable.root, dtype=float),
            self.cable.link_length,
            np.array((w.bending, w.distance, w.change)) / links,
            np.array((targets.bending**2, targets.distance, targets.change)),
            moved,
            costs,
            self.fixed,
            self.fixed_poses,
        )

    @property
    def plain(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Arrays and obstacles as plain tuples: Numba finds their types ten times as fast."""
        return tuple(self.arrays), tuple(self.obstacles)

    def evaluated(self, angles: Array) -> ShapeState:
        """All that is known of a shape."""
        state = new_shape_state(len(angles), len(self.fixed))
        _evaluate_plain(angles, *self.plain, tuple(state))
        return state

    def terms(self, angles: Array) -> PlanTerms:
        """The objective's terms."""
        return PlanTerms(*self.evaluated(angles).terms.tolist())

    def constraint(self, angles: Array) -> tuple[Array, Array]:
        """What fixed links are off by, shape (3 E,), and its derivative, shape (3 E, N)."""
        state = self.evaluated(angles)
        return state.constraint, state.jacobian


@compiled
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
        if costs[m, 0] == PULL_TERM_INDEX:
            k = moved[m]
            gx, gy = cost_gradient(costs[m], links[k, 0], links[k, 1])
            point[k, 0] += force[0] - gx
            point[k, 1] += force[1] - gy
            point[k, 2:] -= costs[m, 6:]


@compiled
def pull_gradient_after_step(
    moved: Indices, costs: Array, links: Array, root: Array, step: Array, force: Array
) -> None:
    """The pull's gradient by its link's place after a step of the angles, shape (2,), filled."""
    for m in range(len(moved)):
        if costs[m, 0] == PULL_TERM_INDEX:
            k = moved[m]
            x, y = links[k, 0], links[k, 1]
            for i in range(k + 1):
                way = chain.link_motion_by_joint(i, k, links, root)
                x += way[0] * step[i]
                y += way[1] * step[i]
            force[0], force[1] = cost_gradient(costs[m], x, y)


@compiled
def factorise_lagrangian(
    problem: ShapeArrays, state: ShapeState, force: Array, shift: float, factor: Array
) -> tuple[float, float]:
    """Factor of the Lagrangian's Hessian, made convex; the shift and the rows' weight.

    Parameters
    ----------
    problem : ShapeArrays
    state : ShapeState
        Its parts hold the forces of all multipliers; curvatures of constraints and pull are added.
    force : ndarray, shape (2,)
        Of the pull, see `replace_pull`.
    shift : float
        Of the diagonal, in the step before.
    factor : ndarray, shape (N, 6)
        Filled, see `linear.factorise_shifted`.
    """
    links, moved, costs, fixed = state.links, problem.moved, problem.costs, problem.fixed
    replace_pull(moved, costs, links, force, state.point)
    parts, diagonal = derivatives_of_state(state), np.empty(len(links))
    chain.chain_hessian_diagonal(parts, links, problem.length, diagonal)
    weight = linear.weigh_constraint_squares(state.jacobian, diagonal)
    least = 1e-4 * np.abs(diagonal).max()
    for e in range(len(fixed)):
        state.point[fixed[e], 2] += weight
        state.point[fixed[e], 4] += weight
        state.turn[fixed[e], 1] += weight
    for m in range(len(moved)):
        if costs[m, 0] == PULL_TERM_INDEX:
            state.point[moved[m], 2:] += costs[m, 6:]
    return linear.factorise_convex(parts, links, problem.length, shift, factor, least), weight


@compiled
def minimise_objective(
    angles: Array, most: int, tolerance: float, arrays: Any, plain_obstacles: Any
) -> int:
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
    arrays : tuple
        Of `ShapeArrays`, but a plain one: Numba finds its type ten times as fast.
    plain_obstacles : tuple
        Likewise of `Obstacles`.

    Returns
    -------
    int
        Iterations.
    """
    problem, obstacles = ShapeArrays(*arrays), Obstacles(*plain_obstacles)
    n, m = len(angles), 3 * len(problem.fixed)
    state, after = make_shape_state(n, m // 3), make_shape_state(n, m // 3)
    gradient, step, second = np.empty(n), np.empty(n), np.empty(n)
    factor, y, force = np.empty((n, 6)), np.zeros(m), np.zeros(2)
    penalty, shift, iteration, done = 0.0, 0.0, 0, False
    f = evaluate_shape(angles, problem, obstacles, state)
    while True:
        chain.chain_gradient(derivatives_of_state(state), state.links, problem.length, gradient)
        residual = linear.least_squares_multipliers(state.jacobian, gradient, y)
        is_best = residual < tolerance and np.abs(state.constraint).max() < 1e-9
        if done or iteration >= most or is_best:
            break
        iteration += 1
        add_multipliers(problem, y, state.point)
        shift, weight = factorise_lagrangian(problem, state, force, shift, factor)
        linear.constrained_step(factor, state.jacobian, gradient, state.constraint, step, y)
        pull_gradient_after_step(
            problem.moved, problem.costs, state.links, problem.root, step, force
        )
        off = np.abs(state.constraint).sum()
        penalty = max(penalty, 2.0 * np.abs(y - weight * state.constraint).max())
        slope = gradient @ step - penalty * off
        share = min(1.0, LONGEST_JOINT_TURN / max(np.abs(step).max(), 1e-300))
        merit, second[:] = f + penalty * off, 0.0
        for k in range(30):
            trial = angles + share * step + second
            f = evaluate_shape(trial, problem, obstacles, after)
            reached = f + penalty * np.abs(after.constraint).sum()
            if reached <= merit + 1e-4 * share * slope + 1e-12 * abs(merit):
                break
            if k == 0 and share == 1.0:
                linear.constrained_step(
                    factor, state.jacobian, np.zeros(n), after.constraint, second, y
                )
            else:
                share, second[:] = 0.5 * share, 0.0
        else:
            break
        angles[:] = trial
        state, after = after, state
        settled = np.abs(state.constraint).max() < 1e-8
        done = -slope < 1e-6 * max(1.0, abs(f)) and settled
    return iteration
