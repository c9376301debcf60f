"""Numbers that state where they come from; one that no one gave is absent, and never zero."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import isfinite
from statistics import fmean
from typing import Any, Final

from tjscan.core.units import FileUnit


class NumberSource(StrEnum):
    """Where a number comes from."""

    MEASURED = "measured"
    SET = "set"
    BELIEVED = "believed"
    SIMULATED = "simulated"
    ABSENT = "absent"


@dataclass(frozen=True, slots=True)
class SourcedNumber:
    """A number and its source.

    Parameters
    ----------
    value : float or None
        In SI units; None exactly if the source is `NumberSource.ABSENT`.
    source : NumberSource

    Raises
    ------
    ValueError
        If there is a number without a source, a source without a number, or it is not finite.
    """

    value: float | None
    source: NumberSource

    def __post_init__(self) -> None:
        if (self.value is None) != (self.source is NumberSource.ABSENT):
            raise ValueError(f"the number {self.value} can't be {self.source}")
        if self.value is not None and not isfinite(self.value):
            raise ValueError(f"{self.value} is no number")

    def in_unit(self, factor: float) -> SourcedNumber:
        """The same in a unit of which one is `factor` in SI units."""
        return self if self.value is None else SourcedNumber(self.value / factor, self.source)


ABSENT_NUMBER: Final = SourcedNumber(None, NumberSource.ABSENT)
"""A number that no one gave."""


def mean_of_numbers(
    numbers: Sequence[SourcedNumber], of: Callable[[list[float]], float] = fmean
) -> SourcedNumber:
    """Mean, or another function, of numbers of one source; absent if one of them is."""
    values = [one.value for one in numbers if one.value is not None]
    if not numbers or len(values) < len(numbers):
        return ABSENT_NUMBER
    return SourcedNumber(float(of(values)), numbers[0].source)


def value_entry(value: float | None, source: NumberSource, unit: FileUnit) -> dict[str, Any]:
    """A number as a log has it; None is absent, whatever its source would be."""
    return number_entry(
        ABSENT_NUMBER if value is None else SourcedNumber(float(value), source), unit
    )


def number_entry(number: SourcedNumber, unit: FileUnit) -> dict[str, Any]:
    """A number as a log has it: with its unit and its source."""
    shown = number.in_unit(unit.factor)
    value = None if shown.value is None else float(f"{shown.value:.6g}")
    return {"value": value, "unit": unit.suffix, "source": str(number.source)}
