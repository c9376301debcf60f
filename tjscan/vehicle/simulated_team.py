"""Simulated vehicles that hold one cable, all on one clock, and what sees where they are."""

from __future__ import annotations

from math import isfinite
from typing import Final, Self

from tjscan.core.devices import DeviceIdentity, LocalDevice
from tjscan.core.errors import DriveFault, VehicleFault
from tjscan.vehicle.cable.world import TowingWorld
from tjscan.vehicle.localisation import TrackedDisc, VehiclePose
from tjscan.vehicle.mqtt.wire import REPORTED_DROP_COUNTS
from tjscan.vehicle.pose_disturbance import DisturbedPoses, LocalisationSimulationSettings
from tjscan.vehicle.simulated_body import VEHICLE_STATE_PERIOD
from tjscan.vehicle.vehicle import LocalVehicle, Twist, VehicleState, merge_unread_states


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
        while self.world.time < time - VEHICLE_STATE_PERIOD / 2:
            self.advance()
        return tuple(vehicle.newest_state() for vehicle in self.vehicles)

    def advance(self) -> None:
        """Let the world go on by one period."""
        for vehicle in self.vehicles:
            self.world.order(vehicle.which, vehicle.twist_to_drive())
        self.world.advance(VEHICLE_STATE_PERIOD)
        for vehicle in self.vehicles:
            vehicle.read_own_world_state()


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

    def check_twist_is_drivable(self, twist: Twist) -> None:
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

    def read_own_world_state(self) -> None:
        """Keep the state that the world has for this vehicle."""
        self._state = self._team.world.state(self.which)
        self._unread.append(self._state)

    def newest_state(self) -> VehicleState:
        """The state when the world last went on, with the mean motion since it was read."""
        states, self._unread = self._unread or [self._state], []
        return merge_unread_states(states)


NOT_A_POSE_REASON: Final = "it holds NaN"
OUT_OF_ORDER_REASON: Final = "it came after a later one"


class SimulatedLocalisation(LocalDevice):
    """Sees the vehicles of a simulated world, behind the `Localisation` protocol.

    Its clock is the world's. Passers-by are seen as they are.

    Parameters
    ----------
    world : TowingWorld
    settings : LocalisationSimulationSettings
        Noise, loss and delay.
    seed : int, optional
    """

    def __init__(
        self, world: TowingWorld, settings: LocalisationSimulationSettings, *, seed: int = 0
    ) -> None:
        self.poses = DisturbedPoses(settings, seed)
        """On their way; their faults may be set."""
        self.dropped = 0
        self._world = world
        self._seen = world.time
        self._given = [-float("inf")] * world.vehicles

    @property
    def identity(self) -> DeviceIdentity:
        """Which device it is."""
        return DeviceIdentity("simulated localisation")

    def read(self) -> tuple[VehiclePose | None, ...]:
        """Give the newest poses. See `Localisation.read`."""
        for time, poses in self._world.poses_before:
            if time > self._seen:
                self.poses.observe_vehicles(time, poses)
        self._seen = self._world.time
        newest: list[VehiclePose | None] = [None] * self._world.vehicles
        for vehicle, pose in self.poses.poses_arrived_until(self._world.time):
            if not isfinite(pose.x + pose.y + pose.heading):
                self._report_dropped(vehicle, NOT_A_POSE_REASON)
            elif pose.time <= self._given[vehicle]:
                self._report_dropped(vehicle, OUT_OF_ORDER_REASON)
            else:
                newest[vehicle], self._given[vehicle] = pose, pose.time
        return tuple(newest)

    def read_passers_by(self) -> tuple[TrackedDisc, ...]:
        """Give where they are now. See `Localisation.read_passers_by`."""
        return tuple(
            TrackedDisc(self._world.time, *disc) for disc in self._world.passers_by.tolist()
        )

    def _report_dropped(self, vehicle: int, why: str) -> None:
        self.dropped += 1
        if self.dropped in REPORTED_DROP_COUNTS:
            self._listener(
                "message-dropped", f"pose of vehicle {vehicle + 1}, number {self.dropped}: {why}"
            )
