"""Several targets seen by one sensor: one T_f_s, each target's own unknowns, errors in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from tjscan.calibration.arm_error import geometry_correlation, geometry_covariance
from tjscan.calibration.models.linearised import LinearisedModel, TargetModel
from tjscan.core.frames import Array


@dataclass(frozen=True, slots=True, eq=False)
class StackedResiduals:
    """Residuals of all profiles of all targets in one column, with derivatives and covariance.

    Parameters
    ----------
    residuals : ndarray, shape (N,)
        Zero where everything fits.
    jacobian : ndarray, shape (N, 6 + m)
        Derivative by a step of T_f_s (axes of f) and the parameters of the targets.
    covariance : ndarray, shape (N, N)
        Of the residuals: range noise, the arm's pose noise and its geometry error.
    geometry : ndarray, shape (N, N)
        What a geometry error of one metre would add to the covariance.
    profile : ndarray of int, shape (N,)
        To which profile each residual belongs.
    by_laser : ndarray, shape (N, m), or None
        Derivative by draws of the laser's deviation, which the covariance holds.
    """

    residuals: Array
    jacobian: Array
    covariance: Array
    geometry: Array
    profile: NDArray[np.intp]
    by_laser: Array | None = None


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

    Notes
    -----
    `correlation` counts where the arm's postures are not known; see `LinearisedModel.by_geometry`.
    """

    models: tuple[TargetModel, ...]
    correlation: Array
    geometry: float = 0.0

    @classmethod
    def of(cls, models: Sequence[TargetModel], T_b_f: Array, geometry: float = 0.0) -> Self:
        """Model of targets seen from n flange poses, all targets together.

        Parameters
        ----------
        models : sequence of TargetModel
            One per target.
        T_b_f : ndarray, shape (n, 4, 4)
            Flange poses of all profiles.
        geometry : float
            Standard deviation of the arm's geometry error, metres.
        """
        return cls(tuple(models), geometry_correlation(T_b_f), geometry)

    def with_geometry(self, geometry: float) -> CombinedModel:
        """The same with another size of the arm's geometry error, metres."""
        return replace(self, geometry=geometry)

    @property
    def prior_information(self) -> Array:
        """Inverse covariance of all targets' parameters about zero, shape (m, m)."""
        each = [model.prior_information for model in self.models]
        return each[0] if len(each) == 1 else np.asarray(block_diag(*each))

    def linearise_each(self, T_f_s: Array, target: Array) -> list[LinearisedModel]:
        """Linearise each target at a guess of the sensor and all targets' parameters.

        Parameters
        ----------
        T_f_s : ndarray, shape (4, 4)
            The sensor on the flange.
        target : ndarray, shape (m,)
            Parameters of the targets, one after the other.
        """
        ends = np.cumsum([len(model.prior_information) for model in self.models])
        return [
            model.linearise(T_f_s, part)
            for model, part in zip(self.models, np.split(target, ends[:-1]), strict=True)
        ]

    def misfit(self, T_f_s: Array, target: Array) -> float:
        """Weighted sum of squares, profile by profile: which of several starts is nearest."""
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
        return np.concatenate([part.residuals.ravel() for part in parts]), _jacobian(parts)

    def linearise(self, T_f_s: Array, target: Array) -> StackedResiduals:
        """Residuals of all profiles, with derivatives and covariance; see `linearise_each`."""
        parts = self.linearise_each(T_f_s, target)
        sizes = [np.full(len(part.residuals), part.residuals.shape[1]) for part in parts]
        profile = np.repeat(np.arange(len(self.correlation)), np.concatenate(sizes))
        shared = _stacked([part.by_geometry for part in parts])
        if shared is None:
            by_arm = np.concatenate([part.by_arm.reshape(-1, 6) for part in parts])
            geometry = geometry_covariance(by_arm, self.correlation[profile][:, profile])
        else:
            geometry = shared @ shared.T
        covariance, by_laser = _own_covariance(parts), _stacked([part.by_laser for part in parts])
        if by_laser is not None:
            covariance = covariance + by_laser @ by_laser.T
        return StackedResiduals(
            np.concatenate([part.residuals.ravel() for part in parts]),
            _jacobian(parts),
            covariance + self.geometry**2 * geometry,
            geometry,
            profile,
            by_laser,
        )


def _jacobian(parts: list[LinearisedModel]) -> Array:
    J = np.zeros(
        (sum(p.residuals.size for p in parts), 6 + sum(p.by_target.shape[2] for p in parts))
    )
    row, column = 0, 6
    for part in parts:
        m = part.by_target.shape[2]
        rows = slice(row, row + part.residuals.size)
        J[rows, :6] = part.by_pose.reshape(-1, 6)
        J[rows, column : column + m] = part.by_target.reshape(-1, m)
        row, column = rows.stop, column + m
    return J


def _stacked(parts: list[Array | None]) -> Array | None:
    """Rows of all targets, shape (N, m); none where some target has none."""
    known = [part.reshape(-1, part.shape[2]) for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None


def _own_covariance(parts: list[LinearisedModel]) -> Array:
    """Of range noise and pose noise: none from one profile to another."""
    total = sum(part.residuals.size for part in parts)
    covariance, row = np.zeros((total, total)), 0
    for part in parts:
        n, k = part.residuals.shape
        each = row + np.arange(n * k).reshape(n, k)
        covariance[each[:, :, None], each[:, None, :]] = part.covariance
        row += n * k
    return covariance
