"""Maximum-likelihood refinement of one sensor and one or several targets.

All share one T_f_s, and errors of arm and laser; each target has unknowns of its own. A profile
weighs as much as its own and the arm's errors allow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, solve_triangular
from scipy.optimize import least_squares
from scipy.special import chdtri

from tjscan.calibration.noise import geometry_error_covariance
from tjscan.calibration.targets.target import LinearisedModel, TargetModel
from tjscan.core.frames import Array, Mask, array_dataclass
from tjscan.core.pose_vector import boxplus, left_jacobian


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
    def residual_covariance_cholesky(self) -> Array:
        """Lower triangular L, shape (N, N), with L Lᵀ the covariance."""
        return np.asarray(np.linalg.cholesky(self.covariance), dtype=float)

    def select_profiles(self, chosen: Mask) -> StackedResiduals:
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

    def target_slice(self, k: int) -> slice:
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
        models = enumerate(self.models)
        found = [model.linearise(T_f_s, target[self.target_slice(k)]) for k, model in models]
        if self.by_true_pose is None:
            return found
        return [
            replace(one, by_arm=one.by_arm @ errors)
            for one, errors in zip(found, self.by_true_pose, strict=True)
        ]

    def weighted_misfit(self, T_f_s: Array, target: Array) -> float:
        """Weighted sum of squares, profile by profile: the nearest of several starts has least."""
        total = 0.0
        for part in self.linearise_each(T_f_s, target):
            r = part.residuals[..., None]
            total += float((r * np.linalg.solve(part.covariance, r)).sum())
        return total

    def residuals_and_jacobian(self, T_f_s: Array, target: Array) -> tuple[Array, Array]:
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
            geometry = geometry_error_covariance(by_arm, correlation)
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
"""Probability to blame what is as stated: a profile, noise, geometry, a radius or the poses."""
MIN_PROFILE_REDUNDANCY: Final = 1e-6
"""A profile that leaves itself less than this share of dof can't be checked by the others."""


@array_dataclass
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
    geometry : float
        Standard deviation of the arm's geometry error that it allows for, metres.
    prior_information : ndarray, shape (m, m)
        Of the targets' parameters; empty if the joints' deviations are estimated.
    deviations : ndarray, shape (joints, 6)
        Of the joints, metres and radians; empty if they are not estimated.
    """

    T_f_s: Array
    target: Array
    covariance: Array
    chi2: float
    dof: int
    stacked: StackedResiduals
    used: Mask
    geometry: float = 0.0
    prior_information: Array = field(default_factory=lambda: np.empty((0, 0)))
    deviations: Array = field(default_factory=lambda: np.empty((0, 6)))

    @property
    def residuals_in_use(self) -> StackedResiduals:
        """Residuals of the profiles in use."""
        return self.stacked.select_profiles(self.used)

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


def refine_by_least_squares(
    model: CombinedModel,
    T_f_s: Array,
    target: Array,
    used: Mask,
    *,
    rough: bool = False,
) -> LeastSquaresEstimate:
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
    found = solve_reweighted(
        model, T_f_s, target, used, prior, rounds, settled=CONVERGENCE_SIGMAS, **solver
    )
    return replace(found, geometry=model.geometry, prior_information=information)


class LeastSquaresModel(Protocol):
    """Residuals of profiles by the sensor's pose and other parameters."""

    def residuals_and_jacobian(self, T_f_s: Array, target: Array) -> tuple[Array, Array]:
        """Residuals, shape (N,), and their derivatives, shape (N, 6 + m)."""

    def linearise(self, T_f_s: Array, target: Array) -> StackedResiduals:
        """The same with their covariance."""


def solve_reweighted(
    model: LeastSquaresModel,
    base: Array,
    target: Array,
    used: Mask,
    prior: Array,
    rounds: int,
    *,
    settled: float = 0.0,
    **solver: Any,
) -> LeastSquaresEstimate:
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
    """
    for _ in range(rounds):
        first = model.linearise(base, target)
        L = first.select_profiles(used).residual_covariance_cholesky
        fit = _CachedLinearisation(model, base, prior, used[first.profile], L)
        start = np.concatenate((np.zeros(6), target))
        found = least_squares(
            fit.residuals, start, fit.jacobian, method="lm", x_scale="jac", **solver
        )
        moved = np.linalg.norm(fit.jacobian(found.x) @ (found.x - start))
        base, target = boxplus(base, found.x[:6]), found.x[6:]
        if moved < settled:
            break
    stacked = model.linearise(base, target)
    residuals_in_use = stacked.select_profiles(used)
    L = residuals_in_use.residual_covariance_cholesky
    J = _append_prior(whiten_residuals(L, residuals_in_use.jacobian), prior)
    r = np.concatenate((whiten_residuals(L, residuals_in_use.residuals), prior @ target))
    covariance, dof = covariance_from_information(J.T @ J), len(r) - J.shape[1]
    return LeastSquaresEstimate(base, target, covariance, float(r @ r), dof, stacked, used)


class _CachedLinearisation:
    """Whitened residuals and derivatives; the solver asks for one after the other at each step."""

    def __init__(
        self, model: LeastSquaresModel, base: Array, prior: Array, rows: Mask, L: Array
    ) -> None:
        self._model, self._base, self._prior, self._rows, self._L = model, base, prior, rows, L
        self._at, self._found = np.empty(0), (np.empty(0), np.empty(0))

    def residuals(self, theta: Array) -> Array:
        """At a step of the sensor from its base and the other parameters, shape (6 + m,)."""
        found = self._residuals_and_jacobian(theta)[0][self._rows]
        return np.concatenate((whiten_residuals(self._L, found), self._prior @ theta[6:]))

    def jacobian(self, theta: Array) -> Array:
        """Derivatives of `residuals`."""
        J = self._residuals_and_jacobian(theta)[1][self._rows]
        # From a small turn on top of theta's rotation to a change of the rotation vector.
        J[:, 3:6] = J[:, 3:6] @ left_jacobian(theta[3:6])
        return _append_prior(whiten_residuals(self._L, J), self._prior)

    def _residuals_and_jacobian(self, theta: Array) -> tuple[Array, Array]:
        if not np.array_equal(theta, self._at):
            found = self._model.residuals_and_jacobian(boxplus(self._base, theta[:6]), theta[6:])
            self._at, self._found = theta.copy(), found
        return self._found


def refit_targets(model: CombinedModel, estimate: LeastSquaresEstimate) -> LeastSquaresEstimate:
    """Move the targets to their places by the used profiles, the sensor being kept.

    An error of the arm that is alike at all poses has the same effect as a target at another
    place. A target that is used or looked at with the same arm belongs where that arm sees it.

    Parameters
    ----------
    model : CombinedModel
        The profiles.
    estimate : LeastSquaresEstimate
        From them.
    """
    plain = replace(model, geometry=0.0)
    prior, target = estimate.prior_information, estimate.target
    for _ in range(2):
        found = plain.linearise(estimate.T_f_s, target).select_profiles(estimate.used)
        L = found.residual_covariance_cholesky
        J, r = whiten_residuals(L, found.jacobian[:, 6:]), whiten_residuals(L, found.residuals)
        target = target - np.linalg.solve(J.T @ J + prior, J.T @ r + prior @ target)
    return replace(estimate, target=target, stacked=model.linearise(estimate.T_f_s, target))


def laser_response_of_estimate(estimate: LeastSquaresEstimate) -> Array | None:
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
    stacked = estimate.residuals_in_use
    if stacked.by_laser is None:
        return None
    weighted = np.linalg.solve(stacked.covariance, stacked.by_laser)
    return np.asarray(-estimate.covariance @ stacked.jacobian.T @ weighted)


def residual_weights_and_sums(estimate: LeastSquaresEstimate) -> tuple[Array, Array]:
    """Weights of the residuals of the used profiles after the fit, and their weighted sums.

    Parameters
    ----------
    estimate : LeastSquaresEstimate
        Of U residuals in use.

    Returns
    -------
    M : ndarray, shape (U, U)
        ``W - W J (Jᵀ W J + prior)⁻¹ Jᵀ W`` with W the inverse covariance of the residuals.
    weighted : ndarray, shape (U,)
        W times the residuals: M times the observations, less the prior's pull.
    """
    stacked = estimate.residuals_in_use
    W = np.linalg.inv(stacked.covariance)
    WJ = W @ stacked.jacobian
    return W - WJ @ estimate.covariance @ WJ.T, W @ stacked.residuals


def leave_one_out_changes(estimate: LeastSquaresEstimate) -> tuple[Array, Array]:
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
    stacked = estimate.residuals_in_use
    M, weighted = residual_weights_and_sums(estimate)
    W_J = np.linalg.solve(stacked.covariance, stacked.jacobian)
    n = len(estimate.used)
    chi2, step = np.zeros(n), np.zeros((n, 6))
    for i in range(n):
        if estimate.used[i]:
            own = np.flatnonzero(stacked.profile == i)
            square = np.ix_(own, own)
            # A profile that is off by delta as a whole: its most likely delta, and its cost.
            delta, chi2[i] = _solve_in_checked_directions(
                M[square], weighted[own], stacked.covariance[square]
            )
            step[i] = (estimate.covariance @ W_J[own].T @ delta)[:6]
        else:
            r, C = predicted_residuals(estimate, i)
            chi2[i] = r @ np.linalg.solve(C, r)
    return chi2, step


def predicted_residuals(estimate: LeastSquaresEstimate, profile: int) -> tuple[Array, Array]:
    """Residuals of an unused profile from what the others predict, and their covariance.

    Parameters
    ----------
    estimate : LeastSquaresEstimate
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


def _solve_in_checked_directions(M: Array, b: Array, C: Array) -> tuple[Array, float]:
    """M⁻¹ b and bᵀ M⁻¹ b along the directions that the other profiles check."""
    L = np.linalg.cholesky(C)
    values, vectors = np.linalg.eigh(L.T @ M @ L)
    kept = values > MIN_PROFILE_REDUNDANCY
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
