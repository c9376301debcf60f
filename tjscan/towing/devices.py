"""What the loop of a tow knows of vehicles and of who measures their poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from tjscan.core.errors import VehicleFault
from tjscan.vehicle.vehicle import Vehicle, VehicleState


class TimedPose(Protocol):
    """Pose of a vehicle in frame w, as measured."""

    @property
    def time(self) -> float:
        """When it was measured, seconds on the team's clock."""
        ...

    @property
    def x(self) -> float:
        """Of the vehicle's origin, metres."""
        ...

    @property
    def y(self) -> float:
        """Of the vehicle's origin, metres."""
        ...

    @property
    def heading(self) -> float:
        """From x towards y, radians."""
        ...


class Localisation(Protocol):
    """Measures the vehicles' poses."""

    def read(self) -> Sequence[TimedPose | None]:
        """Return the newest pose of each vehicle since the last time; None where none came."""
        ...


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
