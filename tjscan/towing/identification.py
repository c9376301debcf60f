"""Stiffness, set and drag of the cable, from a tow whose drives report how hard they push."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.towing.following import wrap_angle
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.estimate import CableEstimate, HeldCable
from tjscan.towing.shape.plan import PoseAccuracy
from tjscan.towing.tables import IdentifiedCable

BLOCK_CYCLES: Final = 20
"""Cycles, 2 s of them, whose mean forces are compared: noise of poses is shorter than that."""

SKIPPED_BLOCKS: Final = 5
"""First blocks that are not compared: it is not known how the floor held the cable at first."""

CLUSTER_BLOCKS: Final = 5
"""Blocks, 10 s of them, whose errors count as one: a model that is wrong is wrong for as long."""

FEWEST_CLUSTERS: Final = 5
"""From which uncertainties can be found."""

FORCE_SCALE: Final = 1.0
"""Newton from which on an error counts by its amount, not its square: a nearly taut piece makes
large forces of small errors of poses."""

DERIVATIVE_STEP: Final = 0.02
"""Of logarithms: no smaller, as friction jumps where links begin to slide."""


def identify_cable(
    cable: Cable,
    held_links: Sequence[int],
    poses: Array,
    pushes: Array,
    first: Array,
    trust: PoseAccuracy,
) -> IdentifiedCable:
    """Find what cable pulls at the vehicles as their drives report.

    The shape is estimated along the whole tow, with the floor's friction as it builds up, and its
    forces on the vehicles are fitted to the pushes: robust least squares, whose covariance allows
    for errors that last 10 s, and for those of a vehicle that last the whole tow: of a model that
    is wrong there, and of a floor that held the cable at first (Cameron, Gelbach and Miller, Robust
    inference with multiway clustering, 2011; what both have in common is counted twice). A gain
    that the drives' reports have in common scales stiffness and drag alike.

    An even set changes neither shape nor forces of a cable whose ends are held at a heading: the
    integral of its bends is what the headings differ by. It changes the moment at the tip, k times
    its angle in a joint, and is found from that; no better than the stiffness is known.

    Parameters
    ----------
    cable : Cable
        As it is thought to be.
    held_links : sequence of int
    poses : ndarray, shape (cycles, vehicles, 3)
        As estimated; x, y, metres, heading, radians.
    pushes : ndarray, shape (cycles, vehicles, 3)
        Forces along x and y, newton, and moments, N m, of the wheels; NaN where they are not known.
    first : ndarray, shape (N,)
        Angles of the shape at the first cycle, radians.
    trust : PoseAccuracy

    Raises
    ------
    ConfigurationError
        If the tow is too short, or its drives reported no push.
    """
    from scipy.optimize import least_squares

    kept = len(poses) // BLOCK_CYCLES * BLOCK_CYCLES
    measured = pushes[:kept, :, :2].reshape(-1, BLOCK_CYCLES, len(held_links), 2).mean(axis=1)
    known = np.isfinite(measured)
    known[:SKIPPED_BLOCKS] = False
    clusters = -(-(len(measured) - SKIPPED_BLOCKS) // CLUSTER_BLOCKS)
    if not known.any() or clusters < FEWEST_CLUSTERS:
        least = 0.1 * BLOCK_CYCLES * (SKIPPED_BLOCKS + (FEWEST_CLUSTERS - 1) * CLUSTER_BLOCKS)
        raise ConfigurationError(
            f"does not show what cable it was: it takes more than {least:.0f} s of a tow whose "
            "vehicles report the push of their wheels"
        )

    def tow(values: Array) -> tuple[Array, Array]:
        """Forces on the vehicles, and moments on the last, of a cable without a set."""
        stiffer, slower = np.exp(values - 1.0)  # a relative step needs a value
        guess = replace(
            cable,
            bending_stiffness=cable.bending_stiffness * stiffer,
            friction=cable.friction * slower,
            rest_angle=0.0,
        )
        lies = CableEstimate.without_floor_pull(guess, first)
        forces, off = np.empty((kept, len(held_links), 2)), np.empty(kept)
        for k, each in enumerate(poses[:kept]):
            held = HeldCable(guess, held_links, each, trust)
            lies = held.estimate(lies)
            forces[k], _ = held.forces(lies)
            off[k] = wrap_angle(guess.headings(lies.angles)[-1] - each[-1, 2])
        return forces, guess.bending_stiffness / trust.heading_sd**2 * off

    def errors(values: Array) -> Array:
        mean = tow(values)[0].reshape(-1, BLOCK_CYCLES, len(held_links), 2).mean(axis=1)
        return np.asarray((mean + measured)[known])

    found = least_squares(
        errors,
        np.ones(2),
        diff_step=(DERIVATIVE_STEP, DERIVATIVE_STEP),
        loss="soft_l1",
        f_scale=FORCE_SCALE,
        xtol=1e-3,
        ftol=1e-4,
        max_nfev=15,
    )
    jacobian, of_block, of_vehicle = np.asarray(found.jac), *np.indices(known.shape)[:2, known]
    spread, meat = np.linalg.inv(jacobian.T @ jacobian), np.zeros((2, 2))
    for group in ((of_block - SKIPPED_BLOCKS) // CLUSTER_BLOCKS, of_vehicle):
        each = [found.fun[group == k] @ jacobian[group == k] for k in np.unique(group)]
        meat += np.transpose(each) @ each * len(each) / max(len(each) - 1, 1)
    sd = np.sqrt(np.diag(spread @ meat @ spread))
    known_as = cable.bending_stiffness * cable.link_length, cable.friction / cable.link_length
    stiffness, drag = np.exp(found.x - 1.0) * known_as
    bends = -(pushes[:kept, -1, 2] + tow(found.x)[1]) / stiffness
    bends = bends[SKIPPED_BLOCKS * BLOCK_CYCLES :]
    parts = [each.mean() for each in np.array_split(bends[np.isfinite(bends)], clusters)]
    by_stiffness = np.nanmean(pushes[:kept, -1, 2]) / stiffness * sd[0]
    return IdentifiedCable(
        stiffness=float(stiffness),
        stiffness_sd=float(stiffness * sd[0]),
        drag=float(drag),
        drag_sd=float(drag * sd[1]),
        curvature=float(np.mean(parts)),
        curvature_sd=float(np.hypot(np.std(parts, ddof=1) / np.sqrt(clusters), by_stiffness)),
    )
