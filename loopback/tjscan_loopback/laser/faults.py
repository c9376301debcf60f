"""Faults of the loopback laser that can be commanded."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from tjscan.core.errors import ConfigurationError
from tjscan_loopback.faults import split_fault


class LaserFaultOrder(StrEnum):
    """A fault of the sensor or its network, or the remedy for all of them."""

    LOSS = "loss"
    DUPLICATE = "duplicate"
    REORDER = "reorder"
    LOSE_LEADER = "lose-leader"
    LOSE_TRAILER = "lose-trailer"
    LATE = "late"
    STALE = "stale"
    BUFFERED = "buffered"
    SILENT = "silent"
    TAKEN = "taken"
    REBOOT = "reboot"
    WRONG_FORMAT = "wrong-format"
    UNIT_PIXEL = "unit-pixel"
    MISSING_FEATURES = "missing-features"
    ALL_INVALID = "all-invalid"
    NO_CLOCK = "no-clock"
    COARSE_CLOCK = "coarse-clock"
    WRONG_CLOCK = "wrong-clock"
    NO_STAMP = "no-stamp"
    NARROW = "narrow"
    NEW_OFFSET = "new-offset"
    NEW_EXPOSURE = "new-exposure"
    NO_TRIGGER = "no-trigger"
    CLEAR = "clear"


DEFAULT_LOSS = 1.0
"""Per cent of packets that are lost if a line states no number."""


@dataclass(frozen=True, slots=True)
class OrderedLaserFault:
    """A fault to bring.

    Parameters
    ----------
    fault : LaserFaultOrder
        What.
    per_cent : float
        Of the packets that are lost, for `LaserFaultOrder.LOSS`.
    """

    fault: LaserFaultOrder
    per_cent: float = DEFAULT_LOSS


def parse_laser_fault(line: str) -> OrderedLaserFault:
    """Parse ``FAULT``, or ``loss PER_CENT``.

    Raises
    ------
    ConfigurationError
        If it is neither.
    """
    fault, number = split_fault(line, LaserFaultOrder)
    if not number:
        return OrderedLaserFault(fault)
    try:
        per_cent = float(number)
    except ValueError:
        per_cent = -1.0
    if fault is not LaserFaultOrder.LOSS or not 0 <= per_cent <= 100:
        raise ConfigurationError(
            f"only loss takes a number, 0 to 100 per cent (found {line.strip()!r})"
        )
    return OrderedLaserFault(fault, per_cent)
