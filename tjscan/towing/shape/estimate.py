"""The cable's shape now, from the vehicles' poses: the shape of least energy; and its pull there.

Suzuki et al. (2022), IV-C, take the poses for exact, (1)-(4). Noise or slip then stretch the cable
between two vehicles beyond its length, and no shape fits: here poses are known to a standard
deviation. The paper leaves the floor out; here friction holds the links, so that the cable keeps
what it was bent to on its way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians, sqrt
from typing import Final, NamedTuple

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape import chain
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.chain import ChainDerivatives, place_links
from tjscan.towing.shape.compiled import Indices, compiled
from tjscan.towing.shape.linear import back_substitute, back_substitute_rows, factorise_convex
from tjscan.towing.shape.plan import PoseAccuracy

PRESLIDING_DISPLACEMENT: Final = 1e-3
"""Metres by which a link gives way before it slides. As long as this is little beside the bends of
a cable, it does not matter: from 0.2 to 2 mm estimates are the same."""

LEAST_HESSIAN_SHIFT: Final = 0.1
"""Share of a joint's stiffness that is added first if the energy is not convex. Poses are held
1e8 times as stiffly as joints: a share of that would freeze the shape, and end the search."""

MOST_ITERATIONS: Final = 60
"""Of a search at most; fewer than ten are usual."""

PULL_RELIEF_TIME: Final = 0.2
"""Seconds over which the vehicle gives way to the whole of the force. Quicker, and it would go
after the noise of its pose; slower, and friction builds the force up again."""

PULL_RELIEF_SPEED: Final = 2e-3
"""m/s with which it does so at most."""

VEHICLE_PLACE_ERROR: Final = 1e-3
"""Metres within which vehicles are where they are sent: no force is relieved better than that."""

BEND_DEVIATIONS: Final = 2.0
"""Standard deviations that an angle plus its doubt may come to the joints' limit at most."""

LEAST_ANGLE_DEVIATION: Final = radians(0.4)
"""Radians by which an estimated angle is doubted at least. It is the largest with which no sound
tow that was tried is stopped; on cables three times as stiff or soft, and on floors of half or one
and a half times the friction, angles were off by up to 0.7° beyond two deviations."""

PULL_TERM_INDEX: Final = 4
"""Which term of the objective it is."""


class EstimateArrays(NamedTuple):
    """The problem of least energy, as compiled functions take it.

    Parameters
    ----------
    root : ndarray, shape (3,)
    length : float
        Of a link, metres.
    held : ndarray of int, shape (M,)
        Links whose poses, shape (M, 3), are known.
    poses : ndarray, shape (M, 3)
    stiff : ndarray, shape (M, 2)
        One over the variance of each position, and of each heading.
    rest : ndarray, shape (N, 2)
        Towards which the floor holds the links' far ends: with a force that grows until they slide.
    slide : ndarray, shape (N,)
        Friction there over the stiffness of a joint, 1/m; 0 without.
    rest_angle : float
        Of a joint that nothing bends, radians.
    """

    root: Array
    length: float
    held: Indices
    poses: Array
    stiff: Array
    rest: Array
    slide: Array
    rest_angle: float


@compiled
def cable_energy(
    angles: Array, problem: EstimateArrays, links: Array, parts: ChainDerivatives
) -> float:
    """Energy of the cable over the stiffness of a joint, and the parts of each joint and link.

    Parameters
    ----------
    angles : ndarray, shape (N,)
    problem : EstimateArrays
    links : ndarray, shape (N, 5)
        As `place_links` fills it.
    parts : ChainDerivatives
        Filled.
    """
    joint, point, turn = parts
    held, poses, rest, slide = problem.held, problem.poses, problem.rest, problem.slide
    energy = 0.0
    for i in range(len(angles)):
        bend = angles[i] - problem.rest_angle
        energy += 0.5 * bend * bend
        joint[i, 0], joint[i, 1] = bend, 1.0
        turn[i, 0], turn[i, 1] = 0.0, 0.0
        point[i, :] = 0.0
        if slide[i] > 0.0:
            x, y = links[i, 0] - rest[i, 0], links[i, 1] - rest[i, 1]
            d = sqrt(x * x + y * y)
            slides = d > (1.0 + 1e-9) * PRESLIDING_DISPLACEMENT  # one that slid is held there again
            pull = slide[i] / max(d, PRESLIDING_DISPLACEMENT)
            energy += slide[i] * (
                d - 0.5 * PRESLIDING_DISPLACEMENT
                if slides
                else 0.5 * d * d / PRESLIDING_DISPLACEMENT
            )
            point[i, 0], point[i, 1] = pull * x, pull * y
            point[i, 2], point[i, 4] = pull, pull
            if slides:
                point[i, 2] -= pull * (x / d) ** 2
                point[i, 3] -= pull * (x / d) * (y / d)
                point[i, 4] -= pull * (y / d) ** 2
    for m in range(len(held)):
        k = held[m]
        x, y = links[k, 0] - poses[m, 0], links[k, 1] - poses[m, 1]
        a = chain.angle_within_pi(links[k, 2] - poses[m, 2])
        by_place, by_turn = problem.stiff[m, 0], problem.stiff[m, 1]
        energy += 0.5 * by_place * (x * x + y * y) + 0.5 * by_turn * a * a
        point[k, 0] += by_place * x
        point[k, 1] += by_place * y
        point[k, 2] += by_place
        point[k, 4] += by_place
        turn[k, 0], turn[k, 1] = by_turn * a, by_turn
    return energy


@compiled
def minimise_cable_energy(angles: Array, problem: EstimateArrays) -> None:
    """Shape of least energy near the vehicles' poses, in place."""
    n = len(angles)
    links, parts = np.empty((n, 5)), chain.new_chain_derivatives(n)
    gradient, factor = np.empty(n), np.empty((n, 6))
    place_links(angles, problem.root, problem.length, links)
    energy, shift = cable_energy(angles, problem, links, parts), 0.0
    for _ in range(MOST_ITERATIONS):
        chain.chain_gradient(parts, links, problem.length, gradient)
        shift = factorise_convex(parts, links, problem.length, shift, factor, LEAST_HESSIAN_SHIFT)
        step = -gradient
        back_substitute(factor, step)
        slope = gradient @ step
        share = min(1.0, 0.5 / max(np.abs(step).max(), 1e-300))
        for _ in range(30):
            trial = angles + share * step
            place_links(trial, problem.root, problem.length, links)
            after = cable_energy(trial, problem, links, parts)
            if after <= energy + 1e-4 * share * slope + 1e-12 * abs(energy):
                break
            share *= 0.5
        else:
            return
        angles[:], energy = trial, after
        if -slope < 1e-8 * (1.0 + energy):
            return


@dataclass(frozen=True, slots=True, eq=False)
class CableEstimate:
    """Estimated shape of the cable.

    Parameters
    ----------
    angles : ndarray, shape (N,)
        Of the joints, radians: θ_init.
    rest : ndarray, shape (N, 2)
        Towards which the floor holds the links' far ends, metres.
    """

    angles: Array
    rest: Array

    @staticmethod
    def without_floor_pull(cable: Cable, angles: Array) -> CableEstimate:
        """A cable that was laid down so: the floor does not yet pull at it."""
        return CableEstimate(angles, cable.poses(angles)[:, :2].copy())


@dataclass(frozen=True, slots=True, eq=False)
class CablePull:
    """The cable's force on the welder, and how it changes as the vehicle before it moves.

    Parameters
    ----------
    force : ndarray, shape (2,)
        Along x and y, newton.
    stiffness : ndarray, shape (2, 2)
        Its derivative by that vehicle's x and y, N/m, while no further link begins to slide.
    link : int
        That the vehicle holds.
    place : ndarray, shape (2,)
        Where it keeps the force what it is, metres.
    doubt : float
        Standard deviation of the poses, metres.
    """

    force: Array
    stiffness: Array
    link: int
    place: Array
    doubt: float

    def cost(self, weight: float, target: float, period: float) -> Array:
        """What another place of the vehicle costs, to second order, shape (9,).

        The force counts 2 w (√(1 + F' M F) - 1): as its square over that of `target`, and as its
        amount beyond. M doubts forces that an error of the poses makes by itself.

        Parameters
        ----------
        weight : float
            w.
        target : float
            Newton.
        period : float
            Seconds.

        Returns
        -------
        ndarray
            A row of the pulls that the objective of `problem` takes.
        """
        force, stiffness = self.force, self.stiffness
        doubt = max(self.doubt, VEHICLE_PLACE_ERROR)
        counts = np.linalg.inv(target**2 * np.eye(2) + doubt**2 * stiffness @ stiffness.T)
        root = np.sqrt(1 + force @ counts @ force)
        by_force = 2 * weight / root * stiffness.T @ counts
        gradient = by_force @ force
        hessian = max(1.0, PULL_RELIEF_TIME / period) * by_force @ stiffness
        at = 2 * weight * (root - 1)
        # However soft the cable is there, the vehicle gives way slowly; also where the force goes
        # through zero, as it is known no better than the errors of the poses allow.
        doubted = min(self.doubt * float(np.linalg.norm(stiffness, 2)), target)
        slope = np.hypot(np.hypot(*gradient), doubted * np.linalg.norm(by_force, 2))
        hessian += slope / (PULL_RELIEF_SPEED * period) * np.eye(2)
        second = (hessian[0, 0], hessian[0, 1], hessian[1, 1])
        return np.array((PULL_TERM_INDEX, *self.place, at, *gradient, *second))


@compiled
def _turns_by_poses(angles: Array, problem: EstimateArrays) -> tuple[Array, Array, Array]:
    """How x, y and heading of held links move with the angles of least energy, shape (3 M, N).

    And these, solved by the energy's Hessian; and the gradient of the floor's forces, likewise,
    shape (N,).
    """
    n, root, stiff, held = len(angles), problem.root, problem.stiff, problem.held
    links, parts = np.empty((n, 5)), chain.new_chain_derivatives(n)
    factor, by_floor = np.empty((n, 6)), np.empty(n)
    off, ways = np.empty(3 * len(held)), np.empty((3 * len(held), n))
    place_links(angles, root, problem.length, links)
    cable_energy(angles, problem, links, parts)
    factorise_convex(parts, links, problem.length, 0.0, factor, LEAST_HESSIAN_SHIFT)
    chain.pose_constraints(links, root, held, problem.poses, off, ways)
    for m in range(len(held)):
        # What is left of the forces without those that hold the links is the floor's.
        parts.point[held[m], 0] -= stiff[m, 0] * off[3 * m]
        parts.point[held[m], 1] -= stiff[m, 0] * off[3 * m + 1]
    parts.joint[:, 0] = 0.0
    parts.turn[:, 0] = 0.0
    chain.chain_gradient(parts, links, problem.length, by_floor)
    turns = ways.copy()
    back_substitute_rows(factor, turns)
    back_substitute(factor, by_floor)
    return ways, turns, by_floor


@dataclass(frozen=True, slots=True, eq=False)
class HeldCable:
    """A cable between vehicles at their poses: its shape, its forces, and how sure they are.

    Parameters
    ----------
    cable : Cable
    links : sequence of int
        Of the vehicles, which carry these links off the floor.
    poses : ndarray, shape (vehicles, 3)
        Of the held links: x, y, metres, and heading, radians; rows of NaN are unknown.
    trust : PoseAccuracy
    """

    cable: Cable
    links: Sequence[int]
    poses: Array
    trust: PoseAccuracy

    def estimate(self, last: CableEstimate) -> CableEstimate:
        """Shape of the cable, from the estimate before.

        The links between were moved from where they were by least work, of bends and friction: that
        is Coulomb's, for a floor that gives way by `PRESLIDING_DISPLACEMENT` first. So its holding
        force lasts from one estimate to the next, however little a link moves.
        """
        angles = last.angles.copy()
        minimise_cable_energy(angles, self._problem(last))
        places = self.cable.poses(angles)[:, :2]
        off = places - last.rest
        far = np.hypot(off[:, 0], off[:, 1])[:, None]
        held_back = off * np.minimum(1.0, PRESLIDING_DISPLACEMENT / np.maximum(far, 1e-300))
        return CableEstimate(angles, places - held_back)

    def pull_on_welder(self, now: CableEstimate, way: Array) -> CablePull | None:
        """The pull at the welder; None if its pose or that of the vehicle before is unknown.

        The force is what holds the last of the estimated links at its pose, so that of bends and
        friction together. It stays what it is if the vehicle before goes the welder's `way`,
        metres, shape (2,).
        """
        if len(self.links) < 2 or not np.isfinite(self.poses[-2:]).all():
            return None
        problem, stiffness, link = self._problem(now), self.cable.bending_stiffness, self.links[-2]
        ways, turns, _ = _turns_by_poses(now.angles, problem)
        by_place = problem.stiff[-1, 0] * problem.stiff[-2, 0]
        by_way = stiffness * by_place * ways[-3:-1] @ turns[-6:-4].T
        places = self.cable.poses(now.angles)[:, :2]
        force = stiffness / self.trust.position_sd**2 * (places[-1] - self.poses[-1, :2])
        return CablePull(force, by_way, link, places[link] + way, self.trust.position_sd)

    def angle_deviations(self, now: CableEstimate, sigmas: Array | None = None) -> Array:
        """Standard deviations of the estimated joint angles, radians, shape (N,).

        Of the poses' errors, and of a floor that holds the cable more or less, by the cable's
        `friction_doubt`, each with what it turns the joints by at the least energy; and of the
        model.

        Parameters
        ----------
        now : CableEstimate
        sigmas : ndarray, shape (vehicles, 2), optional
            As of `PlanInputs`.
        """
        problem = self._problem(now)
        _, turns, by_floor = _turns_by_poses(now.angles, problem)
        errors = 1 / np.sqrt(problem.stiff) if sigmas is None else sigmas
        weights = (problem.stiff * errors)[:, (0, 0, 1)].reshape(-1, 1)
        doubts = np.vstack((weights * turns, self.cable.friction_doubt * by_floor))
        return np.asarray(np.sqrt((doubts**2).sum(axis=0) + LEAST_ANGLE_DEVIATION**2))

    def forces(self, now: CableEstimate) -> tuple[Array, Array]:
        """Forces of the cable on the vehicles, and the tension along it.

        Quasi-static: what holds the estimated links at the vehicles' poses balances bends and
        floor.

        Returns
        -------
        forces : ndarray, shape (vehicles, 2)
            Along x and y, newton; NaN for a vehicle with an unknown pose.
        tension : ndarray, shape (N,)
            In each link, newton; negative if it is pushed together.
        """
        problem, stiffness, n = self._problem(now), self.cable.bending_stiffness, self.cable.links
        links, parts = np.empty((n, 5)), chain.new_chain_derivatives(n)
        place_links(now.angles, problem.root, problem.length, links)
        cable_energy(now.angles, problem, links, parts)
        inner = np.cumsum(parts.point[::-1, :2], axis=0)[::-1]  # of all that is beyond a link
        off = links[list(self.links), :2] - self.poses[:, :2]
        forces = stiffness / self.trust.position_sd**2 * off
        return forces, -stiffness * (inner * links[:, 3:]).sum(axis=1)

    def _problem(self, last: CableEstimate) -> EstimateArrays:
        """Of least energy, with a floor that holds the links to where they last were."""
        cable, known = self.cable, np.isfinite(self.poses).all(axis=1)
        # Half of the link on either side carries weight, unless a vehicle holds the link.
        on_floor = np.ones(cable.links + 1)
        on_floor[list(self.links)] = on_floor[-1] = 0.0
        halves = (on_floor[:-1] + on_floor[1:]) / 2
        return EstimateArrays(
            np.array(cable.root, dtype=float),
            cable.link_length,
            np.array(self.links, dtype=np.int64)[known],
            np.array(self.poses[known], dtype=float),
            np.tile((self.trust.position_sd**-2, self.trust.heading_sd**-2), (known.sum(), 1)),
            last.rest.copy(),
            halves * cable.friction / cable.bending_stiffness,
            cable.rest_angle,
        )
