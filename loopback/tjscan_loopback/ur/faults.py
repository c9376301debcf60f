"""Faults that can be commanded."""

from __future__ import annotations

from enum import StrEnum
from typing import Final


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


FAULT_COMES: Final = "half way through move 1, 2, ..."
