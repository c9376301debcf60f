"""What the loop of a tow knows of its vehicles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from tjscan.core.errors import VehicleFault
from tjscan.vehicle.vehicle import Vehicle, VehicleState


class Team(Protocol):
    """The vehicles, the welder last, whose states come together."""

    @property
    def vehicles(self) -> Sequence[Vehicle]:
        """All of them, connected."""
        ...

    @property
    def time(self) -> float:
        """Seconds on the team's clock: simulated time, or this computer's."""
        ...

    def advance_to(self, time: float) -> Sequence[VehicleState | VehicleFault]:
        """Wait until a time, and return each vehicle's newest state, or what is wrong with it."""
        ...
