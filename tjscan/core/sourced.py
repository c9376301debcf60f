"""Numbers that state where they come from; one that no one gave is absent, and never zero."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import isfinite
from typing import Final


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
