"""Maximum-likelihood refinement: a profile weighs as much as its and the arm's errors allow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares
from scipy.special import chdtri

from tjscan.calibration.solve.combined import CombinedModel, StackedResiduals
from tjscan.calibration.targets.consensus import Mask
from tjscan.core.frames import Array, frozen_arrays
from tjscan.core.pose_vector import boxplus, left_jacobian

MAX_REWEIGHTINGS: Final = 4
"""Weights depend on the geometry only weakly; they settle in two or three rounds."""
MAX_EVALUATIONS: Final = 60
"""Of each round, for the estimate that is kept."""
ROUGH_EVALUATIONS: Final = 15
"""Of each round, to compare starts or hypotheses: those that lead anywhere get there in ten."""
SOLVER_TOLERANCES: Final = {"xtol": 1e-12, "ftol": 1e-14}
"""Relative; the same profiles give the same result to the last digit that counts."""
CONVERGENCE_SIGMAS: Final = 1e-3
"""A round that moves nothing by more than so many standard deviations is the last."""
FALSE_ALARM_PROBABILITY: Final = 1e-3
"""Probability to blame any profile, the noise model or the geometry, although all are as stated."""
MIN_REDUNDANCY: Final = 1e-6
"""A profile that leaves itself less than this share of dof can't be checked by the others."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class LeastSquaresEstimate:
    """Least-squares estimate of sensor and targets, with its fit.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange.
    target : ndarray, shape (m,)
        The targets' parameters.
    covariance : ndarray, shape (p, p)
        Of translation (metres), small rotation (radians), both in the axes of f, of the joints'
        deviations if these are estimated, and of targets; by the stated errors, not widened.
    chi2 : float
        Weighted sum of squared residuals, the prior's included.
    dof : int
        Its expectation if the noise model is right.
    stacked : StackedResiduals
        Of all profiles, the unused ones too, at this estimate.
    used : ndarray of bool, shape (n,)
        Which profiles it rests on.
    """

    T_f_s: Array
    target: Array
    covariance: Array
    chi2: float
    dof: int
    stacked: StackedResiduals
    used: Mask

    @property
    def in_use(self) -> StackedResiduals:
        """Residuals of the profiles in use."""
        return self.stacked.of_profiles(self.used)

    @property
    def residuals_per_profile(self) -> NDArray[np.intp]:
        """How many residuals each profile has, shape (n,)."""
        return np.bincount(self.stacked.profile)

    @property
    def is_plausible(self) -> bool:
        """Whether residuals are as small as the stated errors explain, by their chi-squared."""
        return self.dof <= 0 or bool(self.chi2 <= chdtri(self.dof, FALSE_ALARM_PROBABILITY))

    @property
    def sigma_scale(self) -> float:
        """By how much residuals are larger than stated, if that is significant; else one."""
        return 1.0 if self.is_plausible else float(np.sqrt(self.chi2 / self.dof))

    @property
    def variance_scale(self) -> float:
        """By how much the variances are larger than stated, significant or not."""
        return max(1.0, self.chi2 / max(self.dof, 1))


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class RefinedEstimate(LeastSquaresEstimate):
    """Estimate of sensor and targets, with the arm's geometry error and the targets' prior.

    Parameters
    ----------
    geometry : float
        Standard deviation of the arm's geometry error that it allows for, metres.
    prior_information : ndarray, shape (m, m)
        Of the targets' parameters.
    """

    geometry: float
    prior_information: Array


def refine_by_least_squares(
    model: CombinedModel,
    T_f_s: Array,
    target: Array,
    used: Mask,
    *,
    rough: bool = False,
) -> RefinedEstimate:
    """Refine a nearby start: minimise the weighted sum of squares over the used profiles.

    The weights are the inverse covariance of the residuals at the current estimate; the
    targets' prior counts as further residuals.

    Parameters
    ----------
    model : CombinedModel
        The profiles.
    T_f_s : ndarray, shape (4, 4)
        Start for the sensor on the flange.
    target : ndarray, shape (m,)
        Start for the targets' parameters.
    used : ndarray of bool, shape (n,)
        Which profiles count.
    rough : bool
        Find weights only once, with few evaluations of the residuals: to compare, not to keep.
    """
    information = model.prior_information
    # Rows that square to the information: as many as it has rank.
    values, vectors = np.linalg.eigh(information)
    kept = values > 1e-14 * max(values.max(initial=0.0), 1e-300)
    prior = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
    rounds, evaluations = (1, ROUGH_EVALUATIONS) if rough else (MAX_REWEIGHTINGS, MAX_EVALUATIONS)
    solver = {**SOLVER_TOLERANCES, "max_nfev": evaluations}
    T_f_s, target = solve_reweighted(
        model, T_f_s, target, used, prior, rounds, settled=CONVERGENCE_SIGMAS, **solver
    )
    stacked = model.linearise(T_f_s, target)
    J, r = whiten_with_prior(stacked.of_profiles(used), prior, target)
    return RefinedEstimate(
        T_f_s,
        target,
        covariance_from_information(J.T @ J),
        float(r @ r),
        len(r) - J.shape[1],
        stacked,
        used,
        model.geometry,
        information,
    )


class ResidualModel(Protocol):
    """Residuals of profiles by the sensor's pose and other parameters."""

    def first_order(self, T_f_s: Array, target: Array) -> tuple[Array, Array]:
        """Residuals, shape (N,), and their derivatives, shape (N, 6 + m)."""

    def linearise(self, T_f_s: Array, target: Array) -> StackedResiduals:
        """The same with their covariance."""


def solve_reweighted(
    model: ResidualModel,
    base: Array,
    target: Array,
    used: Mask,
    prior: Array,
    rounds: int,
    *,
    settled: float = 0.0,
    **solver: Any,
) -> tuple[Array, Array]:
    """Minimise the weighted sum of squares, the weights found again in each round.

    Parameters
    ----------
    model : ResidualModel
        The profiles.
    base : ndarray, shape (4, 4)
        Start for T_f_s.
    target : ndarray, shape (m,)
        Start for the other parameters.
    used : ndarray of bool, shape (n,)
        Which profiles count.
    prior : ndarray, shape (r, m)
        Further residuals: this times the other parameters.
    rounds : int
        How often to find weights at most.
    settled : float
        A round that moves the whitened residuals by less is the last.
    **solver
        Of `scipy.optimize.least_squares`.

    Returns
    -------
    T_f_s : ndarray, shape (4, 4)
    target : ndarray, shape (m,)
    """
    for _ in range(rounds):
        first = model.linearise(base, target)
        L = first.of_profiles(used).lower_root
        fit = _CachedLinearisation(model, base, prior, used[first.profile], L)
        start = np.concatenate((np.zeros(6), target))
        found = least_squares(
            fit.residuals, start, fit.jacobian, method="lm", x_scale="jac", **solver
        )
        moved = np.linalg.norm(fit.jacobian(found.x) @ (found.x - start))
        base, target = boxplus(base, found.x[:6]), found.x[6:]
        if moved < settled:
            break
    return base, target


class _CachedLinearisation:
    """Whitened residuals and derivatives; the solver asks for one after the other at each step."""

    def __init__(
        self, model: ResidualModel, base: Array, prior: Array, rows: Mask, L: Array
    ) -> None:
        self._model, self._base, self._prior, self._rows, self._L = model, base, prior, rows, L
        self._at, self._found = np.empty(0), (np.empty(0), np.empty(0))

    def residuals(self, theta: Array) -> Array:
        """At a step of the sensor from its base and the other parameters, shape (6 + m,)."""
        found = self._first_order(theta)[0][self._rows]
        return np.concatenate((whiten_residuals(self._L, found), self._prior @ theta[6:]))

    def jacobian(self, theta: Array) -> Array:
        """Derivatives of `residuals`."""
        J = self._first_order(theta)[1][self._rows]
        # From a small turn on top of theta's rotation to a change of the rotation vector.
        J[:, 3:6] = J[:, 3:6] @ left_jacobian(theta[3:6])
        return _append_prior(whiten_residuals(self._L, J), self._prior)

    def _first_order(self, theta: Array) -> tuple[Array, Array]:
        if not np.array_equal(theta, self._at):
            T_f_s = boxplus(self._base, theta[:6])
            self._at, self._found = theta.copy(), self._model.first_order(T_f_s, theta[6:])
        return self._found


def whiten_with_prior(
    stacked: StackedResiduals, prior: Array, target: Array
) -> tuple[Array, Array]:
    """Derivatives and residuals over their errors, the prior's below them."""
    L = stacked.lower_root
    J = _append_prior(whiten_residuals(L, stacked.jacobian), prior)
    return J, np.concatenate((whiten_residuals(L, stacked.residuals), prior @ target))


def settle_targets(model: CombinedModel, estimate: RefinedEstimate) -> RefinedEstimate:
    """Move the targets to their places by the used profiles, the sensor being kept.

    An error of the arm that is alike at all poses has the same effect as a target at another
    place. A target that is used or looked at with the same arm belongs where that arm sees it.

    Parameters
    ----------
    model : CombinedModel
        The profiles.
    estimate : RefinedEstimate
        From them.
    """
    plain = replace(model, geometry=0.0)
    prior, target = estimate.prior_information, estimate.target
    for _ in range(2):
        found = plain.linearise(estimate.T_f_s, target).of_profiles(estimate.used)
        L = found.lower_root
        J, r = whiten_residuals(L, found.jacobian[:, 6:]), whiten_residuals(L, found.residuals)
        target = target - np.linalg.solve(J.T @ J + prior, J.T @ r + prior @ target)
    return replace(estimate, target=target, stacked=model.linearise(estimate.T_f_s, target))


def estimate_by_laser(estimate: LeastSquaresEstimate) -> Array | None:
    """By how much an estimate is off with draws of the laser's deviation.

    Parameters
    ----------
    estimate : LeastSquaresEstimate
        Of p parameters.

    Returns
    -------
    ndarray, shape (p, m), or None
        None if no deviation is stated.
    """
    stacked = estimate.in_use
    if stacked.by_laser is None:
        return None
    weighted = np.linalg.solve(stacked.covariance, stacked.by_laser)
    return np.asarray(-estimate.covariance @ stacked.jacobian.T @ weighted)


def residual_information(estimate: RefinedEstimate) -> tuple[Array, Array]:
    """Weights of the residuals of the used profiles after the fit, and their weighted sums.

    Parameters
    ----------
    estimate : RefinedEstimate
        Of U residuals in use.

    Returns
    -------
    M : ndarray, shape (U, U)
        ``W - W J (Jᵀ W J + prior)⁻¹ Jᵀ W`` with W the inverse covariance of the residuals.
    weighted : ndarray, shape (U,)
        W times the residuals: M times the observations, less the prior's pull.
    """
    stacked = estimate.in_use
    W = np.linalg.inv(stacked.covariance)
    WJ = W @ stacked.jacobian
    return W - WJ @ estimate.covariance @ WJ.T, W @ stacked.residuals


def leave_one_out_changes(estimate: RefinedEstimate) -> tuple[Array, Array]:
    """How fit and T_f_s would change if single profiles were left out, to first order.

    Returns
    -------
    chi2 : ndarray, shape (n,)
        By how much the weighted sum of squares would fall; for an unused profile, by how much
        it misses what the others predict. Chi-square with as many degrees of freedom as the
        profile has residuals, if it is as good as stated; zero if the others can't check it.
    step : ndarray, shape (n, 6)
        How T_f_s would move: translation and rotation in the axes of f; zero for unused ones.
    """
    stacked = estimate.in_use
    M, weighted = residual_information(estimate)
    W_J = np.linalg.solve(stacked.covariance, stacked.jacobian)
    n = len(estimate.used)
    chi2, step = np.zeros(n), np.zeros((n, 6))
    for i in range(n):
        if estimate.used[i]:
            own = np.flatnonzero(stacked.profile == i)
            square = np.ix_(own, own)
            # A profile that is off by delta as a whole: its most likely delta, and its cost.
            delta, chi2[i] = _solve_checked(M[square], weighted[own], stacked.covariance[square])
            step[i] = (estimate.covariance @ W_J[own].T @ delta)[:6]
        else:
            r, C = predicted_residuals(estimate, i)
            chi2[i] = r @ np.linalg.solve(C, r)
    return chi2, step


def predicted_residuals(estimate: RefinedEstimate, profile: int) -> tuple[Array, Array]:
    """Residuals of an unused profile from what the others predict, and their covariance.

    Parameters
    ----------
    estimate : RefinedEstimate
        That does without the profile.
    profile : int
        Which one.

    Returns
    -------
    residuals : ndarray, shape (k,)
        In metres and radians.
    covariance : ndarray, shape (k, k)
        Of its own errors and of the estimate's, which share arm and laser.
    """
    stacked = estimate.stacked
    own, used = stacked.profile == profile, estimate.used[stacked.profile]
    J, C = stacked.jacobian[own], stacked.covariance
    W_J = np.linalg.solve(C[np.ix_(used, used)], stacked.jacobian[used])
    shared = J @ estimate.covariance @ W_J.T @ C[np.ix_(used, own)]
    covariance = C[np.ix_(own, own)] + J @ estimate.covariance @ J.T - shared - shared.T
    return stacked.residuals[own], np.asarray(covariance)


def _solve_checked(M: Array, b: Array, C: Array) -> tuple[Array, float]:
    """M⁻¹ b and bᵀ M⁻¹ b along the directions that the other profiles check."""
    L = np.linalg.cholesky(C)
    values, vectors = np.linalg.eigh(L.T @ M @ L)
    kept = values > MIN_REDUNDANCY
    along = vectors[:, kept].T @ (L.T @ b)
    return L @ vectors[:, kept] @ (along / values[kept]), float(along @ (along / values[kept]))


def covariance_from_information(information: Array) -> Array:
    """Covariance from an information matrix of mixed units; huge for what is not known."""
    scale = np.sqrt(np.diag(information))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    values = np.maximum(values, 1e-15)
    return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale))


def whiten_residuals(L: Array, v: Array) -> Array:
    """Independent residuals of variance one, from those with covariance L Lᵀ."""
    return np.asarray(solve_triangular(L, v, lower=True, check_finite=False))


def _append_prior(J: Array, prior: Array) -> Array:
    """Derivatives, the prior's (by the last parameters) below the others."""
    return np.vstack((J, np.pad(prior, ((0, 0), (J.shape[1] - prior.shape[1], 0)))))
