"""Faults that can be commanded, and when they come."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from tjscan.core.errors import ConfigurationError, nearest_word


class InjectedFault(StrEnum):
    """Fault that can be injected into the loopback controller, or its remedy."""

    PROTECTIVE_STOP = "protective-stop"
    EMERGENCY_STOP = "emergency-stop"
    POWER_OFF = "power-off"
    LOCAL_MODE = "local-mode"
    DROP_LINK = "drop-link"
    DROP_DASHBOARD = "drop-dashboard"
    CLOSE_DASHBOARD = "close-dashboard"
    FREEZE = "freeze"
    REFUSE_TARGETS = "refuse-targets"
    STOP_PROGRAM = "stop-program"
    MISS_TARGET = "miss-target"
    REFUSE_STOP = "refuse-stop"
    LOSE_PACKETS = "lose-packets"
    LATE_PACKETS = "late-packets"
    DOUBLE_PACKETS = "double-packets"
    REORDER_PACKETS = "reorder-packets"
    FREEZE_REGISTERS = "freeze-registers"
    SLIDER_ZERO = "slider-zero"
    SLIDER_HALF = "slider-half"
    SLIDER_FULL = "slider-full"
    CLEAR = "clear"
    HOME = "home"


@dataclass(frozen=True, slots=True)
class ScheduledFault:
    """A fault to inject, and the move in which it comes.

    Parameters
    ----------
    fault : InjectedFault
        What.
    move : int
        0: at once. Else half way through the move of this number, counted from now.
    """

    fault: InjectedFault
    move: int = 0


def parse_scheduled_fault(line: str) -> ScheduledFault:
    """Parse ``FAULT`` (at once) or ``FAULT N`` (half way through the N-th move from now).

    Raises
    ------
    ConfigurationError
        If it is neither.
    """
    word, _, when = line.strip().partition(" ")
    if word not in list(InjectedFault):
        close = nearest_word(word, list(InjectedFault))
        raise ConfigurationError(f"there is no fault {word!r}; did you mean: {close}?")
    if not when:
        return ScheduledFault(InjectedFault(word))
    if not when.strip().isdigit() or int(when) < 1:
        raise ConfigurationError(f"a fault comes in move 1, 2, ... (found {when.strip()!r})")
    return ScheduledFault(InjectedFault(word), int(when))
