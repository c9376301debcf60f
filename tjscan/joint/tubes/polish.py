"""A cylinder settled on the points that truly lie on it."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.joint.tubes.cylinder import Cylinder

START: Final = 3e-3
"""Metres from a rough cylinder within which its points are sought at first."""

FLOOR: Final = 10e-6
"""Metres; points are never taken for more certain than this."""

TUKEY: Final = 4.685
"""Standard deviations at which Tukey's kernel no longer listens: 95 % efficient on clean data."""

REACH: Final = 6.0
"""Standard deviations within which the spread is judged anew."""

MOST_ROUNDS: Final = 100
STILL: Final = 1e-8
"""Metres and radians that no number moves by any more in the end."""


def polished(tube: Cylinder, points: Array) -> Cylinder:
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
        sigma = max(1.4826 * float(np.median(np.abs(off[near]))), FLOOR)
        u = np.minimum(np.abs(off) / (TUKEY * sigma), 1.0)
        root = np.where(near, 1 - u * u, 0.0)  # of the kernel's weight
        jacobian = tube.jacobian(points)
        solved, *_ = np.linalg.lstsq(root[:, None] * jacobian, -root * off)
        step = np.asarray(solved, dtype=float)
        tube = tube.stepped(step)
        if np.abs(step).max() < STILL:
            break
        reach = REACH * sigma
    return tube.beside(points[near])
