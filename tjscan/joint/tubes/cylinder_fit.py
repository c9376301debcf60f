"""A cylinder settled on the points that truly lie on it."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.core.robust import mad_sigma, tukey_root_weights
from tjscan.joint.tubes.cylinder import Cylinder

START: Final = 3e-3
"""Metres from a rough cylinder within which its points are sought at first."""

FLOOR: Final = 10e-6
"""Metres; points are never taken for more certain than this."""

REACH: Final = 6.0
"""Standard deviations within which the spread is estimated anew."""

MOST_ROUNDS: Final = 100
STILL: Final = 1e-8
"""Metres and radians that no number moves by any more in the end."""


def refine_robust(tube: Cylinder, points: Array) -> Cylinder:
    """Least squares with Tukey's kernel, whose width follows the points' own spread.

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
        off = tube.distance(points)
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
    return tube.beside(points[near])
