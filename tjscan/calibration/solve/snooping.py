"""Which profiles contradict the others, and which merely show that all are rougher than stated."""

from __future__ import annotations

from itertools import combinations
from math import comb
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from tjscan.calibration.solve.combined import CombinedModel
from tjscan.calibration.solve.refine import (
    ROUGH_EVALUATIONS,
    Mask,
    RefinedEstimate,
    leave_one_out_changes,
    refine_by_least_squares,
    residual_information,
)
from tjscan.calibration.solve.variance import most_likely_geometry
from tjscan.core.frames import Array

FALSE_ALARM_PROBABILITY: Final = 1e-3
"""Probability to blame any profile, or the noise model, although all are as good as stated."""
MIN_PROFILES_KEPT: Final = 5
"""Profiles that are never left out."""
MAX_REJECTED_SHARE: Final = 1 / 3
"""If a larger share were bad, the others could not show which."""
MIN_DOF_SHARE: Final = 0.5
"""Share of the degrees of freedom that must remain: with few left, any lines agree."""
MAX_SETS_TRIED: Final = 3000
"""Sets of one size that are tried; of larger choices, the last set and one more."""
SINGULAR_SET_RIDGE: Final = 1e-6
"""Keeps sets solvable that nothing could be found without; they leave no residual anyway."""


def reject_outlying_profiles(
    model: CombinedModel, estimate: RefinedEstimate, stated: float = 0.0
) -> RefinedEstimate:
    """Solve again without the profiles that contradict the others.

    Bad profiles hide one another and put the blame on good ones, so sets of them are left out
    whole. The set is taken that explains the profiles best: a profile costs as much as it must
    stand out by to be blamed alone. Two other explanations compete: that all profiles are rougher
    than stated, and that the arm's geometry is off.

    Parameters
    ----------
    model : CombinedModel
        The profiles.
    estimate : RefinedEstimate
        With all of them in use.
    stated : float
        Geometry error to allow for at least, metres.
    """
    prices = blame_prices(estimate)
    geometry, cost = most_likely_geometry(estimate, stated)
    best, last = estimate, estimate
    if not (chi2_is_plausible(estimate) and (leave_one_out_changes(estimate).chi2 <= prices).all()):
        for size in range(1, _most(estimate) + 1):
            left_out = _worst_set(estimate, last, size)
            last = refine_by_least_squares(
                model,
                last.T_f_s,
                last.target,
                ~left_out,
                rounds=1,
                evaluations=ROUGH_EVALUATIONS,
            )
            found, its_cost = most_likely_geometry(last, stated)
            its_cost += float(prices[left_out].sum())
            if its_cost < cost:
                best, geometry, cost = last, found, its_cost
    if best is estimate and geometry == best.geometry:
        return best
    return refine_by_least_squares(
        model.with_geometry(geometry), best.T_f_s, best.target, best.used
    )


def blame_prices(estimate: RefinedEstimate) -> Array:
    """By how much each profile must stand out to be blamed alone, shape (n,): a chi-squared."""
    sizes = estimate.residuals_per_profile
    return np.asarray(chdtri(sizes, FALSE_ALARM_PROBABILITY / len(sizes)))


def chi2_is_plausible(estimate: RefinedEstimate) -> bool:
    """Whether the residuals are as small as the stated errors explain, by their chi-squared."""
    return estimate.dof <= 0 or bool(estimate.chi2 <= chdtri(estimate.dof, FALSE_ALARM_PROBABILITY))


def _most(estimate: RefinedEstimate) -> int:
    """How many profiles may be bad, from an estimate that uses all of them."""
    n, k = len(estimate.used), int(estimate.residuals_per_profile.max())
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
    M, weighted = residual_information(estimate)
    scale = np.sqrt(np.diag(estimate.stacked.covariance))
    sizes = estimate.residuals_per_profile
    n, k = len(sizes), int(sizes.max())
    # As many rows for every profile; rows that some lack have no effect.
    row = estimate.stacked.profile * k + np.concatenate([np.arange(size) for size in sizes])
    left, r = np.eye(n * k), np.zeros(n * k)
    left[np.ix_(row, row)] = M * np.outer(scale, scale)
    r[row] = weighted * scale
    blocks = left.reshape(n, k, n, k).transpose(0, 2, 1, 3)[sets[:, :, None], sets[:, None, :]]
    rows = sets.shape[1] * k
    inner = blocks.transpose(0, 1, 3, 2, 4).reshape(-1, rows, rows) + SINGULAR_SET_RIDGE * np.eye(
        rows
    )
    r_set = r.reshape(n, k)[sets].reshape(-1, rows, 1)
    return np.asarray((r_set * np.linalg.solve(inner, r_set)).sum(axis=(1, 2)))
