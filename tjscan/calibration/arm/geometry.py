"""The geometry error of an arm whose model is known, in every posture."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from scipy.linalg import block_diag

from tjscan.core.frames import Array
from tjscan.robot.deviations import deviation_jacobian
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance

DRAWN_POSTURES: Final = 100
"""Drawn postures over which an arm's geometry error has the size that is stated."""


@dataclass(frozen=True, eq=False)
class ArmGeometry:
    """Geometry error of an arm whose model is known: its joints deviate from the model.

    Parameters
    ----------
    kinematics : Kinematics
        The arm.
    tolerance : PlacementTolerance
        How the deviations of a joint compare with each other; their size counts for nothing here.
    """

    kinematics: Kinematics
    tolerance: PlacementTolerance = field(default_factory=PlacementTolerance)

    @cached_property
    def _size(self) -> float:
        """RMS of the flange's position over all postures, each axis, metres."""
        rng = np.random.default_rng(0)
        drawn = rng.uniform(-np.pi, np.pi, (DRAWN_POSTURES, len(self.kinematics.lower)))
        moved = np.array([self._in_flange(q)[:3] for q in drawn])
        return float(np.sqrt(np.mean(np.sum(moved**2, axis=2))))

    def moves(self, q: Array) -> Array:
        """How the flange moves with m independent standard normal draws, shape (6, m).

        Translation, metres, and rotation about the flange's origin, radians, in the axes of b; of
        an arm whose flange is off by one metre in each axis, root mean square over all postures.

        Parameters
        ----------
        q : ndarray, shape (joints,)
            Joint angles, radians.
        """
        R_b_f = self.kinematics.forward(q)[:3, :3]
        return np.asarray(block_diag(R_b_f, R_b_f) @ self._in_flange(q) / self._size)

    def _in_flange(self, q: Array) -> Array:
        by_deviations = deviation_jacobian(self.kinematics, q) * self.tolerance.sigmas
        return by_deviations.reshape(6, -1)
