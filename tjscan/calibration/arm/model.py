"""Profiles of targets seen by an arm whose joints deviate: residuals and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from tjscan.calibration.models.linearised import MovableTargetModel
from tjscan.core.frames import Array, frozen_arrays, inverse_pose, skew_matrix
from tjscan.robot.deviations import deviation_jacobian, with_deviations
from tjscan.robot.kinematics import Kinematics


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class SeenTarget:
    """A target and the profiles of it.

    Parameters
    ----------
    model : MovableTargetModel
        Of n profiles.
    q : ndarray, shape (n, joints)
        Joint angles at each, radians.
    T_b_f : ndarray, shape (n, 4, 4)
        Flange pose at each, as the arm read it.
    start : ndarray, shape (m,)
        About what the target's parameters are.
    """

    model: MovableTargetModel
    q: Array
    T_b_f: Array
    start: Array


@dataclass(frozen=True, slots=True, eq=False)
class StackedProfiles:
    """Residuals of all profiles of all targets, with derivatives, each over its own errors.

    Parameters
    ----------
    residuals : ndarray, shape (N,)
        In metres and radians.
    jacobian : ndarray, shape (N, 6 + 6 joints + m)
        By a step of T_f_s (axes of f), the joints' deviations, and the targets' parameters.
    covariance : ndarray, shape (N, N)
        Of range noise, of what the arm does not repeat, each profile's own, and of what the laser
        deviates by in all of them.
    profile : ndarray of int, shape (N,)
        To which profile each residual belongs.
    is_length : ndarray of bool, shape (N,)
        Whether it is a length.
    by_laser : ndarray, shape (N, m), or None
        Derivative by draws of the laser's deviation, which the covariance holds.
    """

    residuals: Array
    jacobian: Array
    covariance: Array
    profile: NDArray[np.intp]
    is_length: NDArray[np.bool_]
    by_laser: Array | None = None


@dataclass(frozen=True, eq=False)
class ArmModel:
    """Residuals of profiles that an arm took, as its deviations, T_f_s and targets would have it.

    The true flange is where the arm reads it to be, and a motion further: the one from where the
    model has the flange at these joint angles to where the model with deviations has it. So a
    controller may read poses with a calibration of its own.

    Parameters
    ----------
    kinematics : Kinematics
        The arm without deviations.
    targets : tuple of SeenTarget
        What was seen.
    """

    kinematics: Kinematics
    targets: tuple[SeenTarget, ...]

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
    def _beyond_model(self) -> list[Array]:
        """What the arm's reading adds to the model's, by target, in frame b."""
        return [
            np.array(
                [
                    T @ inverse_pose(self.kinematics.forward(q))
                    for q, T in zip(seen.q, seen.T_b_f, strict=True)
                ]
            )
            for seen in self.targets
        ]

    @cached_property
    def _by_deviation(self) -> list[Array]:
        """Motion of the flange by the deviations, in the axes of f, shape (n, 6, 6 joints)."""
        return [
            np.array([deviation_jacobian(self.kinematics, q).reshape(6, -1) for q in seen.q])
            for seen in self.targets
        ]

    def linearise(self, T_f_s: Array, deviations: Array, target: Array) -> StackedProfiles:
        """Residuals at a guess, with derivatives and covariance.

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
        ends = np.cumsum([len(seen.start) for seen in self.targets])
        parts, by_target, lengths = [], [], []
        blocks: list[Array] = []
        by_laser: list[Array] = []
        profile, first = [], 0
        for seen, own, E, J in zip(
            self.targets,
            np.split(target, ends[:-1]),
            self._beyond_model,
            self._by_deviation,
            strict=True,
        ):
            T_b_f = E @ np.array([arm.forward(q) for q in seen.q])
            found = seen.model.seen_from(T_b_f).linearise(T_f_s, own)
            n, k = found.residuals.shape
            by_flange = found.by_pose.copy()
            # A turn of the flange also carries the sensor, whose origin stands off from f's.
            by_flange[:, :, 3:] -= found.by_pose[:, :, :3] @ skew_matrix(T_f_s[:3, 3])
            parts.append(
                np.hstack(
                    (
                        found.residuals.reshape(-1, 1),
                        found.by_pose.reshape(n * k, 6),
                        (by_flange @ J).reshape(n * k, -1),
                    )
                )
            )
            by_target.append(found.by_target.reshape(n * k, -1))
            blocks.extend(found.covariance)
            if found.by_laser is not None:
                by_laser.append(found.by_laser.reshape(n * k, -1))
            # Of each line offset and tilt, of an arc three lengths.
            lengths.append(np.tile(np.ones(k, bool) if k == 3 else np.arange(k) % 2 == 0, n))
            profile.append(np.repeat(np.arange(first, first + n), k))
            first += n
        stacked = np.concatenate(parts)
        covariance = block_diag(*blocks)
        shared = np.concatenate(by_laser) if len(by_laser) == len(parts) else None
        if shared is not None:
            covariance = covariance + shared @ shared.T
        return StackedProfiles(
            stacked[:, 0],
            np.hstack((stacked[:, 1:], block_diag(*by_target))),
            covariance,
            np.concatenate(profile),
            np.concatenate(lengths),
            shared,
        )
