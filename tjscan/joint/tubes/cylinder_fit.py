"""A cylinder fitted to points: from normals, from far away, and on those that truly lie on it."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.optimize import least_squares

from tjscan.core.errors import TubesNotFound
from tjscan.core.frames import Array
from tjscan.core.robust import mad_sigma, tukey_root_weights
from tjscan.joint.tubes.cylinder import Cylinder, perpendicular_pair

START: Final = 3e-3
"""Metres from a rough cylinder within which its points are sought at first."""

FLOOR: Final = 10e-6
"""Metres; points are never taken for more certain than this."""

REACH: Final = 6.0
"""Standard deviations within which the spread is estimated anew."""

MOST_ROUNDS: Final = 100
STILL: Final = 1e-8
"""Metres and radians that no number moves by any more in the end."""

LEAST_TURN: Final = 0.05
"""Least singular value, as a share of the largest, by which normals fix an axis: about 10° round
the tube."""

FEWEST: Final = 12
"""Points that a cylinder is fitted to."""


def cylinder_from_normals(points: Array, normals: Array) -> Cylinder:
    """Rough cylinder of points and normals, to start a fit from.

    The axis is what all normals are square to; seen along it, ``p = centre + radius n`` is
    linear in the rest.

    Parameters
    ----------
    points, normals : ndarray, shape (n, 3)
        On the wall, and outward there; n is 3 or more.

    Raises
    ------
    TubesNotFound
        If the normals turn too little to fix an axis.
    """
    if len(points) < 3:
        raise TubesNotFound(f"{len(points)} places on a wall are too few for a cylinder")
    _, spread, rows = np.linalg.svd(normals, full_matrices=False)
    if spread[1] < LEAST_TURN * spread[0]:
        raise TubesNotFound(
            "the wall was seen over too little of its circumference to show where its axis lies: "
            "scan farther round"
        )
    axis = rows[2]
    plane = perpendicular_pair(axis)
    p, n = points @ plane.T, normals @ plane.T
    system = np.concatenate(
        [np.column_stack((np.tile(np.eye(2)[k], (len(p), 1)), n[:, k])) for k in (0, 1)]
    )
    (*centre, radius), *_ = np.linalg.lstsq(system, p.T.ravel(), rcond=None)
    if radius < 0:  # the normals pointed inwards
        radius = -radius
    return Cylinder(np.array(centre) @ plane, axis, float(radius)).recentred_beside(points)


def fit_cylinder(start: Cylinder, points: Array, scale: float) -> tuple[Cylinder, bool]:
    """Fit a cylinder by least squares with Cauchy's loss, which converges from far away.

    Parameters
    ----------
    start : Cylinder
        Right to some centimetres.
    points : ndarray, shape (n, 3)
        Most of them on the wall, metres.
    scale : float
        Distance from the cylinder beyond which points lose weight, metres.

    Returns
    -------
    cylinder : Cylinder
        The fit; `start` where there are too few points.
    converged : bool
        Whether the points hold it.
    """
    if len(points) < FEWEST:
        return start, False
    tube = start.recentred_beside(points)

    def distance(step: Array) -> Array:
        return tube.boxplus(step).signed_distances(points)

    def jacobian(step: Array) -> Array:
        return tube.boxplus(step).jacobian(points)

    found = least_squares(
        distance,
        np.zeros(5),
        jac=jacobian,
        loss="cauchy",
        f_scale=scale,
        x_scale=(0.1, 0.1, 1.0, 1.0, 0.1),
        max_nfev=40,
    )
    return tube.boxplus(found.x).recentred_beside(points), bool(found.success)


def refine_cylinder(tube: Cylinder, points: Array) -> Cylinder:
    """Refine a cylinder by least squares with Tukey's kernel.

    However the search began, it ends at the same cylinder: a wall holds far more points than
    ghosts and corners bring near it.

    Parameters
    ----------
    tube : Cylinder
        Right to a few millimetres.
    points : ndarray, shape (n, 3)
        Of the wall and of anything else, metres.
    """
    reach = START
    for _ in range(MOST_ROUNDS):
        off = tube.signed_distances(points)
        near = np.abs(off) < reach
        if near.sum() <= 5:
            return tube
        sigma = max(mad_sigma(off[near]), FLOOR)
        root = np.where(near, tukey_root_weights(off / sigma), 0.0)
        jacobian = tube.jacobian(points)
        solved, *_ = np.linalg.lstsq(root[:, None] * jacobian, -root * off)
        step = np.asarray(solved, dtype=float)
        tube = tube.boxplus(step)
        if np.abs(step).max() < STILL:
            break
        reach = REACH * sigma
    return tube.recentred_beside(points[near])
