"""Which profiles contradict the others, and which merely show that all are rougher than stated."""

from __future__ import annotations

from itertools import combinations
from math import comb
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from tjscan.calibration.model import TargetModel
from tjscan.calibration.refine import (
    Mask,
    RefinedEstimate,
    leave_one_out_changes,
    refine_by_least_squares,
)
from tjscan.core.frames import Array

FALSE_ALARM_PROBABILITY: Final = 1e-3
"""Probability to blame any profile, or the noise model, where all are as good as stated."""
MIN_PROFILES_KEPT: Final = 5
"""Profiles that are never left out."""
MAX_REJECTED_SHARE: Final = 1 / 3
"""If a larger share were bad, the others could not say which."""
MIN_DOF_SHARE: Final = 0.5
"""Share of the degrees of freedom that must remain: with few left, any lines agree."""
MAX_SETS_TRIED: Final = 3000
"""Sets of one size that are tried; of larger choices, the last set and one more."""
RIDGE: Final = 1e-6
"""Keeps sets solvable without which nothing could be found; they leave no residual anyway."""


def reject_outlying_profiles(model: TargetModel, estimate: RefinedEstimate) -> RefinedEstimate:
    """Solve again without the profiles that contradict the others.

    Bad profiles hide one another and put the blame on good ones, so sets of them are left out
    whole. The set is taken that explains the lines best: blame costs as much as a profile must
    stand out by to be blamed alone, and it competes with the other explanation, that all
    profiles are rougher than stated.

    Parameters
    ----------
    model : TargetModel
        The profiles.
    estimate : RefinedEstimate
        With all of them in use.
    """
    n, k = estimate.linearised.residuals.shape
    price = float(chdtri(k, FALSE_ALARM_PROBABILITY / n))
    if chi2_is_plausible(estimate) and leave_one_out_changes(estimate).chi2.max() <= price:
        return estimate
    best, last = estimate, estimate
    for size in range(1, _most(estimate) + 1):
        left_out = _worst_set(estimate, last, size)
        last = refine_by_least_squares(model, estimate.T_f_s, estimate.target, ~left_out)
        if _cost(last) + size * price < _cost(best) + int((~best.used).sum()) * price:
            best = last
    return best


def chi2_is_plausible(estimate: RefinedEstimate) -> bool:
    """Whether the residuals are as small as the stated errors explain, by their chi-squared."""
    return estimate.dof <= 0 or bool(estimate.chi2 <= chdtri(estimate.dof, FALSE_ALARM_PROBABILITY))


def _cost(estimate: RefinedEstimate) -> float:
    """Minus twice the log-likelihood, all errors being as much larger than stated as fits best."""
    widened = max(1.0, estimate.chi2 / max(estimate.dof, 1))
    return float(estimate.chi2 / widened + estimate.dof * np.log(widened))


def _most(estimate: RefinedEstimate) -> int:
    """How many profiles may be bad, from an estimate that uses all of them."""
    n, k = len(estimate.used), int(estimate.linearised.residuals.shape[1])
    spare = int((1 - MIN_DOF_SHARE) * estimate.dof)
    return max(0, min(int(MAX_REJECTED_SHARE * n), n - MIN_PROFILES_KEPT, spare // k))


def _worst_set(estimate: RefinedEstimate, last: RefinedEstimate, size: int) -> Mask:
    """The set whose absence lowers the weighted sum of squares most, shape (n,)."""
    n = len(estimate.used)
    if comb(n, size) > MAX_SETS_TRIED:
        worst = np.where(last.used, leave_one_out_changes(last).chi2, -1.0)
        left_out = ~last.used
        left_out[int(np.argmax(worst))] = True
        return left_out
    sets = np.array(list(combinations(range(n), size)))
    left_out = np.zeros(n, dtype=bool)
    left_out[sets[int(np.argmax(_drops(estimate, sets)))]] = True
    return left_out


def _drops(estimate: RefinedEstimate, sets: NDArray[np.intp]) -> Array:
    """By how much leaving out each set, rows of indices, lowers the sum of squares, first order."""
    lin = estimate.linearised
    n, k = lin.residuals.shape
    whiten = np.linalg.inv(np.linalg.cholesky(lin.covariance))
    r = np.einsum("nij,nj->ni", whiten, lin.residuals)
    J = (whiten @ np.concatenate((lin.by_pose, lin.by_target), axis=2)).reshape(n * k, -1)
    # What the fit leaves of errors in the residuals, profile by profile.
    left = (np.eye(n * k) - J @ estimate.covariance @ J.T).reshape(n, k, n, k)
    blocks = left.transpose(0, 2, 1, 3)[sets[:, :, None], sets[:, None, :]]
    rows = sets.shape[1] * k
    inner = blocks.transpose(0, 1, 3, 2, 4).reshape(-1, rows, rows) + RIDGE * np.eye(rows)
    r_set = r[sets].reshape(-1, rows, 1)
    return np.asarray((r_set * np.linalg.solve(inner, r_set)).sum(axis=(1, 2)))
