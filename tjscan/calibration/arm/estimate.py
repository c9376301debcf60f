"""Most probable deviations of an arm, given the maker's tolerance and what was seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import chdtri

from tjscan.calibration.arm.model import ArmModel
from tjscan.calibration.solve.combined import StackedResiduals
from tjscan.calibration.solve.refine import (
    Mask,
    covariance_from_information,
    lower_root,
    solve_reweighted,
    whiten,
    whitened,
)
from tjscan.core.frames import Array, frozen_arrays

FALSE_ALARM_PROBABILITY: Final = 1e-3
"""Probability to blame any profile although all are as good as stated."""

MAX_REJECTED_SHARE: Final = 0.1
"""Of the profiles; with more, it is not single ones that are bad."""

WEIGHTING_ROUNDS: Final = 2
"""Weights depend on the geometry only weakly."""


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
        Of all of them: T_f_s by translation and small rotation in the axes of f. By the stated
        errors; not widened.
    chi2, dof : float, int
        Weighted sum of squared residuals, the prior's included, and its expectation.
    stacked : StackedResiduals
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
    stacked: StackedResiduals
    used: Mask

    @property
    def sigma_scale(self) -> float:
        """By how much residuals are larger than stated, if that is significant; else one."""
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
        The profiles.
    sigmas : ndarray, shape (joints, 6)
        Standard deviations of the joints' deviations about zero, as the maker leaves them; all
        zero for an arm without deviations.
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
    L = lower_root(estimate.stacked.covariance[np.ix_(rows, rows)])
    scale = _scale(sigmas, len(estimate.target))
    return whiten(L, estimate.stacked.jacobian[rows] * scale)


@dataclass(frozen=True, slots=True, eq=False)
class _ScaledArm:
    """Residuals by deviations over their sigmas and by targets: the prior is a sum of squares."""

    model: ArmModel
    sigmas: Array

    def first_order(self, T_f_s: Array, parameters: Array) -> tuple[Array, Array]:
        found = self.linearise(T_f_s, parameters)
        return found.residuals, found.jacobian

    def linearise(self, T_f_s: Array, parameters: Array) -> StackedResiduals:
        deviations, target = self.unscaled(parameters)
        found = self.model.linearise(T_f_s, deviations, target)
        return replace(found, jacobian=found.jacobian * _scale(self.sigmas, len(target)))

    def unscaled(self, parameters: Array) -> tuple[Array, Array]:
        """Deviations, shape (joints, 6), and the targets' parameters."""
        n = self.sigmas.size
        deviations = (parameters[:n] * self.sigmas.ravel()).reshape(self.sigmas.shape)
        return deviations, parameters[n:]


def _solve(model: ArmModel, sigmas: Array, T_f_s: Array, target: Array, used: Mask) -> ArmEstimate:
    scaled, prior = _ScaledArm(model, sigmas), np.eye(sigmas.size, sigmas.size + len(target))
    start = np.concatenate((np.zeros(sigmas.size), target))
    T_f_s, parameters = solve_reweighted(scaled, T_f_s, start, used, prior, WEIGHTING_ROUNDS)
    J, r = whitened(scaled.linearise(T_f_s, parameters), used, prior, parameters)
    scale = _scale(sigmas, len(target))
    deviations, target = scaled.unscaled(parameters)
    return ArmEstimate(
        T_f_s,
        deviations,
        target,
        covariance_from_information(J.T @ J) * np.outer(scale, scale),
        float(r @ r),
        len(r) - J.shape[1],
        model.linearise(T_f_s, deviations, target),
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
    L = lower_root(stacked.covariance[np.ix_(rows, rows)])
    J = whiten(L, stacked.jacobian[rows])
    gain = estimate.covariance @ J.T
    left = np.eye(len(J)) - J @ gain
    r, at = whiten(L, stacked.residuals[rows]), stacked.profile[rows]
    falls, steps = np.zeros(len(estimate.used)), np.zeros((len(estimate.used), 6))
    for i in np.flatnonzero(estimate.used):
        own = at == i
        predicted = np.linalg.solve(left[np.ix_(own, own)], r[own])
        falls[i], steps[i] = r[own] @ predicted, gain[:6, own] @ predicted
    return falls, steps


def _scale(sigmas: Array, targets: int) -> Array:
    return np.concatenate((np.ones(6), sigmas.ravel(), np.ones(targets)))
