"""Points on the walls of both tubes, and what their errors have in common."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array, frozen_arrays


@dataclass(frozen=True, slots=True)
class ArmRepeatability:
    """Errors of the flange's pose that an arm reports; all points of a view share them.

    The defaults are the assumption that the simulated arm is made of (`tjscan.robot.simulated`).

    Parameters
    ----------
    position, angle : float
        Root mean square of the distance (metres) and of the angle (radians) between where the
        flange is and where the arm reports it.
    """

    position: float = 5e-5
    angle: float = 1e-4

    @property
    def covariance(self) -> Array:
        """Covariance of translation and rotation vector of the flange, shape (6, 6)."""
        return np.diag(np.repeat(np.square([self.position, self.angle]) / 3, 3))


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class WallPoints:
    """Points on the walls of brace and leg, by view, with their standard deviations.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Metres, in the frame of the arm's poses.
    on_brace : ndarray, shape (n,)
        True on the brace, False on the leg.
    sigma : ndarray, shape (n,)
        Standard deviation of each point by itself along the wall's normal, metres.
    view : ndarray, shape (n,)
        Which view each was seen in, from 0.
    pivots : ndarray, shape (m, 3)
        Where the flange stood in each of m views.
    """

    points: Array
    on_brace: NDArray[np.bool_]
    sigma: Array
    view: NDArray[np.intp]
    pivots: Array

    def __len__(self) -> int:
        return len(self.points)

    def indices_by_view(self) -> list[NDArray[np.intp]]:
        """Indices of the points of each view that has any."""
        order = np.argsort(self.view, kind="stable")
        return np.split(order, np.flatnonzero(np.diff(self.view[order])) + 1)
