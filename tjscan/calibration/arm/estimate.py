"""Most probable deviations of an arm, given the maker's tolerance and what was seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares
from scipy.special import chdtri

from tjscan.calibration.arm.model import ArmModel, StackedProfiles
from tjscan.calibration.solve.refine import covariance_from_information
from tjscan.core.frames import Array, frozen_arrays
from tjscan.core.pose_vector import boxplus, left_jacobian

FALSE_ALARM_PROBABILITY: Final = 1e-3
"""Probability to blame any profile, where all are as good as stated."""

MAX_REJECTED_SHARE: Final = 0.1
"""Of the profiles; with more, it is not single ones that are bad."""

REWEIGHTINGS: Final = 2
"""Weights depend on the geometry only weakly."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class ArmEstimate:
    """Deviations, sensor and targets that fit best, with their covariance.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange.
    deviations : ndarray, shape (joints, 6)
        Of the joints; metres and radians.
    target : ndarray, shape (m,)
        The targets' parameters.
    covariance : ndarray, shape (6 + 6 joints + m, 6 + 6 joints + m)
        Of all of them: T_f_s by translation and small rotation in the axes of f. As stated errors
        have it; not widened.
    chi2, dof : float, int
        Weighted sum of squares that is left, the prior's included, and its expectation.
    stacked : StackedProfiles
        Of all profiles, the unused ones too.
    used : ndarray of bool, shape (n,)
        Which profiles it rests on.
    """

    T_f_s: Array
    deviations: Array
    target: Array
    covariance: Array
    chi2: float
    dof: int
    stacked: StackedProfiles
    used: Mask

    @property
    def sigma_scale(self) -> float:
        """By how much residuals are larger than stated, where that is significant; else one."""
        if self.chi2 <= chdtri(self.dof, FALSE_ALARM_PROBABILITY):
            return 1.0
        return float(np.sqrt(self.chi2 / self.dof))


def estimate_deviations(
    model: ArmModel, sigmas: Array, T_f_s: Array, held_out: Mask | None = None
) -> ArmEstimate:
    """Estimate deviations, sensor and targets, without the profiles that contradict the others.

    Parameters
    ----------
    model : ArmModel
        What was seen.
    sigmas : ndarray, shape (joints, 6)
        Standard deviations of the joints' deviations about zero, as the maker leaves them; all
        zero for an arm that is taken as its model has it.
    T_f_s : ndarray, shape (4, 4)
        About how the sensor sits.
    held_out : ndarray of bool, shape (n,), optional
        Profiles that take no part.
    """
    used = np.ones(model.profiles, dtype=bool) if held_out is None else ~held_out
    offered = int(used.sum())
    estimate = _solve(model, sigmas, T_f_s, model.start, used)
    while used.sum() > (1 - MAX_REJECTED_SHARE) * offered:
        falls, _ = without_each_profile(estimate)
        worst = int(falls.argmax())
        count = int((estimate.stacked.profile == worst).sum())
        widened = max(1.0, estimate.chi2 / estimate.dof)
        if falls[worst] <= widened * chdtri(count, FALSE_ALARM_PROBABILITY / offered):
            return estimate
        used = used.copy()
        used[worst] = False
        estimate = _solve(model, sigmas, estimate.T_f_s, estimate.target, used)
    return estimate


def whitened_jacobian(estimate: ArmEstimate, sigmas: Array) -> Array:
    """Derivatives of the used residuals over their errors, shape (N, 6 + 6 joints + m).

    By steps of T_f_s, by deviations over their `sigmas`, shape (joints, 6), and by targets.
    """
    rows = estimate.used[estimate.stacked.profile]
    L = _root(estimate.stacked.covariance[np.ix_(rows, rows)])
    scale = _scale(sigmas, len(estimate.target))
    return _over(L, estimate.stacked.jacobian[rows] * scale)


def _solve(model: ArmModel, sigmas: Array, T_f_s: Array, target: Array, used: Mask) -> ArmEstimate:
    """Gauss-Newton on deviations over their sigmas: the prior is their sum of squares."""
    n, scale = sigmas.size, _scale(sigmas, len(target))
    prior = np.hstack((np.zeros((n, 6)), np.eye(n), np.zeros((n, len(target)))))
    base, theta = T_f_s, np.concatenate((np.zeros(6 + n), target))

    def at(theta: Array, base: Array) -> StackedProfiles:
        deviations = (theta[6 : 6 + n] * sigmas.ravel()).reshape(sigmas.shape)
        return model.linearise(boxplus(base, theta[:6]), deviations, theta[6 + n :])

    for _ in range(REWEIGHTINGS):
        first = at(theta, base)
        rows = used[first.profile]
        L = _root(first.covariance[np.ix_(rows, rows)])

        def residuals(theta: Array, base: Array = base, L: Array = L, rows: Mask = rows) -> Array:
            found = at(theta, base)
            return np.concatenate((_over(L, found.residuals[rows]), theta[6 : 6 + n]))

        def jacobian(theta: Array, base: Array = base, L: Array = L, rows: Mask = rows) -> Array:
            J = at(theta, base).jacobian[rows] * scale
            # From a small turn on top of theta's rotation to a change of the rotation vector.
            J[:, 3:6] = J[:, 3:6] @ left_jacobian(theta[3:6])
            return np.concatenate((_over(L, J), prior))

        found = least_squares(residuals, theta, jacobian, method="lm", x_scale="jac")
        base, theta = boxplus(base, found.x[:6]), np.concatenate((np.zeros(6), found.x[6:]))
    stacked = at(theta, base)
    L = _root(stacked.covariance[np.ix_(rows, rows)])
    J = np.concatenate((_over(L, stacked.jacobian[rows] * scale), prior))
    r = np.concatenate((_over(L, stacked.residuals[rows]), theta[6 : 6 + n]))
    return ArmEstimate(
        base,
        (theta[6 : 6 + n] * sigmas.ravel()).reshape(sigmas.shape),
        theta[6 + n :],
        covariance_from_information(J.T @ J) * np.outer(scale, scale),
        float(r @ r),
        len(r) - J.shape[1],
        stacked,
        used,
    )


def without_each_profile(estimate: ArmEstimate) -> tuple[Array, Array]:
    """By how much the sum of squares would fall without each profile, and T_f_s would move.

    Returns
    -------
    falls : ndarray, shape (n,)
        Chi-square with as many degrees of freedom as the profile has residuals, if it is as good
        as stated; zero for those that are not in use.
    steps : ndarray, shape (n, 6)
        Translation (metres) and rotation (radians) in the axes of f.
    """
    stacked, rows = estimate.stacked, estimate.used[estimate.stacked.profile]
    L = _root(stacked.covariance[np.ix_(rows, rows)])
    J = _over(L, stacked.jacobian[rows])
    gain = estimate.covariance @ J.T
    left = np.eye(len(J)) - J @ gain
    r, at = _over(L, stacked.residuals[rows]), stacked.profile[rows]
    falls, steps = np.zeros(len(estimate.used)), np.zeros((len(estimate.used), 6))
    for i in np.flatnonzero(estimate.used):
        own = at == i
        predicted = np.linalg.solve(left[np.ix_(own, own)], r[own])
        falls[i], steps[i] = r[own] @ predicted, gain[:6, own] @ predicted
    return falls, steps


def _scale(sigmas: Array, targets: int) -> Array:
    return np.concatenate((np.ones(6), sigmas.ravel(), np.ones(targets)))


def _root(covariance: Array) -> Array:
    return np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)


def _over(L: Array, values: Array) -> Array:
    return np.asarray(solve_triangular(L, values, lower=True, check_finite=False))
