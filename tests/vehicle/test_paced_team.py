"""Real vehicles of a team are read each on its own: a silent one holds up no other."""

import threading
from typing import Self

import pytest

from tjscan.core.devices import DeviceIdentity, EventListener
from tjscan.core.errors import VehicleFault, VehicleLinkLost
from tjscan.vehicle.paced_team import PacedTeam
from tjscan.vehicle.vehicle import AT_REST, Twist, VehicleState


class ScriptedVehicle:
    """Gives its states as fast as they are read; a silent one gives none until it is stopped."""

    dead_man = 0.5
    identity = DeviceIdentity()

    def __init__(self, *, silent: bool = False, lost: bool = False) -> None:
        self.silent, self.lost = silent, lost
        self.stopped, self.read = threading.Event(), threading.Event()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None: ...

    def report_events_to(self, listener: EventListener) -> None:
        listener("hello", "it is on")

    def command(self, twist: Twist) -> None: ...

    def next_state(self) -> VehicleState:
        if self.silent or self.read.is_set():
            self.stopped.wait()
        self.read.set()
        if self.lost:
            raise VehicleLinkLost("the link to the broker broke")
        return VehicleState(1.0, AT_REST)

    def stop(self) -> None:
        self.stopped.set()

    def accept_commands_again(self) -> None: ...


def test_each_vehicle_gives_its_newest_state_or_what_is_wrong_with_it() -> None:
    vehicles = [ScriptedVehicle(), ScriptedVehicle(silent=True), ScriptedVehicle(lost=True)]
    events: list[tuple[str, str]] = []
    team = PacedTeam(vehicles)
    team.report_events_to(lambda name, sentence: events.append((name, sentence)))
    with team:
        assert vehicles[0].read.wait(10)
        assert vehicles[2].read.wait(10)
        states = team.advance_to(team.time + 0.05)
        assert team.time > 0
    assert states[0] == VehicleState(1.0, AT_REST)
    assert isinstance(states[1], VehicleFault)
    assert "broker" in str(states[2])
    assert ("hello", "vehicle 2: it is on") in events
    assert all(vehicle.stopped.is_set() for vehicle in vehicles)


class DrivingVehicle(ScriptedVehicle):
    """It drives for four of the five states that it gives before anybody asks."""

    def __init__(self) -> None:
        super().__init__()
        self.states = iter(VehicleState(0.1 * n, Twist(0.01 * (n < 4), 0.0)) for n in range(5))

    def next_state(self) -> VehicleState:
        if (state := next(self.states, None)) is None:
            self.read.set()
            self.stopped.wait()
            raise VehicleLinkLost("it ended")
        return state


def test_no_way_is_forgotten_of_what_came_while_nobody_asked() -> None:
    vehicle = DrivingVehicle()
    with PacedTeam([vehicle]) as team:
        assert vehicle.read.wait(10)
        (state,) = team.advance_to(team.time)
    assert isinstance(state, VehicleState)
    assert state.time == pytest.approx(0.4)
    assert state.odometry.speed == pytest.approx(0.008)
