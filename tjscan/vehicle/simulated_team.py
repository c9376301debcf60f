"""Simulated vehicles that hold one cable: each a `Vehicle`, all on one clock."""

from __future__ import annotations

from typing import Self

from tjscan.core.devices import DeviceIdentity
from tjscan.core.errors import DriveFault, VehicleFault
from tjscan.vehicle.cable.world import TowingWorld
from tjscan.vehicle.simulated_body import STATE_PERIOD
from tjscan.vehicle.vehicle import LocalVehicle, Twist, VehicleState, latest_state


class SimulatedTeam:
    """Vehicles that hold the cable of a simulated world, which goes on as their states are read.

    `advance_to` lets the world go on for all of them. A vehicle's own `next_state` gives the newest
    state that it has not given yet; if there is none, it lets the world go on by one period. So
    a reader of all of them in turn moves the clock once a turn.

    A context manager: entering connects all vehicles.

    Parameters
    ----------
    world : TowingWorld
    """

    def __init__(self, world: TowingWorld) -> None:
        self.world = world
        self.vehicles = tuple(TeamVehicle(self, which) for which in range(world.vehicles))
        """In their order along the cable; the last is the welder."""

    def __enter__(self) -> Self:
        """Connect all vehicles."""
        for vehicle in self.vehicles:
            vehicle.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        """Stop and disconnect all vehicles."""
        for vehicle in self.vehicles:
            vehicle.__exit__()

    @property
    def time(self) -> float:
        """What the clock of all vehicles shows, seconds."""
        return self.world.time

    def advance_to(self, time: float) -> tuple[VehicleState | VehicleFault, ...]:
        """Let the world go on, if it has not come that far, and give each vehicle's newest state.

        Parameters
        ----------
        time : float
            Seconds on the team's clock.
        """
        while self.world.time < time - STATE_PERIOD / 2:
            self.advance()
        return tuple(vehicle.newest_state() for vehicle in self.vehicles)

    def advance(self) -> None:
        """Let the world go on by one period."""
        for vehicle in self.vehicles:
            self.world.order(vehicle.which, vehicle.twist_to_drive())
        self.world.advance(STATE_PERIOD)
        for vehicle in self.vehicles:
            vehicle.take_state()


class TeamVehicle(LocalVehicle):
    """One vehicle of a simulated team, behind the `Vehicle` protocol; it drives sideways too.

    Parameters
    ----------
    team : SimulatedTeam
    which : int
        Its place along the cable, from 0.
    """

    def __init__(self, team: SimulatedTeam, which: int) -> None:
        self.which, self._team = which, team
        self._state = team.world.state(which)
        self._unread: list[VehicleState] = []

    @property
    def identity(self) -> DeviceIdentity:
        """Which vehicle it is."""
        return DeviceIdentity("simulated towing vehicle", str(self.which + 1))

    @property
    def time(self) -> float:
        """What the clock of all vehicles shows, seconds."""
        return self._team.time

    def check_drives(self, twist: Twist) -> None:
        """Refuse to drive with a fault."""
        if self._state.fault:
            raise DriveFault(
                f"the vehicle reports: {self._state.fault}. Mend it, then start again."
            )

    def next_state(self) -> VehicleState:
        """Report the newest state; go on by one period if it is known already.

        See `Vehicle.next_state` and `SimulatedTeam`.
        """
        self.check_connected()
        if not self._unread:
            self._team.advance()
        return self.newest_state()

    # What the team asks of it

    def take_state(self) -> None:
        """Look at the world."""
        self._state = self._team.world.state(self.which)
        self._unread.append(self._state)

    def newest_state(self) -> VehicleState:
        """The state when the world last went on, with the mean motion since it was read."""
        states, self._unread = self._unread or [self._state], []
        return latest_state(states)
