"""The objective (5) of Suzuki et al. (2022): terms and derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, sqrt
from typing import Any

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.area import Obstacles
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.chain import chain_gradient, chain_hessian, place_links, pose_constraints
from tjscan.towing.shape.compiled import Indices, compiled
from tjscan.towing.shape.distance import distance_to_obstacle
from tjscan.towing.shape.effort import free_share, rising_loss
from tjscan.towing.shape.plan import PlanTerms
from tjscan.towing.shape.pull import CablePull
from tjscan.towing.shape.weights import EffortTargets, TowingWeights

SMOOTH_CHANGE = 0.02
"""Radians within which |θ - θ_init| is rounded: it has a kink where the planner starts."""

PACE_TERM = 3
"""Which term the vehicles' steps are."""

FAR = 10.0
"""Times the target distance, beyond which an obstacle's loss is below 1e-7 and left out."""


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
        if d > FAR * target:
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


@compiled
def shape_terms(
    angles: Array,
    estimate: Array,
    links: Array,
    scale: Array,
    targets: Array,
    moved: Indices,
    costs: Array,
    walls: Array,
    corners: Array,
    starts: Indices,
    discs: Array,
    terms: Array,
    joint: Array,
    point: Array,
) -> float:
    """The objective at a shape, its terms, and what each joint and each link contributes.

    Parameters
    ----------
    angles, estimate : ndarray, shape (N,)
    links : ndarray, shape (N, 5)
        As `place_links` fills it.
    scale : ndarray, shape (3,)
        Weights of bend, obstacle and change, over N.
    targets : ndarray, shape (3,)
        Of bend (squared), distance and change.
    moved : ndarray of int, shape (Q,)
        Links whose positions cost something by themselves, see `costs`, shape (Q, 9): the term
        that it counts for, x and y of a place, the cost there, its gradient and its Hessian.
    walls, corners, starts, discs : ndarray
        Obstacles, see `area.Obstacles`.
    terms, joint, point : ndarray, shapes (5,), (N, 2), (N, 5)
        Filled: terms; first and second derivative by each angle; gradient and Hessian by each
        position.
    """
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
    weights : TowingWeights
    targets : EffortTargets
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
    weights: TowingWeights
    targets: EffortTargets
    estimate: Array
    fixed: Indices
    fixed_poses: Array
    paced: Indices
    pace_from: Array
    period: float
    pull: CablePull | None = None

    @property
    def root(self) -> Array:
        """Of the cable, x, y and heading."""
        return np.array(self.cable.root, dtype=float)

    @property
    def scale(self) -> Array:
        """Weights over the number of links, as `shape_terms` takes them."""
        w = self.weights
        return np.array((w.bend, w.obstacle, w.change)) / self.cable.links

    @property
    def costs(self) -> tuple[Indices, Array]:
        """What the vehicles' steps and the pull at the welder cost, see `shape_terms`."""
        w, links = self.weights, self.cable.links
        steps = np.zeros((len(self.paced), 9))
        steps[:, 0], steps[:, 1:3] = PACE_TERM, self.pace_from
        steps[:, 6] = steps[:, 8] = 2 * w.pace / (self.period * links)
        if self.pull is None:
            return self.paced, steps
        pull = self.pull.cost(w.pull / links, self.targets.pull, self.period)
        return np.append(self.paced, self.pull.link), np.vstack((steps, pull))

    @property
    def inflections(self) -> Array:
        """Effort targets, as `shape_terms` takes them."""
        return np.array((self.targets.bend**2, self.targets.distance, self.targets.change))

    @property
    def arguments(self) -> Any:
        """What `newton_shape` takes from the estimate on."""
        return (
            self.estimate, self.root, self.cable.link_length, self.scale, self.inflections,
            *self.costs, *self.obstacles.arrays, self.fixed, self.fixed_poses,
        )  # fmt: skip

    def links(self, angles: Array) -> Array:
        """As `place_links` fills them, shape (N, 5)."""
        links = np.empty((len(angles), 5))
        place_links(angles, self.root, self.cable.link_length, links)
        return links

    def contributions(self, angles: Array) -> tuple[PlanTerms, Array, Array]:
        """Terms, and what joints and links contribute to derivatives, see `shape_terms`."""
        terms, joint, point = np.empty(5), np.empty((len(angles), 2)), np.empty((len(angles), 5))
        moved, costs = self.costs
        shape_terms(
            angles, self.estimate, self.links(angles), self.scale, self.inflections,
            moved, costs, *self.obstacles.arrays, terms, joint, point,
        )  # fmt: skip
        return PlanTerms(*terms.tolist()), joint, point

    def terms(self, angles: Array) -> PlanTerms:
        """The objective's terms."""
        return self.contributions(angles)[0]

    def gradient(self, angles: Array) -> Array:
        """Of the objective, shape (N,)."""
        _, joint, point = self.contributions(angles)
        out = np.empty(len(angles))
        turn = np.zeros((len(angles), 2))
        chain_gradient(joint, point, turn, self.links(angles), self.cable.link_length, out)
        return out

    def hessian(self, angles: Array, multipliers: Array | None = None) -> Array:
        """Of the objective, shape (N, N), or of the Lagrangian with the constraints' multipliers.

        Parameters
        ----------
        angles : ndarray, shape (N,)
        multipliers : ndarray, shape (3 E,), optional
        """
        _, joint, point = self.contributions(angles)
        if multipliers is not None:
            for link, forces in zip(self.fixed, multipliers.reshape(-1, 3), strict=True):
                point[link, :2] += forces[:2]
        out = np.empty((len(angles), len(angles)))
        turn = np.zeros((len(angles), 2))
        chain_hessian(joint, point, turn, self.links(angles), self.cable.link_length, out)
        return out

    def constraint(self, angles: Array) -> tuple[Array, Array]:
        """What fixed links are off by, shape (3 E,), and its derivative, shape (3 E, N)."""
        c, rows = np.zeros(3 * len(self.fixed)), np.zeros((3 * len(self.fixed), len(angles)))
        pose_constraints(self.links(angles), self.root, self.fixed, self.fixed_poses, c, rows)
        return c, rows
