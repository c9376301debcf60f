"""An arm whose joints deviate: its geometry error, and profiles that it took of targets."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.linalg import block_diag

from tjscan.calibration.solve.combined import StackedResiduals, stack_residuals
from tjscan.calibration.targets.target import TargetModel
from tjscan.core.frames import Array, frozen_arrays, inverse_pose, skew_matrix
from tjscan.robot.deviations import deviation_jacobian, with_deviations
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance

DRAWN_POSTURES: Final = 100
"""Drawn postures over which an arm's geometry error has the size that is stated."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class TargetInPostures:
    """A target and the profiles of it, with the arm's postures.

    Parameters
    ----------
    model : TargetModel
        Of n profiles.
    q : ndarray, shape (n, joints)
        Joint angles at each, radians.
    T_b_f : ndarray, shape (n, 4, 4)
        Flange pose at each, as the arm read it.
    start : ndarray, shape (m,)
        Approximate parameters of the target.
    """

    model: TargetModel
    q: Array
    T_b_f: Array
    start: Array


@dataclass(frozen=True, eq=False)
class ArmModel:
    """Residuals of profiles that an arm took, by its deviations, T_f_s and targets.

    The true flange pose is the one that the arm reads, and a motion further: from the model's
    flange pose at these joint angles to that of the model with deviations. So a controller may
    read poses with a calibration of its own.

    Parameters
    ----------
    kinematics : Kinematics
        The arm without deviations.
    targets : tuple of SeenTarget
        What was seen.
    """

    kinematics: Kinematics
    targets: tuple[TargetInPostures, ...]

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.kinematics.lower)

    @cached_property
    def profiles(self) -> int:
        """Number of profiles."""
        return sum(len(seen.q) for seen in self.targets)

    @cached_property
    def start(self) -> Array:
        """Parameters of all targets to start from, shape (m,)."""
        return np.concatenate([seen.start for seen in self.targets])

    @cached_property
    def _flange_motions(self) -> list[tuple[Array, Array]]:
        """Motions of the flange beside the model's, for each target of n profiles.

        From the model's flange pose to the one that the arm reads, frame b, shape (n, 4, 4); and
        by the deviations, in the axes of f, shape (n, 6, 6 joints).
        """
        forward = self.kinematics.forward
        return [
            (
                np.array([T @ inverse_pose(forward(q)) for q, T in zip(s.q, s.T_b_f, strict=True)]),
                np.array([deviation_jacobian(self.kinematics, q).reshape(6, -1) for q in s.q]),
            )
            for s in self.targets
        ]

    def linearise(self, T_f_s: Array, deviations: Array, target: Array) -> StackedResiduals:
        """Residuals at a guess, with derivatives and covariance.

        The derivative is by a step of T_f_s, by the deviations, and by the targets' parameters.

        Parameters
        ----------
        T_f_s : ndarray, shape (4, 4)
            The sensor on the flange.
        deviations : ndarray, shape (joints, 6)
            See `with_deviations`.
        target : ndarray, shape (m,)
            The targets' parameters, one after the other.

        Notes
        -----
        The derivative by deviations is that without any: deviations are some 1e-4, and so is its
        relative error.
        """
        arm = with_deviations(self.kinematics, deviations)
        own_targets = np.split(target, np.cumsum([len(s.start) for s in self.targets])[:-1])
        parts = []
        for seen, own, (E, J) in zip(self.targets, own_targets, self._flange_motions, strict=True):
            T_b_f = E @ np.array([arm.forward(q) for q in seen.q])
            found = seen.model.seen_from(T_b_f).linearise(T_f_s, own)
            by_flange = found.by_pose.copy()
            # A turn of the flange also carries the sensor, whose origin is not that of f.
            by_flange[:, :, 3:] -= found.by_pose[:, :, :3] @ skew_matrix(T_f_s[:3, 3])
            by_pose = np.concatenate((found.by_pose, by_flange @ J), axis=2)
            parts.append(replace(found, by_pose=by_pose))
        return stack_residuals(parts)


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
        moved = np.array([self._motions_in_flange(q)[:3] for q in drawn])
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
        return np.asarray(block_diag(R_b_f, R_b_f) @ self._motions_in_flange(q) / self._size)

    def _motions_in_flange(self, q: Array) -> Array:
        by_deviations = deviation_jacobian(self.kinematics, q) * self.tolerance.sigmas
        return by_deviations.reshape(6, -1)
