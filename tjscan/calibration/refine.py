"""Maximum-likelihood refinement: a profile weighs as much as its and the arm's errors allow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from tjscan.calibration.model import LinearisedModel, TargetModel
from tjscan.core.frames import Array, readonly_copy
from tjscan.core.pose_vector import boxplus, left_jacobian

MAX_REWEIGHTINGS: Final = 4
"""Weights depend on the geometry only weakly; they settle in two or three rounds."""
CONVERGENCE_SIGMAS: Final = 1e-3
"""A round that moves nothing by more than so many standard deviations is the last."""
MIN_REDUNDANCY: Final = 1e-6
"""A profile that leaves itself less than this share of dof can't be checked by the others."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class RefinedEstimate:
    """Least-squares estimate of sensor and target, with its fit and information.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange.
    target : ndarray, shape (m,)
        The target's parameters.
    covariance : ndarray, shape (6 + m, 6 + m)
        Of translation (metres), small rotation (radians), both in the axes of f, and target.
    chi2 : float
        Weighted sum of squares that is left, the target's prior included.
    dof : int
        Its expectation if the noise model is right.
    linearised : LinearisedModel
        Of all profiles, the unused ones too, at this estimate.
    used : ndarray of bool, shape (n,)
        Which profiles it rests on.
    """

    T_f_s: Array
    target: Array
    covariance: Array
    chi2: float
    dof: int
    linearised: LinearisedModel
    used: Mask

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_f_s", readonly_copy(self.T_f_s))
        object.__setattr__(self, "target", readonly_copy(self.target))
        object.__setattr__(self, "covariance", readonly_copy(self.covariance))
        self.used.flags.writeable = False


@dataclass(frozen=True, slots=True, eq=False)
class LeaveOneOutChanges:
    """How fit and T_f_s would change if single profiles were left out, to first order.

    Parameters
    ----------
    chi2 : ndarray, shape (n,)
        By how much the weighted sum of squares would fall; for an unused profile, by how much
        it misses what the others predict. Chi-square with k degrees of freedom if the profile
        is as good as stated; zero where the others can't check it.
    step : ndarray, shape (n, 6)
        How T_f_s would move: translation and rotation in the axes of f; zero for unused ones.
    """

    chi2: Array
    step: Array


def refine_by_least_squares(
    model: TargetModel, T_f_s: Array, target: Array, used: Mask
) -> RefinedEstimate:
    """Refine a nearby start: minimise the weighted sum of squares over the used profiles.

    The weights are the inverse covariances of the residuals at the current estimate; the
    target's prior counts as further residuals.

    Parameters
    ----------
    model : TargetModel
        The profiles.
    T_f_s : ndarray, shape (4, 4)
        Start for the sensor on the flange.
    target : ndarray, shape (m,)
        Start for the target's parameters.
    used : ndarray of bool, shape (n,)
        Which profiles count.
    """
    prior = _root(model.prior_information)
    base, start = T_f_s, np.concatenate((np.zeros(6), target))
    for _ in range(MAX_REWEIGHTINGS):
        whiten = _whitening(model.linearise(base, start[6:]).covariance[used])

        def residuals(theta: Array, base: Array = base, whiten: Array = whiten) -> Array:
            found = model.linearise(boxplus(base, theta[:6]), theta[6:])
            return _stack(whiten, found.residuals[used], prior @ theta[6:])

        def jacobian(theta: Array, base: Array = base, whiten: Array = whiten) -> Array:
            found = model.linearise(boxplus(base, theta[:6]), theta[6:])
            J = np.concatenate((found.by_pose, found.by_target), axis=2)[used]
            # From a small turn on top of theta's rotation to a change of the rotation vector.
            J[:, :, 3:6] = J[:, :, 3:6] @ left_jacobian(theta[3:6])
            return _whiten_jacobian(whiten, J, prior)

        found = least_squares(
            residuals, start, jacobian, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-14
        )
        moved = np.linalg.norm(jacobian(found.x) @ (found.x - start))
        base, start = boxplus(base, found.x[:6]), np.concatenate((np.zeros(6), found.x[6:]))
        if moved < CONVERGENCE_SIGMAS:
            break
    return _estimate(model, base, start[6:], used)


def _estimate(model: TargetModel, T_f_s: Array, target: Array, used: Mask) -> RefinedEstimate:
    linearised = model.linearise(T_f_s, target)
    whiten, prior = _whitening(linearised.covariance[used]), _root(model.prior_information)
    J = np.concatenate((linearised.by_pose, linearised.by_target), axis=2)[used]
    J_w = _whiten_jacobian(whiten, J, prior)
    r_w = _stack(whiten, linearised.residuals[used], prior @ target)
    observed = int(used.sum()) * linearised.residuals.shape[1] + len(prior)
    covariance = covariance_from_information(J_w.T @ J_w)
    dof = observed - J_w.shape[1]
    return RefinedEstimate(T_f_s, target, covariance, float(r_w @ r_w), dof, linearised, used)


def leave_one_out_changes(estimate: RefinedEstimate) -> LeaveOneOutChanges:
    """Changes if each profile in turn were left out, without solving again."""
    lin, used = estimate.linearised, estimate.used
    J = np.concatenate((lin.by_pose, lin.by_target), axis=2)
    JC = J @ estimate.covariance
    predicted = JC @ J.transpose(0, 2, 1)
    # What the residual would scatter by, were it as good as stated: smaller than its own errors
    # where it took part in the fit, larger where it did not.
    left = lin.covariance + np.where(used, -1.0, 1.0)[:, None, None] * predicted
    whiten = _whitening(lin.covariance)
    values, vectors = np.linalg.eigh(whiten @ left @ whiten.transpose(0, 2, 1))
    checked = values > MIN_REDUNDANCY
    inverse_values = np.where(checked, 1.0, 0.0) / np.where(checked, values, 1.0)
    r_w = np.einsum("nij,nj->ni", whiten, lin.residuals)
    along = np.einsum("nji,nj->ni", vectors, r_w)
    chi2 = np.einsum("ni,ni->n", along**2, inverse_values)
    weight = np.einsum("nij,nj->ni", vectors, inverse_values * along)
    step = np.einsum("nji,nkj,nk->ni", JC, whiten, weight)[:, :6]
    return LeaveOneOutChanges(chi2, np.where(used[:, None], step, 0.0))


def covariance_from_information(information: Array) -> Array:
    """Covariance from an information matrix of mixed units; huge where nothing is known."""
    scale = np.sqrt(np.diag(information))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    values = np.maximum(values, 1e-15)
    return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale))


def _root(information: Array) -> Array:
    """Rows that square to the information: as many as it has rank, shape (r, m)."""
    values, vectors = np.linalg.eigh(information)
    kept = values > 1e-14 * max(values.max(initial=0.0), 1e-300)
    return np.asarray(np.sqrt(values[kept])[:, None] * vectors[:, kept].T)


def _whitening(covariance: Array) -> Array:
    """Matrices that turn residuals of these covariances into independent ones of variance one."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _stack(whiten: Array, residuals: Array, prior: Array) -> Array:
    return np.concatenate((np.einsum("nij,nj->ni", whiten, residuals).ravel(), prior))


def _whiten_jacobian(whiten: Array, J: Array, prior: Array) -> Array:
    m = prior.shape[1]
    lines = (whiten @ J).reshape(-1, J.shape[2])
    return np.concatenate((lines, np.hstack((np.zeros((len(prior), J.shape[2] - m)), prior))))
