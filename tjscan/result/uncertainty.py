"""``uncertainty.json``: the whole uncertainty budget of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic_core import to_json

from tjscan.core.config import read_json_as_written
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.core.units import DEG, MM, MM2
from tjscan.uncertainty.budget import COVERAGE_FACTOR, BudgetComponent, UncertaintyBudget

MOST_BUDGET_BYTES: Final = 100_000_000
"""A larger file is no budget: a section takes some ten kilobytes."""

SIGNIFICANT_DIGITS: Final = 6
"""Of the largest number of a component."""

_MEASURE_UNITS: Final = np.array((DEG.factor, MM.factor, MM.factor, MM2.factor))


@dataclass(frozen=True, slots=True)
class ComponentInFile:
    """A component in the file."""

    name: str
    evidence: str
    shared: bool
    points_mm: list[list[list[list[float]]]]
    measures: list[list[list[float]]]


@dataclass(frozen=True, slots=True)
class BudgetFile:
    """The file: how p1 to p5 (millimetres) and the measures (degrees, mm, mm²) answer to draws."""

    provenance: Provenance | None
    coverage_factor: float
    components: list[ComponentInFile]


def write_budget(file: Path, budget: UncertaintyBudget, provenance: Provenance) -> None:
    """Write ``uncertainty.json``: the whole of a budget, so that correlations can be computed."""
    components = [
        ComponentInFile(
            one.name,
            one.evidence,
            one.is_shared,
            _rounded_lists(one.points / MM.factor),
            _rounded_lists(one.measures / _MEASURE_UNITS[:, None]),
        )
        for one in budget.components
    ]
    file.write_bytes(to_json(BudgetFile(provenance, COVERAGE_FACTOR, components)) + b"\n")


def _rounded_lists(values: Array) -> Any:
    """Values to so many digits, as nested lists."""
    size = np.abs(values).max(initial=0.0)
    decimals = SIGNIFICANT_DIGITS - int(np.floor(np.log10(size))) if size > 0 else 0
    return np.round(values, decimals).tolist()


def read_budget(file: Path, count: int) -> UncertaintyBudget | None:
    """Read ``uncertainty.json``; None if a run has none, as one of an earlier version.

    Parameters
    ----------
    file : Path
        The file.
    count : int
        Sections of the run.

    Raises
    ------
    ConfigurationError
        If it is damaged, or of other sections.
    """
    if not file.is_file():
        return None
    found = read_json_as_written(BudgetFile, file, MOST_BUDGET_BYTES, "budget of uncertainty")
    try:
        parts = tuple(
            BudgetComponent(
                one.name,
                one.evidence,
                one.shared,
                np.reshape(one.points_mm, (count, 5, 3, -1)) * MM.factor,
                np.reshape(one.measures, (count, 4, -1)) * _MEASURE_UNITS[:, None],
            )
            for one in found.components
        )
    except ValueError:
        parts = ()
    if not parts or any(one.points.shape[-1] != one.measures.shape[-1] for one in parts):
        raise ConfigurationError(f"is not of the {count} sections beside it", file=file)
    return UncertaintyBudget(parts)
