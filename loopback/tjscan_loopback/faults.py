"""Faults that can be commanded in a line, and the number behind them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, TypeVar

from tjscan.core.errors import ConfigurationError, nearest_word

F = TypeVar("F", bound=StrEnum)


@dataclass(frozen=True, slots=True)
class ScheduledFault(Generic[F]):
    """A fault to inject, and when it comes.

    Parameters
    ----------
    fault : StrEnum
        What.
    when : int
        After how many moves, or cycles of motion, from now; 0: at once.
    """

    fault: F
    when: int = 0


def split_fault(line: str, kinds: type[F]) -> tuple[F, str]:
    """Split a line into the fault that it begins with, and what follows.

    Raises
    ------
    ConfigurationError
        If there is no such fault.
    """
    word, _, rest = line.strip().partition(" ")
    if word not in list(kinds):
        close = nearest_word(word, list(kinds))
        raise ConfigurationError(f"there is no fault {word!r}; did you mean: {close}?")
    return kinds(word), rest.strip()


def parse_scheduled_fault(line: str, kinds: type[F], when: str) -> ScheduledFault[F]:
    """Parse ``FAULT`` (at once) or ``FAULT N`` (later, as the words `when` state it).

    Raises
    ------
    ConfigurationError
        If it is neither.
    """
    fault, number = split_fault(line, kinds)
    if number and not (number.isdecimal() and int(number) >= 1):
        raise ConfigurationError(f"a fault comes {when} (found {number!r})")
    return ScheduledFault(fault, int(number or 0))
