"""Which profiles contradict the others: taken out one by one, the worst first."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.stats import chi2, f

from tjscan.calibration.model import Model
from tjscan.calibration.refine import Estimate, deletions, refine

FALSE_ALARM: Final = 1e-3
"""Probability to blame any profile where all are as good as stated."""
FEWEST_LEFT: Final = 5
"""Profiles that are never taken out."""
MOST_BAD: Final = 1 / 3
"""If a larger share were bad, the others could not say which."""


def threshold(estimate: Estimate, left: float, freedom: int) -> float:
    """Weighted square of a profile's misfit above which it contradicts the others.

    Parameters
    ----------
    estimate : Estimate
        With the profile in it or not.
    left, freedom : float, int
        Weighted sum of squares of the others and its degrees of freedom. Where it is larger
        than stated errors explain, the profile is measured against that larger scatter.
    """
    n, k = estimate.linearised.residuals.shape[:2]
    if freedom <= 0:
        return np.inf
    if left <= freedom:
        return float(chi2.isf(FALSE_ALARM / n, k))
    return float(k * f.isf(FALSE_ALARM / n, k, freedom) * left / freedom)


def drop_bad(model: Model, estimate: Estimate) -> Estimate:
    """Solve again without the profiles that contradict the others.

    The worst one is taken out, again and again; the last that stood out tells how many are
    bad, since bad ones may hide one another (generalised ESD, Rosner 1983,
    doi:10.1080/00401706.1983.10487848).
    """
    n, k = estimate.linearised.residuals.shape[:2]
    most = min(int(MOST_BAD * n), n - FEWEST_LEFT)
    chain, bad = [estimate], 0
    for i in range(most):
        now = chain[-1]
        misfit = np.where(now.used, deletions(now).chi2, 0.0)
        worst = int(np.argmax(misfit))
        left, freedom = now.chi2 - misfit[worst], now.freedom - k
        if misfit[worst] > threshold(now, left, freedom):
            bad = i + 1
        elif now.chi2 <= chi2.isf(FALSE_ALARM, now.freedom):
            break  # what is left agrees with itself
        used = now.used.copy()
        used[worst] = False
        chain.append(refine(model, now.T_f_s, now.target, used))
    return _readmit(model, chain[bad])


def _readmit(model: Model, estimate: Estimate) -> Estimate:
    """Take back what had only been blamed for another profile's error."""
    if estimate.used.all():
        return estimate
    limit = threshold(estimate, estimate.chi2, estimate.freedom)
    good = estimate.used | (deletions(estimate).chi2 < limit)
    if (good == estimate.used).all():
        return estimate
    again = refine(model, estimate.T_f_s, estimate.target, good)
    # Taken back together they must not bring the contradiction back.
    worst = np.where(good, deletions(again).chi2, 0.0).max()
    return again if worst < threshold(again, again.chi2, again.freedom) else estimate
