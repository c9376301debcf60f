"""Which profiles contradict the others: taken out one by one, the worst first."""

from __future__ import annotations

from itertools import combinations
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
FREEDOM_LEFT: Final = 0.5
"""Share of the degrees of freedom that must remain: with few left, any lines agree."""
LARGEST_SET: Final = 3
MOST_SETS: Final = 3000
"""Bad profiles looked for together, and sets tried: three among 26."""
RIDGE: Final = 1e-6
"""Keeps sets solvable without which nothing could be found; they leave no residual anyway."""


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
    doi:10.1080/00401706.1983.10487848). Where bad ones even put the blame on good ones, and
    what is left contradicts itself, small sets are tried whole.
    """
    found = _one_by_one(model, estimate)
    if agrees(found):
        return found
    together = _together(model, estimate)
    return found if together is None else together


def agrees(estimate: Estimate) -> bool:
    """Whether what is left is as small as stated errors explain."""
    if estimate.freedom <= 0:
        return True
    return bool(estimate.chi2 <= chi2.isf(FALSE_ALARM, estimate.freedom))


def _together(model: Model, estimate: Estimate) -> Estimate | None:
    """Solve without the smallest set whose absence makes the others agree, if there is one."""
    lin = estimate.linearised
    n, k = lin.residuals.shape
    whiten = np.linalg.inv(np.linalg.cholesky(lin.covariance))
    r = np.einsum("nij,nj->ni", whiten, lin.residuals)
    J = whiten @ np.concatenate((lin.by_pose, lin.by_target), axis=2)
    # What the fit leaves of errors in the residuals, block by block.
    left = np.eye(n * k) - J.reshape(n * k, -1) @ estimate.covariance @ J.reshape(n * k, -1).T
    blocks = left.reshape(n, k, n, k).transpose(0, 2, 1, 3)
    for size in range(2, min(LARGEST_SET, _most(estimate)) + 1):
        sets = np.array(list(combinations(range(n), size)))
        if len(sets) > MOST_SETS:
            break
        inner = blocks[sets[:, :, None], sets[:, None, :]].transpose(0, 1, 3, 2, 4)
        inner = inner.reshape(len(sets), size * k, size * k) + RIDGE * np.eye(size * k)
        r_set = r[sets].reshape(len(sets), size * k, 1)
        drop = (r_set * np.linalg.solve(inner, r_set)).sum(axis=(1, 2))
        used = np.ones(n, dtype=bool)
        used[sets[int(np.argmax(drop))]] = False
        found = refine(model, estimate.T_f_s, estimate.target, used)
        if agrees(found):
            return found
    return None


def _most(estimate: Estimate) -> int:
    """How many profiles may be bad, from an estimate that uses all of them."""
    n, k = estimate.linearised.residuals.shape
    checked = int((1 - FREEDOM_LEFT) * estimate.freedom / k)
    return max(0, min(int(MOST_BAD * n), n - FEWEST_LEFT, checked))


def _one_by_one(model: Model, estimate: Estimate) -> Estimate:
    n, k = estimate.linearised.residuals.shape[:2]
    chain, bad = [estimate], 0
    for i in range(_most(estimate)):
        now = chain[-1]
        misfit = np.where(now.used, deletions(now).chi2, 0.0)
        worst = int(np.argmax(misfit))
        left, freedom = now.chi2 - misfit[worst], now.freedom - k
        if misfit[worst] > threshold(now, left, freedom):
            bad = i + 1
        elif agrees(now):
            break
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
