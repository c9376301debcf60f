"""Towing vehicles behind a broker, without a broker: what they obey, and how they are seen."""

import json

import numpy as np
import pytest

pytest.importorskip("paho.mqtt", reason="paho-mqtt is not installed")
pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'tjscan[towing]'")

from tjscan.vehicle.cable.model import CableModel, PasserBy, TowingWorldModel
from tjscan.vehicle.cable.world import TowingWorld
from tjscan.vehicle.mqtt.link import ReceivedMessage
from tjscan.vehicle.mqtt.wire import (
    BadMessage,
    CommandMessage,
    PasserByMessage,
    PoseMessage,
    PresenceMessage,
    StateMessage,
)
from tjscan.vehicle.pose_disturbance import LocalisationSimulationSettings
from tjscan.vehicle.simulated_body import VEHICLE_STATE_PERIOD
from tjscan.vehicle.vehicle import DEAD_MAN_TIME
from tjscan_loopback.vehicle.bodies import AT_A_CABLE, ON_TRACKS, CrawlerBody
from tjscan_loopback.vehicle.faults import VehicleFaultOrder
from tjscan_loopback.vehicle.towing import CLOCK_ERROR, TowingBodies, TowingBody
from tjscan_loopback.vehicle.vehicle import LoopbackVehicle


class Loopback:
    """Three vehicles at a cable, and a program that commands them; messages arrive at once."""

    def __init__(self) -> None:
        model = TowingWorldModel(
            cable=CableModel(links=15, held=(4, 9, 14)),
            passers_by=(PasserBy(0.2, np.array(((0.0, 3.0), (3.0, 3.0))), speed=0.5),),
        )
        self.world = TowingWorld(model, np.full(15, 0.1), settle=0.0)
        seen = LocalisationSimulationSettings(position_noise=0.0, heading_noise=0.0)
        self.towing = TowingBodies(self.world, seen, seed=0)
        self.vehicles = [
            LoopbackVehicle(i, body, f"vehicle {i}", lambda line: None)
            for i, body in enumerate(self.towing.bodies, 1)
        ]
        self.now, self._number = 50.0, 0
        self.poses: list[tuple[int, bytes]] = []
        self.passers_by: list[PasserByMessage] = []
        for vehicle in self.vehicles:
            hello = PresenceMessage(session="program", number=1, time=self.now, alive=True)
            vehicle.receive(ReceivedMessage("commander", hello.to_json(), False, self.now))

    def drive(self, which: int, sideways: float = 0.05) -> None:
        self._number += 1
        order = CommandMessage(
            session="program",
            number=self._number,
            time=self.now,
            order="drive",
            sideways=sideways,
            hold=DEAD_MAN_TIME,
        )
        received = ReceivedMessage("command", order.to_json(), False, self.now)
        self.vehicles[which].receive(received)

    def run(self, seconds: float) -> list[StateMessage]:
        """The last state of each vehicle."""
        for _ in range(round(seconds / VEHICLE_STATE_PERIOD)):
            self.now += VEHICLE_STATE_PERIOD
            sent = [
                dict(vehicle.advance(self.now, VEHICLE_STATE_PERIOD)) for vehicle in self.vehicles
            ]
            self.towing.advance(VEHICLE_STATE_PERIOD)
            for topic, payload in self.towing.sightings(self.now):
                place, _, name = topic.partition("/")
                if name == "pose":
                    self.poses.append((int(place), payload))
                else:
                    self.passers_by.append(PasserByMessage.from_json(payload))
        return [StateMessage.from_json(each["state"]) for each in sent if each]

    def poses_of(self, number: int) -> list[PoseMessage]:
        return [PoseMessage.from_json(payload) for i, payload in self.poses if i == number]


@pytest.fixture
def loopback() -> Loopback:
    return Loopback()


def test_a_vehicle_drives_sideways_and_is_seen_to(loopback: Loopback) -> None:
    start = loopback.world.truth().poses
    for _ in range(4):
        loopback.drive(2)
        states = loopback.run(0.25)
    assert states[2].sideways == pytest.approx(0.05, abs=0.01)
    assert abs(states[0].sideways) < 0.01
    moved = loopback.world.truth().poses - start
    assert np.hypot(*moved[2, :2]) > 0.02
    last = loopback.poses_of(3)[-1]
    assert (last.x, last.y) == pytest.approx(tuple(loopback.world.truth().poses[2, :2]), abs=5e-3)
    numbers = [pose.number for pose in loopback.poses_of(3)]
    assert numbers == sorted(set(numbers))


def test_it_stops_where_it_hears_nothing(loopback: Loopback) -> None:
    loopback.drive(2)
    loopback.run(0.3)
    assert not loopback.vehicles[2].body.at_rest
    loopback.run(DEAD_MAN_TIME - 0.3 + 2 * VEHICLE_STATE_PERIOD)
    assert loopback.vehicles[2].body.at_rest


def test_a_stopped_vehicle_stays_until_all_is_right_again(loopback: Loopback) -> None:
    loopback.vehicles[2].order_fault(VehicleFaultOrder.STOP)
    start = loopback.world.truth().poses
    loopback.drive(2)
    states = loopback.run(0.4)
    assert states[2].fault
    assert np.abs(loopback.world.truth().poses - start).max() < 2e-3
    loopback.vehicles[2].order_fault(VehicleFaultOrder.CLEAR)
    loopback.drive(2)
    states = loopback.run(0.4)
    assert not states[2].fault
    assert np.abs(loopback.world.truth().poses - start).max() > 5e-3


def test_a_push_happens_once(loopback: Loopback) -> None:
    start = loopback.world.truth().poses
    loopback.vehicles[2].order_fault(VehicleFaultOrder.PUSH)
    loopback.run(1.0)
    pushed = loopback.world.truth().poses
    assert np.hypot(*(pushed - start)[2, :2]) > 0.05
    loopback.vehicles[2].order_fault(VehicleFaultOrder.CLEAR)
    loopback.run(0.5)
    assert np.abs(loopback.world.truth().poses - pushed).max() < 5e-3


def test_faults_of_poses_reach_the_wire(loopback: Loopback) -> None:
    loopback.vehicles[0].order_fault(VehicleFaultOrder.POSE_LOST)
    loopback.vehicles[1].order_fault(VehicleFaultOrder.POSE_NAN)
    loopback.vehicles[2].order_fault(VehicleFaultOrder.POSE_CLOCK)
    loopback.run(0.5)
    assert loopback.poses_of(1) == []
    with pytest.raises(BadMessage):
        loopback.poses_of(2)
    assert np.isnan(json.loads(dict(loopback.poses)[2])["x"])
    assert loopback.poses_of(3)[-1].time > loopback.now + CLOCK_ERROR - 1
    for vehicle in loopback.vehicles:
        vehicle.order_fault(VehicleFaultOrder.CLEAR)
    loopback.poses.clear()
    loopback.run(0.5)
    assert all(len(loopback.poses_of(number)) == 10 for number in (1, 2, 3))
    assert loopback.poses_of(3)[-1].time < loopback.now + 1


def test_poses_held_back_are_numbered_as_measured(loopback: Loopback) -> None:
    loopback.vehicles[1].order_fault(VehicleFaultOrder.POSE_DISORDER)
    loopback.run(1.0)
    poses = loopback.poses_of(2)
    numbers = [pose.number for pose in poses]
    assert numbers != sorted(numbers)
    assert sorted(numbers) == [p.number for p in sorted(poses, key=lambda pose: pose.time)]


def test_a_passer_by_is_seen_and_can_be_made_to_stand(loopback: Loopback) -> None:
    loopback.run(1.0)
    assert loopback.passers_by[-1].x == pytest.approx(0.5, abs=0.05)
    loopback.towing.hold_passers_by(True)
    loopback.run(1.0)
    assert loopback.passers_by[-1].x == pytest.approx(0.5, abs=0.05)
    assert loopback.passers_by[-1].vx == 0.0


def test_it_tells_what_truly_happened(loopback: Loopback) -> None:
    first: list[str] = []
    for _ in range(6):
        for which in range(3):
            loopback.drive(which, 0.1 if which % 2 else -0.1)
        loopback.run(0.2)
        first += loopback.towing.look_at_truth()
    told = json.loads(loopback.towing.truth_as_json())
    truth = loopback.world.truth()
    assert told["bend_deg"] >= np.rad2deg(np.abs(truth.angles).max()) - 1
    assert told["force_n"] > 0.1
    assert told["touches"] == sorted(set(first))
    assert len(first) == len(set(first))
    np.testing.assert_allclose(told["poses"], truth.poses)


def test_every_fault_is_one_of_a_crawler_or_of_a_towing_vehicle() -> None:
    crawler, towing = CrawlerBody.possible_faults, TowingBody.possible_faults
    assert crawler | towing == frozenset(VehicleFaultOrder)
    assert crawler - towing == ON_TRACKS
    assert towing - crawler == AT_A_CABLE
