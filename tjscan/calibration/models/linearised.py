"""What the refinement needs of every target: residuals, their derivatives and their errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from tjscan.calibration.noise import NoiseModel
from tjscan.core.frames import Array


@dataclass(frozen=True, slots=True, eq=False)
class LinearisedModel:
    """Residuals of n profiles at a guess of sensor and target, with derivatives and covariance.

    Parameters
    ----------
    residuals : ndarray, shape (n, k)
        Zero where everything fits.
    by_pose : ndarray, shape (n, k, 6)
        Derivative by a step of T_f_s: translation and small rotation, both in the axes of f.
    by_target : ndarray, shape (n, k, m)
        Derivative by the target's parameters.
    by_arm : ndarray, shape (n, k, 6)
        Derivative by an error of the flange's pose: translation and small rotation about the
        flange's origin, both in the axes of b.
    own_covariance : ndarray, shape (n, k, k)
        Of the residuals: what the range noise alone makes of them.
    noise : NoiseModel
        For the arm's errors.
    by_laser : ndarray, shape (n, k, m), or None
        Derivative by independent standard normal draws of the laser's deviation, the same for all
        profiles; none where nothing is stated of it.
    by_geometry : ndarray, shape (n, k, m), or None
        The same by draws of the arm's geometry, for an error of one metre, see
        `ArmGeometry.moves`; none where the arm's postures are not known.
    """

    residuals: Array
    by_pose: Array
    by_target: Array
    by_arm: Array
    own_covariance: Array
    noise: NoiseModel
    by_laser: Array | None = None
    by_geometry: Array | None = None

    @property
    def covariance(self) -> Array:
        """Of the residuals, shape (n, k, k): range noise and the arm's pose noise."""
        scaled = self.by_arm * np.repeat((self.noise.position, self.noise.rotation), 3)
        return np.asarray(self.own_covariance + scaled @ scaled.transpose(0, 2, 1))


class TargetModel(Protocol):
    """Model of the residuals that profiles of a calibration target leave."""

    @property
    def prior_information(self) -> Array:
        """Inverse covariance of the target's parameters about zero, shape (m, m)."""
        ...

    def linearise(self, T_f_s: Array, target: Array) -> LinearisedModel:
        """Residuals at a guess of sensor and target, their derivatives and covariance.

        Parameters
        ----------
        T_f_s : ndarray, shape (4, 4)
            The sensor on the flange.
        target : ndarray, shape (m,)
            The target's parameters.
        """
        ...


class MovableTargetModel(TargetModel, Protocol):
    """Model of a target's profiles that can be seen from other flange poses than were read."""

    def seen_from(self, T_b_f: Array) -> Self:
        """Return the same profiles, taken from other flange poses, shape (n, 4, 4)."""
        ...
