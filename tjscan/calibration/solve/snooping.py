"""Profiles that contradict the others, or errors of the arm that explain them as well."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from math import comb
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from tjscan.calibration.solve import refine
from tjscan.calibration.solve.combined import CombinedModel
from tjscan.calibration.solve.refine import RefinedEstimate
from tjscan.calibration.targets.consensus import Mask
from tjscan.core.frames import Array

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
GEOMETRY_TRIED: Final = (2e-5, 2e-3, 25)
"""Metres from, metres to, and steps: from less than an arm's repeatability to more than an arm that
was ever measured is off. Larger residuals are no geometry error."""
UNKNOWN_RIDGE: Final = 1e-12
"""Share of a parameter's information: far less than any measurement gives."""
MIN_EVIDENCE: Final = float(chdtri(1, 2 * refine.FALSE_ALARM_PROBABILITY))
"""Fall of the cost that a larger geometry error must bring: twice a logarithm of likelihoods,
chi-square with one degree of freedom, and half the time no larger error fits better by chance."""


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
    if not (estimate.is_plausible and (refine.leave_one_out_changes(estimate)[0] <= prices).all()):
        n, k = len(estimate.used), int(estimate.residuals_per_profile.max())
        spare = int((1 - MIN_DOF_SHARE) * estimate.dof)
        most = min(int(MAX_REJECTED_SHARE * n), n - MIN_PROFILES_KEPT, spare // k)
        for size in range(1, most + 1):
            left_out = _find_worst_set(estimate, last, size)
            last = refine.refine_by_least_squares(
                model, last.T_f_s, last.target, ~left_out, rough=True
            )
            found, its_cost = most_likely_geometry(last, stated)
            its_cost += float(prices[left_out].sum())
            if its_cost < cost:
                best, geometry, cost = last, found, its_cost
    if best is estimate and geometry == best.geometry:
        return best
    model = replace(model, geometry=geometry)
    return refine.refine_by_least_squares(model, best.T_f_s, best.target, best.used)


def blame_prices(estimate: RefinedEstimate) -> Array:
    """By how much each profile must stand out to be blamed alone, shape (n,): a chi-squared."""
    sizes = estimate.residuals_per_profile
    return np.asarray(chdtri(sizes, refine.FALSE_ALARM_PROBABILITY / len(sizes)))


def _find_worst_set(estimate: RefinedEstimate, last: RefinedEstimate, size: int) -> Mask:
    """The set whose absence lowers the weighted sum of squares most, shape (n,)."""
    n = len(estimate.used)
    if comb(n, size) > MAX_SETS_TRIED:
        worst = np.where(last.used, refine.leave_one_out_changes(last)[0], -1.0)
        return np.asarray(~last.used | (np.arange(n) == np.argmax(worst)))
    sets = np.array(list(combinations(range(n), size)))
    return np.isin(np.arange(n), sets[int(np.argmax(_chi2_drops(estimate, sets)))])


def _chi2_drops(estimate: RefinedEstimate, sets: NDArray[np.intp]) -> Array:
    """By how much leaving out each set, rows of indices, lowers the sum of squares, first order."""
    M, weighted = refine.residual_information(estimate)
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


def most_likely_geometry(estimate: RefinedEstimate, stated: float) -> tuple[float, float]:
    """Find the size of the arm's geometry error that explains the residuals best.

    Parameters
    ----------
    estimate : RefinedEstimate
        Of the profiles that count.
    stated : float
        Metres; the size is not taken for less.

    Returns
    -------
    geometry : float
        Metres; `stated` if a larger one explains no more than chance does.
    cost : float
        Minus twice its restricted log-likelihood, and `MIN_EVIDENCE` for the one more unknown.
    """
    tried = np.concatenate(([stated], np.geomspace(*GEOMETRY_TRIED)))
    tried = tried[tried >= stated]
    costs = _geometry_costs(estimate, tried)
    best = int(np.argmin(costs))
    if costs[best] + MIN_EVIDENCE < costs[0]:
        return float(tried[best]), float(costs[best] + MIN_EVIDENCE)
    return stated, float(costs[0])


def _geometry_costs(estimate: RefinedEstimate, tried: Array) -> Array:
    """Minus twice the restricted log-likelihood of each size, up to a constant.

    All errors may be larger than stated by a factor, which is profiled out; never smaller
    (Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545).
    """
    stacked = estimate.in_use
    G = stacked.geometry
    L = np.linalg.cholesky(stacked.covariance - estimate.geometry**2 * G)
    # In the axes in which both covariances are diagonal, every size costs next to nothing.
    shares, axes = np.linalg.eigh(np.linalg.solve(L, np.linalg.solve(L, G).T))
    J = axes.T @ np.linalg.solve(L, stacked.jacobian)
    r = axes.T @ np.linalg.solve(L, stacked.residuals)
    prior = np.pad(estimate.prior_information, ((6, 0), (6, 0)))
    pull = prior[:, 6:] @ estimate.target
    at_rest = float(estimate.target @ estimate.prior_information @ estimate.target)
    variances = 1 + tried[:, None] ** 2 * np.maximum(shares, 0.0)
    A = np.einsum("ni,kn,nj->kij", J, 1 / variances, J) + prior
    # Each parameter in units of its own, and a little held: profiles that contradict each other
    # may leave it open altogether.
    known = np.sqrt(np.einsum("kii->ki", A))
    units = np.where(known > 0, known, 1.0)
    A = A / (units[:, :, None] * units[:, None]) + UNKNOWN_RIDGE * np.eye(A.shape[1])
    gradient = ((r / variances) @ J + pull) / units
    away = np.linalg.solve(A, gradient[..., None])[..., 0]
    chi2 = (r**2 / variances).sum(axis=1) + at_rest - np.einsum("ki,ki->k", gradient, away)
    widened = np.maximum(1.0, chi2 / max(estimate.dof, 1))
    volume = np.log(variances).sum(axis=1) + np.linalg.slogdet(A)[1] + 2 * np.log(units).sum(axis=1)
    return np.asarray(chi2 / widened + estimate.dof * np.log(widened) + volume)
