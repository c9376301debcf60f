"""Vehicles of one simulated world behind the protocol: one clock, a dead-man each."""

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'tjscan[towing]'")

from math import nan

from tjscan.core.errors import DriveFault, VehicleFault, VehicleLinkLost, VehicleStopped
from tjscan.vehicle.cable.model import CableModel, TowingVehicleModel, TowingWorldModel
from tjscan.vehicle.cable.world import TowingWorld
from tjscan.vehicle.simulated_team import SimulatedTeam
from tjscan.vehicle.vehicle import DEAD_MAN_TIME, Twist, VehicleState

TOWS = Twist(0.02, 0.0, 0.01)


@pytest.fixture
def team() -> SimulatedTeam:
    model = TowingWorldModel(
        cable=CableModel(links=20, held=(9, 19)), vehicle=TowingVehicleModel(encoder_noise=0.0)
    )
    return SimulatedTeam(TowingWorld(model, np.full(20, 0.1), settle=0.0))


def states(team: SimulatedTeam, time: float) -> list[VehicleState]:
    newest = team.advance_to(time)
    assert all(isinstance(state, VehicleState) for state in newest)
    return [state for state in newest if isinstance(state, VehicleState)]


def test_reading_all_vehicles_in_turn_moves_the_clock_once_a_turn(team: SimulatedTeam) -> None:
    with team:
        for turn in range(1, 4):
            times = [vehicle.next_state().time for vehicle in team.vehicles]
            assert times == pytest.approx([turn * 0.01] * 2)


def test_who_reads_rarely_gets_the_newest_state(team: SimulatedTeam) -> None:
    with team:
        first, second = team.vehicles
        for _ in range(5):
            first.next_state()
        assert second.next_state().time == pytest.approx(0.05)
        assert second.next_state().time == pytest.approx(0.06)


def test_the_team_goes_on_to_a_time(team: SimulatedTeam) -> None:
    with team:
        assert [state.time for state in states(team, 0.1)] == pytest.approx([0.1, 0.1])
        assert team.time == pytest.approx(0.1)
        assert [state.time for state in states(team, 0.05)] == pytest.approx([0.1, 0.1])


def test_the_motion_it_gives_is_the_mean_since_it_was_read(team: SimulatedTeam) -> None:
    with team:
        first, second = team.vehicles
        second.command(TOWS)
        speeds = []
        for _ in range(8):  # it gathers speed
            first.next_state()
            speeds.append(team.world.state(1).odometry.speed)
        assert speeds[-1] > 2 * speeds[0]
        assert second.next_state().odometry.speed == pytest.approx(np.mean(speeds))


def test_each_vehicle_stops_by_itself(team: SimulatedTeam) -> None:
    with team:
        first, second = team.vehicles
        first.command(TOWS)
        second.command(TOWS)
        states(team, DEAD_MAN_TIME - 0.05)
        second.command(TOWS)
        states(team, DEAD_MAN_TIME + 0.09)
        ended, drives = states(team, DEAD_MAN_TIME + 0.1)
        assert abs(ended.odometry.speed) < 5e-3 < drives.odometry.speed
        states(team, 2 * DEAD_MAN_TIME + 0.09)
        stands = states(team, 2 * DEAD_MAN_TIME + 0.1)[1]
        assert abs(stands.odometry.speed) < 5e-3


def test_a_stop_holds_for_that_vehicle_alone(team: SimulatedTeam) -> None:
    with team:
        first, second = team.vehicles
        first.stop()
        with pytest.raises(VehicleStopped):
            first.command(TOWS)
        second.command(TOWS)
        assert states(team, 0.3)[1].odometry.speed > 0.01
        first.accept_commands_again()
        first.command(TOWS)
        assert states(team, 0.6)[0].odometry.speed > 0.01


def test_a_jammed_vehicle_reports_its_fault_and_refuses_commands(team: SimulatedTeam) -> None:
    with team:
        team.world.set_jammed(0, True)
        assert "jammed" in states(team, 0.05)[0].fault
        with pytest.raises(DriveFault, match="jammed"):
            team.vehicles[0].command(TOWS)
        team.vehicles[1].command(TOWS)


def test_wrong_use_is_refused(team: SimulatedTeam) -> None:
    with pytest.raises(VehicleLinkLost):
        team.vehicles[0].command(TOWS)
    with pytest.raises(VehicleLinkLost):
        team.vehicles[0].next_state()
    with team, pytest.raises(VehicleFault):
        team.vehicles[0].command(Twist(nan, 0.0))
