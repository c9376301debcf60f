"""An uncertainty budget in a few numbers, for summaries, reports and comparisons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.core.units import DEG, MM, MM2
from tjscan.uncertainty.budget import COVERAGE_FACTOR, UncertaintyBudget

TYPICAL_QUANTILES: Final = (0.4, 0.6)
"""Quantiles between which a corner's combined uncertainty counts as typical."""

COMBINED_ROW: Final = "combined"

MEASURE_UNITS: Final = np.array((DEG.factor, MM.factor, MM.factor, MM2.factor))


@dataclass(frozen=True, slots=True)
class BudgetRow:
    """Standard uncertainties of typical corners and measures by one cause, or all together.

    Parameters
    ----------
    name, evidence : str
        The cause, and where its size comes from: observed, calibrated, stated or assumed.
    shared : bool
        Whether all sections err alike by it.
    corner_mm : float
        Of the place of a corner, all directions together.
    groove_angle_deg, root_width_mm, depth_mm, area_mm2 : float
        Of the measures.
    """

    name: str
    evidence: str
    shared: bool
    corner_mm: float
    groove_angle_deg: float
    root_width_mm: float
    depth_mm: float
    area_mm2: float


@dataclass(frozen=True, slots=True)
class BudgetSummary:
    """A budget in a few numbers: those of the middle fifth of all corners and measures.

    Squares of the components add up to the square of what is combined.

    Parameters
    ----------
    components : tuple of BudgetRow
        By cause.
    combined, expanded : BudgetRow
        Combined standard uncertainty, and that times the coverage factor.
    coverage_factor : float
        k.
    left_out : tuple of str
        What may err and is not in the budget, since nothing states how far.
    """

    components: tuple[BudgetRow, ...]
    combined: BudgetRow
    expanded: BudgetRow
    coverage_factor: float = COVERAGE_FACTOR
    left_out: tuple[str, ...] = ()


def budget_in_words(budget: BudgetSummary) -> str:
    """The combined and expanded uncertainty of a corner, and what makes most of it."""
    most = max(budget.components, key=lambda one: one.corner_mm)
    return (
        f"a corner is known to {budget.combined.corner_mm:.3f} mm (standard uncertainty), "
        f"{budget.expanded.corner_mm:.3f} mm expanded with k = {budget.coverage_factor:g}; most of "
        f"it by {most.name} ({most.evidence}, {most.corner_mm:.3f} mm)"
    )


def summarise_budget(
    budget: UncertaintyBudget, seen: NDArray[np.bool_], left_out: Sequence[str] = ()
) -> BudgetSummary:
    """Summarise a budget.

    Parameters
    ----------
    budget : UncertaintyBudget
        Of n sections.
    seen : ndarray of bool, shape (n, 3)
        Which of p2, p3 and p4 count: those that are absent don't.
    left_out : sequence of str
        What is not in the budget.
    """
    total = _typical(np.trace(budget.corner_covariances, axis1=-2, axis2=-1), seen)
    whole = np.diagonal(budget.measure_covariances, axis1=-2, axis2=-1)
    typical = [_typical(whole[:, k], np.ones(len(whole), bool)) for k in range(4)]
    combined = np.zeros(5)
    rows = []
    for one in budget.components:
        corners = np.trace(one.corner_covariances, axis1=-2, axis2=-1)[total].mean()
        by_measure = np.diagonal(one.measure_covariances, axis1=-2, axis2=-1)
        variances = [corners, *(by_measure[which, k].mean() for k, which in enumerate(typical))]
        combined += variances
        rows.append(_row(one.name, one.evidence, one.is_shared, np.sqrt(variances)))
    sigma = np.sqrt(combined)
    return BudgetSummary(
        tuple(rows),
        _row(COMBINED_ROW, "", False, sigma),
        _row(f"expanded, k = {COVERAGE_FACTOR:g}", "", False, COVERAGE_FACTOR * sigma),
        left_out=tuple(left_out),
    )


def _typical(variances: Array, counted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of the variances that count lie in the middle; all that count if none does."""
    chosen = variances[counted] if counted.any() else variances
    low = np.quantile(chosen, TYPICAL_QUANTILES[0], method="lower")
    high = np.quantile(chosen, TYPICAL_QUANTILES[1], method="higher")
    amid = (variances >= low) & (variances <= high)
    return np.asarray(amid & counted if counted.any() else amid)


def _row(name: str, evidence: str, shared: bool, sigmas: Array) -> BudgetRow:
    corner, *measures = sigmas.tolist()
    return BudgetRow(
        name, evidence, shared, corner / MM.factor, *(np.array(measures) / MEASURE_UNITS).tolist()
    )
