"""The phases of a welding job, and which event leads from one to another."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Final


class Phase(StrEnum):
    """What the crawler does."""

    MANUAL = "manual"
    FORWARD_ALIGNMENT = "forward alignment"
    BACKWARD_ALIGNMENT = "backward alignment"
    READY = "ready"
    WELDING = "welding"
    RETURN = "return"
    STOP = "stop"


class Event(StrEnum):
    """What makes it go on to another phase."""

    JOINT_IN_VIEW = "joint in view"
    ALIGNED = "aligned"
    AT_START = "at the start"
    JOINT_BENDS = "joint bends"
    WELD_CONFIRMED = "weld confirmed"
    PASS_WELDED = "pass welded"
    TORCH_NOT_KNOWN = "torch not known well enough"
    JOINT_NOT_SEEN = "joint not seen well enough"
    PASSES_LEFT = "at the start, passes left"
    ALL_WELDED = "at the start, all welded"
    DANGER = "guard or operator"
    CLEARED = "cleared by the operator"


PHASE_TRANSITIONS: Final[Mapping[tuple[Phase, Event], Phase]] = MappingProxyType(
    {
        (Phase.MANUAL, Event.JOINT_IN_VIEW): Phase.FORWARD_ALIGNMENT,
        (Phase.FORWARD_ALIGNMENT, Event.ALIGNED): Phase.BACKWARD_ALIGNMENT,
        (Phase.BACKWARD_ALIGNMENT, Event.JOINT_BENDS): Phase.FORWARD_ALIGNMENT,
        (Phase.BACKWARD_ALIGNMENT, Event.AT_START): Phase.READY,
        (Phase.READY, Event.WELD_CONFIRMED): Phase.WELDING,
        (Phase.WELDING, Event.PASS_WELDED): Phase.RETURN,
        (Phase.WELDING, Event.TORCH_NOT_KNOWN): Phase.RETURN,
        (Phase.WELDING, Event.JOINT_NOT_SEEN): Phase.RETURN,
        (Phase.RETURN, Event.PASSES_LEFT): Phase.READY,
        (Phase.RETURN, Event.ALL_WELDED): Phase.MANUAL,
        (Phase.STOP, Event.CLEARED): Phase.MANUAL,
        **{(phase, Event.DANGER): Phase.STOP for phase in Phase},
    }
)
"""Figure 2 of Kermorgant (2018), its alignment split in two, and a stop that holds."""


def next_phase(phase: Phase, event: Event) -> Phase:
    """Phase that an event leads to.

    Raises
    ------
    ValueError
        If the event can't happen in that phase.
    """
    if (phase, event) not in PHASE_TRANSITIONS:
        raise ValueError(f"in phase {phase} there is no event {event}")
    return PHASE_TRANSITIONS[phase, event]
