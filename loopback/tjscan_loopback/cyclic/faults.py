"""Faults that can be commanded, of answers, packets, the arm and its program."""

from __future__ import annotations

from enum import StrEnum
from typing import Final

FAULT_COMES: Final = "after 1, 2, ... cycles of motion"


class InjectedFault(StrEnum):
    """Fault that can be injected into a loopback controller, or its remedy."""

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
    """A packet is of another type."""
    MALFORMED = "malformed"
    """A packet is cut off."""
    WRONG_STAMP = "wrong-stamp"
    """The time stamp or number of a packet jumps."""
    FROZEN_STAMP = "frozen-stamp"
    """It stands."""
    STAND = "stand"
    """The arm stands, as at an emergency stop: the controller reports that as far as it can."""
    STOP_PROGRAM = "stop-program"
    """The program is stopped, and packets go on."""
    STOP = "stop"
    """Packets end."""
    CLEAR = "clear"
    """All is right again, and the program is started once it is listened to."""
    HOME = "home"
    """As that, with the arm where it was first."""
