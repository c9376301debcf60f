"""Rows that belong together, and what they have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.study.row import Measured, Row
from tjscan.study.task import Value

SEED: Final = "simulation.seed"


def varied(rows: Sequence[Row]) -> dict[str, list[Value]]:
    """Keys that take several values, and these in the order in which they come."""
    found: dict[str, dict[Value, None]] = {}
    for row in rows:
        for key, value in row.inputs.items():
            found.setdefault(key, {})[value] = None
    return {key: list(values) for key, values in found.items() if len(values) > 1}


@dataclass(frozen=True, slots=True)
class Group:
    """Rows that share a value of one key, or of several.

    Parameters
    ----------
    rows : tuple of Row
        One at least.
    """

    rows: tuple[Row, ...]

    @property
    def complete(self) -> tuple[Row, ...]:
        """Those whose scan did what was asked."""
        return tuple(row for row in self.rows if row.measured.complete)

    @property
    def share(self) -> float:
        """How many of them are complete, from 0 to 1."""
        return len(self.complete) / len(self.rows)

    def mean(self, what: Callable[[Measured], float | None]) -> float:
        """Mean over the complete rows; NaN where nothing is known."""
        values = [what(row.measured) for row in self.complete]
        known = [value for value in values if value is not None]
        return float(np.mean(known)) if known else float("nan")


def group(rows: Iterable[Row], *keys: str) -> dict[tuple[Value | None, ...], Group]:
    """Rows by their values of some keys, in the order in which they come."""
    sorted_: dict[tuple[Value | None, ...], list[Row]] = {}
    for row in rows:
        sorted_.setdefault(tuple(row.inputs.get(key) for key in keys), []).append(row)
    return {values: Group(tuple(members)) for values, members in sorted_.items()}
