"""Faults that a loopback vehicle can be given."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from tjscan.core.errors import ConfigurationError
from tjscan_loopback.faults import split_fault


class VehicleFaultOrder(StrEnum):
    """Fault that a loopback vehicle can be given, or its remedy."""

    DRIVE_FAULT = "drive-fault"
    """A drive fails: both brake, and the states report it."""
    DROP_LINK = "drop-link"
    """The connection to the broker breaks."""
    FREEZE = "freeze"
    """The vehicle's computer hangs: it sends and hears nothing, and its drives stop it."""
    STALE = "stale"
    """The same state is sent again and again."""
    NAN = "nan"
    """States hold NaN."""
    SLIP = "slip"
    """The tracks spin: the body follows a third of their motion."""
    EDGE = "edge"
    """The front sensors see no steel."""
    ARC = "arc"
    """An arc burns, and disturbs the proximity sensors."""
    STOP = "stop"
    """The wheels lock, until all is right again."""
    PUSH = "push"
    """The floor carries the vehicle 0.2 m to its right; once, and the wheels do not see it."""
    POSE_NOISE = "pose-noise"
    """Its poses scatter by 3 mm and 1° more."""
    POSE_LOST = "pose-lost"
    """No poses of it come."""
    POSE_LATE = "pose-late"
    """Its poses come 0.3 s later."""
    POSE_DISORDER = "pose-disorder"
    """Every second pose of it comes after its follower."""
    POSE_FROZEN = "pose-frozen"
    """The same pose of it is sent again and again, as if it were new."""
    POSE_JUMP = "pose-jump"
    """Its poses lie 0.5 m off."""
    POSE_SWAP = "pose-swap"
    """Its poses and its neighbour's are exchanged: 1 and 2, 3 and 4, and so on."""
    POSE_NAN = "pose-nan"
    """Its poses hold NaN."""
    POSE_CLOCK = "pose-clock"
    """The clock that its poses are dated by goes an hour wrong."""
    PASSER_STANDS = "passer-stands"
    """The person who walks through the area stops."""
    CLEAR = "clear"
    """All is right again."""


@dataclass(frozen=True, slots=True)
class OrderedFault:
    """A fault, and which vehicle it is for.

    Parameters
    ----------
    fault : VehicleFaultOrder
        What.
    vehicle : int
        Its number; 0 is all of them.
    """

    fault: VehicleFaultOrder
    vehicle: int = 0


def parse_ordered_fault(line: str, vehicles: int) -> OrderedFault:
    """Parse ``FAULT`` (for every vehicle) or ``FAULT N`` (for one of them).

    Raises
    ------
    ConfigurationError
        If it is neither.
    """
    fault, which = split_fault(line, VehicleFaultOrder)
    if which and not (which.isdecimal() and 1 <= int(which) <= vehicles):
        raise ConfigurationError(f"there are vehicles 1 to {vehicles} (found {which!r})")
    return OrderedFault(fault, int(which or 0))
