"""Several targets seen by one sensor: one T_f_s, each target's own unknowns, errors in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from tjscan.calibration.noise import geometry_covariance
from tjscan.calibration.targets.consensus import Mask
from tjscan.calibration.targets.target import LinearisedModel, TargetModel
from tjscan.core.frames import Array


@dataclass(frozen=True, slots=True, eq=False)
class StackedResiduals:
    """Residuals of all profiles of all targets in one column, with derivatives and covariance.

    Parameters
    ----------
    residuals : ndarray, shape (N,)
        Zero if everything fits; metres and radians.
    jacobian : ndarray, shape (N, p)
        Derivative by a step of T_f_s (axes of f), by the joints' deviations if these are
        estimated, and by the parameters of the targets.
    covariance : ndarray, shape (N, N)
        Of the residuals: range noise, the arm's pose noise and its geometry error.
    geometry : ndarray, shape (N, N)
        Covariance that a geometry error of one metre would add.
    profile : ndarray of int, shape (N,)
        Number of the profile that each residual belongs to.
    by_laser : ndarray, shape (N, m), or None
        Derivative by draws of the laser's deviation, which the covariance holds.
    """

    residuals: Array
    jacobian: Array
    covariance: Array
    geometry: Array
    profile: NDArray[np.intp]
    by_laser: Array | None = None

    @property
    def is_length(self) -> Mask:
        """Whether each residual is a length: of an arc all three, of a line every other one."""
        sizes, first = np.bincount(self.profile), np.searchsorted(self.profile, self.profile)
        place = np.arange(len(self.profile)) - first
        return np.asarray((sizes[self.profile] == 3) | (place % 2 == 0))

    @property
    def lower_root(self) -> Array:
        """Lower triangular L, shape (N, N), with L Lᵀ the covariance."""
        return np.asarray(np.linalg.cholesky(self.covariance), dtype=float)

    def of_profiles(self, chosen: Mask) -> StackedResiduals:
        """Return the residuals of some profiles, by a mask of shape (n,), alone."""
        rows = chosen[self.profile]
        square = np.ix_(rows, rows)
        return StackedResiduals(
            self.residuals[rows],
            self.jacobian[rows],
            self.covariance[square],
            self.geometry[square],
            self.profile[rows],
            None if self.by_laser is None else self.by_laser[rows],
        )


@dataclass(frozen=True, slots=True, eq=False)
class CombinedModel:
    """Model of the residuals of one or several targets.

    Parameters
    ----------
    models : tuple of TargetModel
        One per target; their parameters and profiles follow one another.
    correlation : ndarray, shape (n, n)
        Of the arm's geometry error between the poses of all profiles.
    geometry : float
        Standard deviation of that error, position in each axis, metres.
    by_true_pose : tuple of ndarray, shape (n, 6, 6) each, or None
        Of a sensor that is fixed in the room, for each target: from an error of each flange pose
        to that of the inverse pose, see `inverse_pose_errors`.

    Notes
    -----
    `correlation` counts if the arm's postures are not known; see `LinearisedModel.by_geometry`.
    """

    models: tuple[TargetModel, ...]
    correlation: Array
    geometry: float = 0.0
    by_true_pose: tuple[Array, ...] | None = None

    @property
    def prior_information(self) -> Array:
        """Inverse covariance of all targets' parameters about zero, shape (m, m)."""
        each = [model.prior_information for model in self.models]
        return each[0] if len(each) == 1 else np.asarray(block_diag(*each))

    def part(self, k: int) -> slice:
        """Slice of the parameters of target k among all parameters."""
        ends = np.cumsum([0] + [len(model.prior_information) for model in self.models])
        return slice(int(ends[k]), int(ends[k + 1]))

    def linearise_each(self, T_f_s: Array, target: Array) -> list[LinearisedModel]:
        """Linearise each target at a guess of the sensor and all targets' parameters.

        Parameters
        ----------
        T_f_s : ndarray, shape (4, 4)
            The sensor on the flange.
        target : ndarray, shape (m,)
            Parameters of the targets, one after the other.
        """
        found = [
            model.linearise(T_f_s, target[self.part(k)]) for k, model in enumerate(self.models)
        ]
        if self.by_true_pose is None:
            return found
        return [
            replace(one, by_arm=one.by_arm @ errors)
            for one, errors in zip(found, self.by_true_pose, strict=True)
        ]

    def misfit(self, T_f_s: Array, target: Array) -> float:
        """Weighted sum of squares, profile by profile: the nearest of several starts has least."""
        total = 0.0
        for part in self.linearise_each(T_f_s, target):
            r = part.residuals[..., None]
            total += float((r * np.linalg.solve(part.covariance, r)).sum())
        return total

    def first_order(self, T_f_s: Array, target: Array) -> tuple[Array, Array]:
        """Residuals of all profiles, shape (N,), and their derivatives; see `linearise_each`.

        Returns
        -------
        residuals : ndarray, shape (N,)
            In metres and radians.
        jacobian : ndarray, shape (N, 6 + m)
            By a step of T_f_s and by the targets' parameters.
        """
        parts = self.linearise_each(T_f_s, target)
        return np.concatenate([part.residuals.ravel() for part in parts]), _combined_jacobian(parts)

    def linearise(self, T_f_s: Array, target: Array) -> StackedResiduals:
        """Residuals of all profiles, with derivatives and covariance; see `linearise_each`."""
        parts = self.linearise_each(T_f_s, target)
        plain, shared = stack_residuals(parts), _stack_rows([part.by_geometry for part in parts])
        if shared is None:
            by_arm = np.concatenate([part.by_arm.reshape(-1, 6) for part in parts])
            correlation = self.correlation[plain.profile][:, plain.profile]
            geometry = geometry_covariance(by_arm, correlation)
        else:
            geometry = shared @ shared.T
        covariance = plain.covariance + self.geometry**2 * geometry
        return replace(plain, covariance=covariance, geometry=geometry)


def stack_residuals(parts: Sequence[LinearisedModel]) -> StackedResiduals:
    """Residuals of all targets in one column, on an arm without any geometry error."""
    sizes = [np.full(len(part.residuals), part.residuals.shape[1]) for part in parts]
    counts = np.concatenate(sizes)
    # Range noise and pose noise have nothing in common from one profile to another.
    covariance = np.asarray(block_diag(*(block for part in parts for block in part.covariance)))
    by_laser = _stack_rows([part.by_laser for part in parts])
    if by_laser is not None:
        covariance = covariance + by_laser @ by_laser.T
    return StackedResiduals(
        np.concatenate([part.residuals.ravel() for part in parts]),
        _combined_jacobian(parts),
        covariance,
        np.zeros_like(covariance),
        np.repeat(np.arange(len(counts)), counts),
        by_laser,
    )


def _combined_jacobian(parts: Sequence[LinearisedModel]) -> Array:
    """Derivatives by what all targets share, and by the parameters of each."""
    shared = [part.by_pose.reshape(-1, part.by_pose.shape[2]) for part in parts]
    own = [part.by_target.reshape(-1, part.by_target.shape[2]) for part in parts]
    return np.hstack((np.concatenate(shared), block_diag(*own)))


def _stack_rows(parts: Sequence[Array | None]) -> Array | None:
    """Rows of all targets, shape (N, m); None if a target has none."""
    known = [part.reshape(-1, part.shape[2]) for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None
