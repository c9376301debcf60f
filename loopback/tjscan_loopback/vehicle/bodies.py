"""What moves behind a loopback vehicle, and which faults it can have."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Final, Protocol

from tjscan.core.frames import Array
from tjscan.vehicle.pose_disturbance import PoseFault
from tjscan.vehicle.simulated_body import SimulatedBody
from tjscan.vehicle.vehicle import Twist, VehicleState
from tjscan_loopback.vehicle.faults import VehicleFaultOrder

Faults = frozenset[VehicleFaultOrder]

SPINNING_GRIP: Final = 1 / 3
"""Share of their tracks' motion that crawlers follow while these spin."""

ON_TRACKS: Final = frozenset(
    {VehicleFaultOrder.SLIP, VehicleFaultOrder.EDGE, VehicleFaultOrder.ARC}
)
"""Faults that a crawler alone can have."""

AT_A_CABLE: Final = frozenset(
    {
        VehicleFaultOrder.STOP,
        VehicleFaultOrder.PUSH,
        VehicleFaultOrder.PASSER_STANDS,
        VehicleFaultOrder.POSE_CLOCK,
        *(VehicleFaultOrder(fault.value) for fault in PoseFault),
    }
)
"""Faults that vehicles at a cable alone can have."""


class LoopbackBody(Protocol):
    """The simulated thing that a loopback vehicle drives."""

    possible_faults: Faults
    """That it can have."""

    drives_sideways: bool

    arc_burning: bool
    """Whether an arc burns on it."""

    @property
    def time(self) -> float:
        """Seconds on its clock."""
        ...

    @property
    def at_rest(self) -> bool:
        """Whether it is at rest."""
        ...

    @property
    def braking_time(self) -> float:
        """Seconds in which it brakes from its top speed."""
        ...

    def take_faults(self, faults: Faults) -> None:
        """Have these faults from now on, and no others."""
        ...

    def push(self) -> None:
        """Be carried away once."""
        ...

    def advance(self, twist: Twist | None, period: float) -> VehicleState:
        """Drive a twist for a period in seconds, or brake, and report the state."""
        ...

    @property
    def own_pose(self) -> Array | None:
        """Where it is, x, y, heading, shape (3,), if it knows and sends that itself."""
        ...


class CrawlerBody:
    """A crawler on two tracks.

    Parameters
    ----------
    body : SimulatedBody
    """

    possible_faults = frozenset(VehicleFaultOrder) - AT_A_CABLE
    drives_sideways = False

    def __init__(self, body: SimulatedBody) -> None:
        self._body = body
        self.arc_burning = False
        self._faults: Faults = frozenset()

    @property
    def time(self) -> float:
        """See `LoopbackBody.time`."""
        return self._body.time

    @property
    def at_rest(self) -> bool:
        """See `LoopbackBody.at_rest`."""
        return self._body.at_rest

    @property
    def braking_time(self) -> float:
        """See `LoopbackBody.braking_time`."""
        return self._body.braking_time

    def take_faults(self, faults: Faults) -> None:
        """See `LoopbackBody.take_faults`."""
        self._faults = faults

    def push(self) -> None:
        """Nothing: magnets hold it."""

    def advance(self, twist: Twist | None, period: float) -> VehicleState:
        """See `LoopbackBody.advance`."""
        self._body.arc_burning = self.arc_burning
        grip = SPINNING_GRIP if VehicleFaultOrder.SLIP in self._faults else 1.0
        state = self._body.advance(twist, period=period, grip=grip)
        if VehicleFaultOrder.EDGE in self._faults and state.proximity:
            state = replace(state, proximity=(inf, inf, *state.proximity[2:]))
        return state

    @property
    def own_pose(self) -> Array:
        """See `LoopbackBody.own_pose`."""
        return self._body.plant.pose_w
