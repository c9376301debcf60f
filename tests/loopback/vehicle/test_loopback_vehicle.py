"""What a vehicle behind a broker obeys, without a broker: laws for every order of messages."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("paho.mqtt", reason="paho-mqtt is not installed")

from tjscan.vehicle.mqtt.link import ReceivedMessage
from tjscan.vehicle.mqtt.wire import CommandMessage, PresenceMessage, StateMessage
from tjscan.vehicle.simulated_body import (
    VEHICLE_STATE_PERIOD,
    SimulatedBody,
    VehicleSimulationSettings,
)
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import DEAD_MAN_TIME
from tjscan_loopback.vehicle.bodies import CrawlerBody
from tjscan_loopback.vehicle.faults import OrderedFault, VehicleFaultOrder, parse_ordered_fault
from tjscan_loopback.vehicle.vehicle import LoopbackVehicle

SETTLED = 0.4
"""Seconds after which the drives have the speed they were told, within a thousandth."""


class Program:
    """Who commands the vehicle: what it sends arrives at once."""

    def __init__(self, vehicle: LoopbackVehicle, session: str = "first") -> None:
        self.vehicle, self.session = vehicle, session

    def announce(self, now: float, *, alive: bool = True) -> None:
        self._send(
            "commander",
            PresenceMessage(session=self.session, number=1, time=now, alive=alive).to_json(),
            now,
        )

    def drive(
        self, number: int, now: float, speed: float = 0.05, *, retained: bool = False
    ) -> None:
        message = CommandMessage(
            session=self.session, number=number, time=now, order="drive", speed=speed, hold=0.5
        )
        self._send("command", message.to_json(), now, retained=retained)

    def stop(self, number: int, sent: float, now: float) -> None:
        message = CommandMessage(session=self.session, number=number, time=sent, order="stop")
        self._send("stop", message.to_json(), now)

    def _send(self, topic: str, payload: bytes, now: float, *, retained: bool = False) -> None:
        self.vehicle.receive(ReceivedMessage(topic, payload, retained, now))


def command(order: str = "drive", number: int = 7, time: float = 3.0) -> bytes:
    fields = {"session": "first", "number": number, "time": time, "order": order}
    return json.dumps({**fields, "speed": 0.05, "hold": 0.5}).encode()


def vehicle() -> LoopbackVehicle:
    settings = VehicleSimulationSettings(encoder_noise=0.0)
    body = CrawlerBody(SimulatedBody(TrackGeometry(), settings))
    return LoopbackVehicle(1, body, "itself", lambda line: None)


def advance(vehicle: LoopbackVehicle, start: float, seconds: float) -> StateMessage:
    """Go on, with nothing heard; the last state."""
    for tick in range(1, round(seconds / VEHICLE_STATE_PERIOD) + 1):
        sent = vehicle.advance(start + tick * VEHICLE_STATE_PERIOD, VEHICLE_STATE_PERIOD)
    return StateMessage.from_json(dict(sent)["state"])


@given(st.lists(st.integers(1, 50), min_size=1, max_size=30))
def test_commands_out_of_order_never_steer(numbers: list[int]) -> None:
    driven = vehicle()
    program = Program(driven)
    program.announce(0.0)
    for number in numbers:
        # Each was sent at a time of its own; they arrive in any order.
        program.drive(number, 1e-3 * number, 1e-3 * number)
    state = advance(driven, 0.05, SETTLED)
    assert state.speed == pytest.approx(1e-3 * max(numbers), rel=2e-3)
    assert driven.dropped == len(numbers) - len(
        {max(numbers[:i]) for i in range(1, len(numbers) + 1)}
    )


@given(st.floats(-0.1, 0.1), st.floats(0, 1))
def test_it_stands_when_the_dead_man_time_is_over(speed: float, start: float) -> None:
    driven = vehicle()
    program = Program(driven)
    program.announce(start)
    program.drive(1, start, speed)
    advance(driven, start, DEAD_MAN_TIME + 2 * VEHICLE_STATE_PERIOD)
    assert driven.body.at_rest
    # It is no latch: the next command drives again.
    program.drive(2, start + 1.0, 0.05)
    advance(driven, start + 1.0, 0.1)
    assert not driven.body.at_rest


@pytest.mark.parametrize("what", ["its program goes", "its link breaks", "a drive fails"])
def test_it_brakes_at_once_when(what: str) -> None:
    driven = vehicle()
    program = Program(driven)
    program.announce(0.0)
    program.drive(1, 0.0, 0.1)
    advance(driven, 0.0, 0.3)
    if what == "its program goes":
        program.announce(0.3, alive=False)
    elif what == "its link breaks":
        driven.link_is_up = False
    else:
        driven.order_fault(VehicleFaultOrder.DRIVE_FAULT)
    advance(driven, 0.3, driven.body.braking_time + VEHICLE_STATE_PERIOD)
    assert driven.body.at_rest


def test_it_obeys_one_program_until_that_is_silent() -> None:
    driven = vehicle()
    first, second = Program(driven), Program(driven, "second")
    first.announce(0.0)
    first.drive(1, 0.0)
    second.announce(0.1)
    second.drive(1, 0.1, -0.05)
    assert advance(driven, 0.1, 0.2).commander == "first"
    second.announce(0.6)
    second.drive(2, 0.6, -0.05)
    state = advance(driven, 0.6, SETTLED)
    assert state.commander == "second"
    assert state.speed < -0.04
    first.drive(2, 1.0)  # it thaws
    assert advance(driven, 1.0, 0.05).speed < 0


def test_what_the_broker_kept_and_who_is_not_announced_never_steer() -> None:
    driven = vehicle()
    program = Program(driven)
    program.drive(1, 0.0)
    program.announce(0.0)
    program.drive(2, 0.0, retained=True)
    advance(driven, 0.0, 0.2)
    assert driven.body.at_rest
    assert driven.dropped == 2


def test_a_stop_overtakes_what_was_sent_before_it() -> None:
    driven = vehicle()
    program = Program(driven)
    program.announce(0.0)
    program.drive(1, 0.0)
    advance(driven, 0.0, 0.1)
    program.stop(3, sent=0.1, now=0.1)
    program._send("command", command(number=2, time=0.09), 0.12)  # it waited in a flood
    advance(driven, 0.12, driven.body.braking_time + VEHICLE_STATE_PERIOD)
    assert driven.body.at_rest
    program.drive(4, 0.2)
    assert advance(driven, 0.2, 0.1).speed > 0.0


@given(st.one_of(st.binary(), st.just(command("stop")), st.just(command("drive"))))
def test_whatever_comes_on_the_topic_of_stops_holds_the_vehicle(payload: bytes) -> None:
    driven = vehicle()
    program = Program(driven)
    program.announce(0.0)
    program.drive(1, 0.0)
    program.stop(2, sent=0.01, now=0.01)
    driven.receive(ReceivedMessage("stop", payload, False, 0.02))
    program.drive(3, 0.05)
    advance(driven, 0.05, 0.2)
    assert driven.body.at_rest
    program.drive(4, 0.02 + DEAD_MAN_TIME)
    assert advance(driven, 0.02 + DEAD_MAN_TIME, 0.1).speed > 0.0


def test_orders_of_faults_are_read() -> None:
    from tjscan.core.errors import ConfigurationError

    assert parse_ordered_fault("slip\n", 3) == OrderedFault(VehicleFaultOrder.SLIP)
    assert parse_ordered_fault("edge 2", 3) == OrderedFault(VehicleFaultOrder.EDGE, 2)
    for line in ("slop", "edge 0", "edge 4", "edge x", ""):
        with pytest.raises(ConfigurationError):
            parse_ordered_fault(line, 3)
