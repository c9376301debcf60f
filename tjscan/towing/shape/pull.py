"""With what force the cable pulls at the welder, and what it costs to let it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.chain import chain_hessian, make_parts, place_links, turned_way
from tjscan.towing.shape.compiled import compiled
from tjscan.towing.shape.estimate import (
    LEAST_SHIFT,
    CableEstimate,
    EstimateArrays,
    estimate_arrays,
    estimate_terms,
)
from tjscan.towing.shape.linear import back_substitute, factorise_convex
from tjscan.towing.shape.settings import PoseTrust

RELIEF_TIME: Final = 0.2
"""Seconds over which the vehicle gives way to the whole of the force. Quicker, and it would go
after the noise of its pose; slower, and friction builds the force up again."""

RELIEF_SPEED: Final = 2e-3
"""m/s with which it does so at most."""

PLACE_ERROR: Final = 1e-3
"""Metres within which vehicles are where they are sent: no force is relieved better than that."""

PULL_TERM: Final = 4
"""Which term of the objective it is."""


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

    def moved(self, way: Array) -> CablePull:
        """The same, once the welder has gone on by a way, metres, shape (2,)."""
        return replace(self, place=self.place + way)

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
            A row of what `problem.shape_terms` takes.
        """
        force, stiffness = self.force, self.stiffness
        doubt = max(self.doubt, PLACE_ERROR)
        counts = np.linalg.inv(target**2 * np.eye(2) + doubt**2 * stiffness @ stiffness.T)
        root = np.sqrt(1 + force @ counts @ force)
        by_force = 2 * weight / root * stiffness.T @ counts
        gradient = by_force @ force
        hessian = max(1.0, RELIEF_TIME / period) * by_force @ stiffness
        at = 2 * weight * (root - 1)
        # However soft the cable is there, the vehicle gives way slowly; also where the force goes
        # through zero, as it is known no better than the errors of the poses allow.
        doubted = min(self.doubt * float(np.linalg.norm(stiffness, 2)), target)
        slope = np.hypot(np.hypot(*gradient), doubted * np.linalg.norm(by_force, 2))
        hessian += slope / (RELIEF_SPEED * period) * np.eye(2)
        second = (hessian[0, 0], hessian[0, 1], hessian[1, 1])
        return np.array((PULL_TERM, *self.place, at, *gradient, *second))


def pull_on_welder(
    cable: Cable, held_links: Sequence[int], lies: CableEstimate, poses: Array, trust: PoseTrust
) -> CablePull | None:
    """The cable's pull at the welder; None if its pose or that of the vehicle before is unknown.

    The force is what holds the last of the estimated links at its pose, so that of bends and
    friction together.
    """
    if len(held_links) < 2 or not np.isfinite(poses[-2:]).all():
        return None
    problem = estimate_arrays(cable, held_links, poses, trust, lies)
    stiffness = cable.bending_stiffness * _force_by_place(lies.angles, problem)
    places = cable.poses(lies.angles)[:, :2]
    force = cable.bending_stiffness / trust.position_sd**2 * (places[-1] - poses[-1, :2])
    link = held_links[-2]
    return CablePull(force, stiffness, link, places[link], trust.position_sd)


@compiled
def _force_by_place(angles: Array, problem: EstimateArrays) -> Array:
    """Derivative of the last held link's force by the place of the one before, (2, 2), over k."""
    n, last, root = len(angles), len(problem.held) - 1, problem.root
    links, parts, stiff = np.empty((n, 5)), make_parts(n), problem.stiff
    hessian, factor = np.empty((n, n)), np.zeros((n, n))
    place_links(angles, root, problem.length, links)
    estimate_terms(angles, problem, links, parts)
    chain_hessian(parts, links, problem.length, hessian)
    factorise_convex(hessian, 0.0, factor, LEAST_SHIFT)
    derivative, change = np.zeros((2, 2)), np.empty(n)
    before, tip = problem.held[last - 1], problem.held[last]
    for axis in range(2):
        for i in range(n):
            way = turned_way(i, before, links, root)
            change[i] = stiff[last - 1, 0] * way[axis]
        back_substitute(factor, change)
        for i in range(n):
            way = turned_way(i, tip, links, root)
            derivative[0, axis] += stiff[last, 0] * way[0] * change[i]
            derivative[1, axis] += stiff[last, 0] * way[1] * change[i]
    return derivative
