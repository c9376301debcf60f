"""The objective (5) of Suzuki et al. (2022): terms and derivatives.

Its saturating loss (9) is ρ(f) = Σ a_i (tanh(b_i (f - c_i)) + d_i), i = 1, 2. The paper gives its
limits, 0 and 1, and its inflection, the effort target. Here both c_i are that target; the slopes b
are 4 and 1 over it, so that one curve turns steeply at the target and a gentle one gives a slope
everywhere; their shares are 0.8 and 0.2; d_i and the scale of a_i follow from the limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, sqrt, tanh
from typing import Any, NamedTuple

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.area import Obstacles
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.chain import (
    ChainParts,
    chain_gradient,
    chain_hessian,
    make_parts,
    place_links,
    pose_constraints,
)
from tjscan.towing.shape.compiled import Indices, compiled, inlined, plain_tuple
from tjscan.towing.shape.distance import distance_to_obstacle
from tjscan.towing.shape.plan import PlanTerms
from tjscan.towing.shape.pull import CablePull
from tjscan.towing.tables import TargetSettings, WeightSettings

SMOOTH_CHANGE = 0.02
"""Radians within which |θ - θ_init| is rounded: it has a kink at the planner's start."""

PACE_TERM = 3
"""Index of the term of the vehicles' steps."""

FAR_TARGETS = 10.0
"""Target distances beyond which an obstacle's loss is below 1e-7 and left out."""

SHARES_AND_SLOPES = ((0.8, 4.0), (0.2, 1.0))
"""Of the two curves; slopes over the target."""

RISING_CURVES = tuple((share / (1 + tanh(b)), b, tanh(b)) for share, b in SHARES_AND_SLOPES)
"""a_i, b_i times the target, and d_i of a rising loss."""


@compiled
def rising_loss(f: float, target: float) -> tuple[float, float, float]:
    """ρ of (9) and two derivatives: 0 at 0, 1 at infinity, inflection at the target."""
    value, first, second = 0.0, 0.0, 0.0
    for a, slope, d in RISING_CURVES:
        b = slope / target
        t = 1.0 - 2.0 / (1.0 + exp(min(2.0 * b * (f - target), 700.0)))  # tanh, in half its time
        steep = a * b * (1.0 - t * t)
        value += a * (t + d)
        first += steep
        second -= 2.0 * b * t * steep
    return value, first, second


@compiled
def free_share(d: float, target: float) -> tuple[float, float, float]:
    """1 - ρ_d of (9) and two derivatives: 0 deep inside, 1 far away.

    ρ_d falls: a_i < 0 and d_i = -1, so that 1 - ρ_d is a sum of logistic curves.
    """
    value, first, second = 0.0, 0.0, 0.0
    for share, slope in SHARES_AND_SLOPES:
        b = 2.0 * slope / target
        s = 1.0 / (1.0 + exp(min(-b * (d - target), 700.0)))
        steep = share * b * s * (1.0 - s)
        value += share * s
        first += steep
        second += b * (1.0 - 2.0 * s) * steep
    return value, first, second


@compiled
def obstacle_loss(
    x: float,
    y: float,
    target: float,
    walls: Array,
    corners: Array,
    starts: Indices,
    discs: Array,
) -> tuple[float, float, float, float, float, float]:
    """1 - Π(1 - ρ_d(d_k)) over the obstacles at a point, its gradient and Hessian."""
    log_free, gx, gy, hxx, hxy, hyy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(walls) + len(starts) - 1 + len(discs)):
        d, dx, dy, dxx, dxy, dyy = distance_to_obstacle(k, x, y, walls, corners, starts, discs)
        if d > FAR_TARGETS * target:
            continue
        q, first, second = free_share(d, target)
        q = max(q, 1e-300)
        one, two = first / q, second / q - (first / q) ** 2
        log_free += np.log(q)
        gx += one * dx
        gy += one * dy
        hxx += two * dx * dx + one * dxx
        hxy += two * dx * dy + one * dxy
        hyy += two * dy * dy + one * dyy
    free = exp(log_free)
    return (
        1.0 - free,
        -free * gx,
        -free * gy,
        -free * (gx * gx + hxx),
        -free * (gx * gy + hxy),
        -free * (gy * gy + hyy),
    )


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
    obstacles : Obstacles
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
    obstacles: Obstacles
    fixed: Indices
    fixed_poses: Array


class ShapeState(NamedTuple):
    """All that is known of one shape, filled by `evaluate_shape`.

    Parameters
    ----------
    links : ndarray, shape (N, 5)
        As `place_links` fills it.
    parts : ChainParts
        Of the objective.
    terms : ndarray, shape (5,)
        Of the objective.
    constraint : ndarray, shape (3 E,)
        What fixed links are off by.
    jacobian : ndarray, shape (3 E, N)
        Its derivative by the angles.
    """

    links: Array
    parts: ChainParts
    terms: Array
    constraint: Array
    jacobian: Array


def new_state(n: int, fixed: int) -> ShapeState:
    """`make_state` without Numba, which is slow to give tuples back."""
    parts = ChainParts(np.empty((n, 2)), np.empty((n, 5)), np.zeros((n, 2)))
    constraint, jacobian = np.zeros(3 * fixed), np.zeros((3 * fixed, n))
    return ShapeState(np.empty((n, 5)), parts, np.empty(5), constraint, jacobian)


@inlined
def name_problem(plain: Any) -> ShapeArrays:
    """The problem of a plain tuple."""
    estimate, root, length, scale, targets, moved, costs, obstacles, fixed, poses = plain
    named = Obstacles(*obstacles)
    return ShapeArrays(estimate, root, length, scale, targets, moved, costs, named, fixed, poses)


@inlined
def name_state(plain: Any) -> ShapeState:
    """The state of a plain tuple."""
    links, parts, terms, constraint, jacobian = plain
    return ShapeState(links, ChainParts(*parts), terms, constraint, jacobian)


@inlined
def make_state(n: int, fixed: int) -> ShapeState:
    """Room for a chain of n links and a number of fixed ones."""
    constraint, jacobian = np.zeros(3 * fixed), np.zeros((3 * fixed, n))
    return ShapeState(np.empty((n, 5)), make_parts(n), np.empty(5), constraint, jacobian)


@inlined
def evaluate_shape(angles: Array, problem: ShapeArrays, state: ShapeState) -> float:
    """The objective at a shape; fills the state."""
    place_links(angles, problem.root, problem.length, state.links)
    f = shape_terms(angles, problem, state)
    pose_constraints(
        state.links,
        problem.root,
        problem.fixed,
        problem.fixed_poses,
        state.constraint,
        state.jacobian,
    )
    return f


@compiled
def _evaluate_plain(angles: Array, problem: Any, state: Any) -> float:
    """`evaluate_shape` of plain tuples."""
    return evaluate_shape(angles, name_problem(problem), name_state(state))


@inlined
def shape_terms(angles: Array, problem: ShapeArrays, state: ShapeState) -> float:
    """The objective at a shape whose links are placed; fills the state's terms and parts."""
    estimate, scale, targets = problem.estimate, problem.scale, problem.targets
    links, terms = state.links, state.terms
    joint, point = state.parts.joint, state.parts.point
    walls, corners, starts, discs = problem.obstacles
    terms[:] = 0.0
    for i in range(len(angles)):
        a = angles[i]
        value, first, second = rising_loss(a * a, targets[0])
        terms[0] += scale[0] * value
        one, two = scale[0] * first * 2.0 * a, scale[0] * (2.0 * first + 4.0 * a * a * second)
        if i > 0 and scale[2] > 0.0:
            e = a - estimate[i]
            root = sqrt(e * e + SMOOTH_CHANGE * SMOOTH_CHANGE)
            value, first, second = rising_loss(root - SMOOTH_CHANGE, targets[2])
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
        k = moved[m]
        x, y = links[k, 0] - costs[m, 1], links[k, 1] - costs[m, 2]
        gx, gy, xx, xy, yy = costs[m, 4], costs[m, 5], costs[m, 6], costs[m, 7], costs[m, 8]
        terms[int(costs[m, 0])] += (
            costs[m, 3] + gx * x + gy * y + 0.5 * (xx * x * x + yy * y * y) + xy * x * y
        )
        point[k, 0] += gx + xx * x + xy * y
        point[k, 1] += gy + xy * x + yy * y
        point[k, 2] += xx
        point[k, 3] += xy
        point[k, 4] += yy
    return float(terms.sum())


@dataclass(frozen=True, slots=True, eq=False)
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
        vehicles that stand.
    paced : ndarray of int, shape (M,)
        Links of the vehicles that drive, and where their steps begin: `pace_from`, shape (M, 2).
    period : float
        Seconds.
    pull : CablePull or None
        At the welder; None where it is not known.
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

    @property
    def arrays(self) -> ShapeArrays:
        """The same, as compiled functions take it."""
        w, targets, links = self.weights, self.targets, self.cable.links
        moved, costs = self.paced, np.zeros((len(self.paced), 9))
        costs[:, 0], costs[:, 1:3] = PACE_TERM, self.pace_from
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
            self.obstacles,
            self.fixed,
            self.fixed_poses,
        )

    def evaluated(self, angles: Array) -> ShapeState:
        """All that is known of a shape."""
        state = new_state(len(angles), len(self.fixed))
        _evaluate_plain(angles, plain_tuple(self.arrays), plain_tuple(state))
        return state

    def terms(self, angles: Array) -> PlanTerms:
        """The objective's terms."""
        return PlanTerms(*self.evaluated(angles).terms.tolist())

    def gradient(self, angles: Array) -> Array:
        """Of the objective, shape (N,)."""
        state, gradient = self.evaluated(angles), np.empty(len(angles))
        chain_gradient(state.parts, state.links, self.cable.link_length, gradient)
        return gradient

    def hessian(self, angles: Array, multipliers: Array | None = None) -> Array:
        """Of the objective, shape (N, N), or of the Lagrangian with the constraints' multipliers.

        Parameters
        ----------
        angles : ndarray, shape (N,)
        multipliers : ndarray, shape (3 E,), optional
        """
        state, hessian = self.evaluated(angles), np.empty((len(angles), len(angles)))
        if multipliers is not None:
            for link, forces in zip(self.fixed, multipliers.reshape(-1, 3), strict=True):
                state.parts.point[link, :2] += forces[:2]
        chain_hessian(state.parts, state.links, self.cable.link_length, hessian)
        return hessian

    def constraint(self, angles: Array) -> tuple[Array, Array]:
        """What fixed links are off by, shape (3 E,), and its derivative, shape (3 E, N)."""
        state = self.evaluated(angles)
        return state.constraint, state.jacobian
