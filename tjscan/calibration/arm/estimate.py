"""Most probable deviations of an arm, given the maker's tolerance and what was seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import chdtri

from tjscan.calibration.arm.model import ArmModel
from tjscan.calibration.solve.combined import StackedResiduals
from tjscan.calibration.solve.refine import (
    FALSE_ALARM_PROBABILITY,
    LeastSquaresEstimate,
    Mask,
    covariance_from_information,
    lower_root,
    solve_reweighted,
    whiten,
    whitened,
)
from tjscan.core.frames import Array, frozen_arrays

MAX_REJECTED_SHARE: Final = 0.1
"""Of the profiles; with more, it is not single ones that are bad."""

WEIGHTING_ROUNDS: Final = 2
"""Weights depend on the geometry only weakly."""


MIN_UNDETERMINED_SHARE: Final = 0.8
"""A deviation counts as undetermined if so much of it is in directions that the profiles show less
well than the prior does."""

DEVIATION_KINDS: Final = ("length x", "length y", "length z", "twist x", "twist y", "offset")
"""Of a joint's deviations, in their order."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class ArmEstimate(LeastSquaresEstimate):
    """Deviations, sensor and targets that fit best, with their covariance.

    Parameters
    ----------
    deviations : ndarray, shape (joints, 6)
        Of the joints; metres and radians.
    """

    deviations: Array


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
        count = int(estimate.residuals_per_profile[worst])
        limit = chdtri(count, FALSE_ALARM_PROBABILITY / offered)
        if falls[worst] <= estimate.variance_scale * limit:
            return estimate
        used = used.copy()
        used[worst] = False
        estimate = _solve(model, sigmas, estimate.T_f_s, estimate.target, used)
    return estimate


def whitened_jacobian(estimate: ArmEstimate, sigmas: Array) -> Array:
    """Derivatives of the used residuals over their errors, shape (N, 6 + 6 joints + m).

    By steps of T_f_s, by deviations over their `sigmas`, shape (joints, 6), and by targets.
    """
    rows = estimate.rows_used
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
        target,
        covariance_from_information(J.T @ J) * np.outer(scale, scale),
        float(r @ r),
        len(r) - J.shape[1],
        model.linearise(T_f_s, deviations, target),
        used,
        deviations,
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
    stacked, rows = estimate.stacked, estimate.rows_used
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


def undetermined_deviations(J: Array, joints: int) -> tuple[str, ...]:
    """Sentences on deviations that profiles leave as the prior has them, by joint and cause.

    Parameters
    ----------
    J : ndarray, shape (N, 6 + 6 joints + m)
        As `whitened_jacobian` gives it: in units in which the prior of each deviation is one.
    joints : int
        Number of joints.

    Notes
    -----
    Effects that T_f_s and targets can take over are projected out. Singular values of the rest
    below one belong to combinations of deviations that the profiles show less well than the prior.
    """
    n = 6 * joints
    free = np.hstack((J[:, :6], J[:, 6 + n :]))
    Q, _ = np.linalg.qr(free / np.linalg.norm(free, axis=0))
    own = J[:, 6 : 6 + n]
    _, singular, rows = np.linalg.svd(own - Q @ (Q.T @ own), full_matrices=True)
    blind = rows[np.concatenate((singular < 1, np.ones(len(rows) - len(singular), dtype=bool)))]
    share = (blind**2).sum(axis=0)
    groups: dict[tuple[int, str], list[str]] = {}
    for k in map(int, np.flatnonzero(share >= MIN_UNDETERMINED_SHARE)):
        groups.setdefault((k // 6 + 1, _like(J, k, joints)), []).append(DEVIATION_KINDS[k % 6])
    return tuple(
        f"joint {joint}: {', '.join(kinds)} can't be told from {like}: left as the maker states"
        for (joint, like), kinds in groups.items()
    )


def _like(J: Array, k: int, joints: int) -> str:
    """Cause with most of the effect of deviation k."""
    n = 6 * joints
    others = np.delete(J, 6 + k, axis=1)
    # As few and small others as possible: the prior's weight, and next to none without a prior.
    weight = np.concatenate((np.full(6, 1e-6), np.ones(n - 1), np.full(J.shape[1] - 6 - n, 1e-6)))
    scaled = others / np.maximum(
        np.linalg.norm(others, axis=0) * (weight < 1) + (weight == 1), 1e-300
    )
    A = np.concatenate((scaled, np.diag(weight)))
    x = np.linalg.lstsq(A, np.concatenate((J[:, 6 + k], np.zeros(len(weight)))), rcond=None)[0]
    joint = np.delete(np.arange(n), k) // 6
    effect = {
        "how the sensor sits": float(np.linalg.norm(scaled[:, :6] @ x[:6])),
        "where the target is": float(np.linalg.norm(scaled[:, 5 + n :] @ x[5 + n :])),
    }
    for j in range(joints):
        at = 6 + np.flatnonzero(joint == j)
        effect[f"those of joint {j + 1}"] = float(np.linalg.norm(scaled[:, at] @ x[at]))
    return max(effect, key=lambda name: effect[name])
