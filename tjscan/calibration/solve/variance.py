"""Size of the arm's geometry error, from the correlation of residuals of different poses."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.special import chdtri

from tjscan.calibration.solve.refine import RefinedEstimate
from tjscan.core.frames import Array

GEOMETRY_TRIED: Final = (2e-5, 2e-3, 25)
"""Metres from, metres to, and steps: from less than an arm's repeatability to more than an arm that
was ever measured is off. Larger residuals are no geometry error."""
FALSE_ALARM_PROBABILITY: Final = 1e-3
"""Probability to find the error larger than stated although it is not."""
UNKNOWN_RIDGE: Final = 1e-12
"""Share of a parameter's information: far less than any measurement gives."""
MIN_EVIDENCE: Final = float(chdtri(1, 2 * FALSE_ALARM_PROBABILITY))
"""Fall of the cost that a larger error must bring: twice a logarithm of likelihoods, chi-square
with one degree of freedom, and half the time no larger error fits better by chance."""


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
    costs = _costs(estimate, tried)
    best = int(np.argmin(costs))
    if costs[best] + MIN_EVIDENCE < costs[0]:
        return float(tried[best]), float(costs[best] + MIN_EVIDENCE)
    return stated, float(costs[0])


def _costs(estimate: RefinedEstimate, tried: Array) -> Array:
    """Minus twice the restricted log-likelihood of each size, up to a constant.

    All errors may be larger than stated by a factor, which is profiled out; never smaller
    (Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545).
    """
    rows = estimate.rows_used
    stacked, square = estimate.stacked, np.ix_(rows, rows)
    G = stacked.geometry[square]
    L = np.linalg.cholesky(stacked.covariance[square] - estimate.geometry**2 * G)
    # In the axes in which both covariances are diagonal, every size costs next to nothing.
    shares, axes = np.linalg.eigh(np.linalg.solve(L, np.linalg.solve(L, G).T))
    J = axes.T @ np.linalg.solve(L, stacked.jacobian[rows])
    r = axes.T @ np.linalg.solve(L, stacked.residuals[rows])
    prior = np.zeros((J.shape[1], J.shape[1]))
    prior[6:, 6:] = estimate.prior_information
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
