"""With what force the cable pulls at the welder, and what it costs to let it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.chain import chain_hessian, place_links, turned_way
from tjscan.towing.shape.compiled import Indices, compiled
from tjscan.towing.shape.estimate import (
    LEAST_SHIFT,
    CableEstimate,
    PoseTrust,
    estimate_terms,
    friction_at_ends,
)
from tjscan.towing.shape.linear import back_substitute, factorise_convex

RELIEF: Final = 0.2
"""Seconds over which the vehicle gives way to the whole of the force. Quicker, and it would go
after the noise of its pose; slower, and friction builds the force up again."""

GIVES_WAY: Final = 2e-3
"""m/s with which it does so at most."""

PLACED: Final = 1e-3
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
        doubt = max(self.doubt, PLACED)
        counts = np.linalg.inv(target**2 * np.eye(2) + doubt**2 * stiffness @ stiffness.T)
        root = np.sqrt(1 + force @ counts @ force)
        by_force = 2 * weight / root * stiffness.T @ counts
        gradient = by_force @ force
        hessian = max(1.0, RELIEF / period) * by_force @ stiffness
        at = 2 * weight * (root - 1)
        # However soft the cable is there, the vehicle gives way slowly; also where the force goes
        # through zero, for nobody knows it better than an error of the poses leaves it.
        doubted = min(self.doubt * float(np.linalg.norm(stiffness, 2)), target)
        slope = np.hypot(np.hypot(*gradient), doubted * np.linalg.norm(by_force, 2))
        hessian += slope / (GIVES_WAY * period) * np.eye(2)
        second = (hessian[0, 0], hessian[0, 1], hessian[1, 1])
        return np.array((PULL_TERM, *self.place, at, *gradient, *second))


def pull_on_welder(
    cable: Cable, held_links: Sequence[int], lies: CableEstimate, poses: Array, trust: PoseTrust
) -> CablePull | None:
    """The cable's pull at the welder; None where its pose or that of the vehicle before is unknown.

    The force is what holds the last of the estimated links at its pose, so that of bends and
    friction together.
    """
    if len(held_links) < 2 or not np.isfinite(poses[-2:]).all():
        return None
    known = np.isfinite(poses).all(axis=1)
    held = np.array(held_links, dtype=np.int64)[known]
    stiffness = cable.bending_stiffness * _yielding(
        lies.angles,
        np.array(cable.root, dtype=float),
        cable.link_length,
        held,
        np.array(poses[known], dtype=float),
        np.tile(trust.stiffness, (len(held), 1)),
        lies.rest,
        friction_at_ends(cable, held_links),
    )
    places = cable.poses(lies.angles)[:, :2]
    force = cable.bending_stiffness / trust.position_sd**2 * (places[-1] - poses[-1, :2])
    link = held_links[-2]
    return CablePull(force, stiffness, link, places[link], trust.position_sd)


@compiled
def _yielding(
    angles: Array,
    root: Array,
    length: float,
    held: Indices,
    poses: Array,
    stiff: Array,
    rest: Array,
    slide: Array,
) -> Array:
    """Derivative of the last held link's force by the place of the one before, (2, 2), over k."""
    n, last = len(angles), len(held) - 1
    links = np.empty((n, 5))
    joint, point, turn = np.empty((n, 2)), np.empty((n, 5)), np.empty((n, 2))
    hessian, factor = np.empty((n, n)), np.zeros((n, n))
    place_links(angles, root, length, links)
    estimate_terms(angles, links, held, poses, stiff, rest, slide, joint, point, turn)
    chain_hessian(joint, point, turn, links, length, hessian)
    factorise_convex(hessian, 0.0, factor, LEAST_SHIFT)
    yields, change = np.zeros((2, 2)), np.empty(n)
    before, tip = held[last - 1], held[last]
    for axis in range(2):
        for i in range(n):
            way = turned_way(i, before, links, root)
            change[i] = stiff[last - 1, 0] * way[axis]
        back_substitute(factor, change)
        for i in range(n):
            way = turned_way(i, tip, links, root)
            yields[0, axis] += stiff[last, 0] * way[0] * change[i]
            yields[1, axis] += stiff[last, 0] * way[1] * change[i]
    return yields
