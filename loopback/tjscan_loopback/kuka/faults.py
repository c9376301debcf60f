"""Faults that can be commanded, and when they come."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from tjscan.core.errors import ConfigurationError, nearest_word


class InjectedFault(StrEnum):
    """Fault that can be injected into the loopback controller, or its remedy."""

    LOSE_ANSWER = "lose-answer"
    """One answer gets lost."""
    LOSE_ANSWERS = "lose-answers"
    """All answers do."""
    LATE_ANSWER = "late-answer"
    """One answer comes a cycle late."""
    UNANSWERED = "unanswered"
    """Its clock goes on without waiting for answers, as when the other computer is held up."""
    LOSE_PACKET = "lose-packet"
    """One packet gets lost."""
    LOSE_PACKETS = "lose-packets"
    """Ten in a row do."""
    DOUBLE_PACKET = "double-packet"
    """A packet comes twice."""
    OLD_PACKET = "old-packet"
    """The packet before comes again."""
    FOREIGN_PACKET = "foreign-packet"
    """A packet comes from another address, and one from another port."""
    WRONG_TYPE = "wrong-type"
    """A packet is of another Type."""
    MALFORMED = "malformed"
    """A packet is cut off."""
    WRONG_IPOC = "wrong-ipoc"
    """The time stamp jumps by a part of a cycle."""
    FROZEN_IPOC = "frozen-ipoc"
    """The time stamp stands."""
    STAND = "stand"
    """The arm stands, and RSI goes on, as at an emergency stop."""
    STOP_PROGRAM = "stop-program"
    """The program is stopped, and RSI goes on."""
    STOP = "stop"
    """RSI ends."""
    CLEAR = "clear"
    """All is right again, and the program is started once it is listened to."""
    HOME = "home"
    """As that, with the arm where it was first."""


@dataclass(frozen=True, slots=True)
class ScheduledFault:
    """A fault to inject, and when it comes.

    Parameters
    ----------
    fault : InjectedFault
        What.
    cycles : int
        In how many cycles in which the arm is moved from now; 0: at once.
    """

    fault: InjectedFault
    cycles: int = 0


def parse_scheduled_fault(line: str) -> ScheduledFault:
    """Parse ``FAULT`` (at once) or ``FAULT N`` (after N cycles of motion).

    Raises
    ------
    ConfigurationError
        If it is neither.
    """
    word, _, when = line.strip().partition(" ")
    if word not in list(InjectedFault):
        close = nearest_word(word, list(InjectedFault))
        raise ConfigurationError(f"there is no fault {word!r}; did you mean: {close}?")
    if when and not (when.strip().isdigit() and int(when) >= 1):
        raise ConfigurationError(f"a fault comes after 1, 2, ... cycles (found {when.strip()!r})")
    return ScheduledFault(InjectedFault(word), int(when or 0))
