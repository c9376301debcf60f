"""Rows that belong together, and what they have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from tjscan.study.row import RunOutcome, StudyRow
from tjscan.study.trial import Value

O = TypeVar("O", bound=RunOutcome)  # noqa: E741


def varied_values_by_key(rows: Sequence[StudyRow[Any]]) -> dict[str, list[Value]]:
    """Keys that take several values in the rows of a study, with these values."""
    found: dict[str, dict[Value, None]] = {}
    for row in rows:
        for key, value in row.inputs.items():
            found.setdefault(key, {})[value] = None
    return {key: list(values) for key, values in found.items() if len(values) > 1}


@dataclass(frozen=True, slots=True)
class RowGroup(Generic[O]):
    """Rows of a study that share the value of one key, or of several.

    Parameters
    ----------
    rows : tuple of StudyRow
        One at least.
    """

    rows: tuple[StudyRow[O], ...]

    @property
    def complete_rows(self) -> tuple[StudyRow[O], ...]:
        """The rows whose run did what was asked."""
        return tuple(row for row in self.rows if row.outcome.complete)

    @property
    def complete_share(self) -> float:
        """Share of the rows that are complete, from 0 to 1."""
        return len(self.complete_rows) / len(self.rows)

    def mean_of_complete(self, value: Callable[[O], float | None]) -> float:
        """Mean of a quantity over the complete rows; NaN where nothing is known."""
        values = [value(row.outcome) for row in self.complete_rows]
        known = [value for value in values if value is not None]
        return float(np.mean(known)) if known else float("nan")


def group_rows_by_keys(
    rows: Iterable[StudyRow[O]], *keys: str
) -> dict[tuple[Value | None, ...], RowGroup[O]]:
    """Group the rows of a study by their values of some keys, in the order in which they come.

    Parameters
    ----------
    rows : iterable of StudyRow
        What is grouped.
    *keys : str
        Dotted keys.
    """
    sorted_: dict[tuple[Value | None, ...], list[StudyRow[O]]] = {}
    for row in rows:
        sorted_.setdefault(tuple(row.inputs.get(key) for key in keys), []).append(row)
    return {values: RowGroup(tuple(members)) for values, members in sorted_.items()}
