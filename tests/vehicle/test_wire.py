"""Messages of vehicles: what is none never comes through, nor what is old, late or out of order."""

import json
from itertools import pairwise
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.vehicle.mqtt.wire import BadMessage, CommandMessage, MessageGate, StateMessage
from tjscan.vehicle.vehicle import Twist, VehicleState

STATE = VehicleState(
    *(1.5, Twist(0.02, -0.01), (1.0, -2.0), (0.03, inf, 0.031, 0.03), "hot"),
    gyro=(-0.004,),
    down=(1.57,),
    push=(12.5, -3.0, 0.4),
)
MESSAGE = StateMessage.of_state(STATE, session="abcd", number=7, time=2.0, commander="me")
KEYS = tuple(json.loads(MESSAGE.to_json()))


def command(number: int, time: float, session: str = "abcd") -> CommandMessage:
    return CommandMessage(session=session, number=number, time=time, order="stop")


def test_a_state_comes_out_as_it_went_in() -> None:
    assert StateMessage.from_json(MESSAGE.to_json()) == MESSAGE
    assert MESSAGE.state == STATE


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("wrong", [nan, inf, -inf, None, True, {}, [[]], "1" * 999, 1e300])
def test_a_value_of_the_wrong_kind_is_refused(key: str, wrong: object) -> None:
    values = json.loads(MESSAGE.to_json())
    payload = json.dumps({**values, key: wrong}).encode()
    with pytest.raises(BadMessage):
        StateMessage.from_json(payload)


def test_unknown_and_missing_keys_are_refused() -> None:
    values = json.loads(MESSAGE.to_json())
    with pytest.raises(BadMessage, match="more"):
        StateMessage.from_json(json.dumps({**values, "more": 1}).encode())
    for key in ("session", "number", "time", "clock", "speed", "turn_rate", "sideways"):
        with pytest.raises(BadMessage, match=key):
            StateMessage.from_json(
                json.dumps({k: v for k, v in values.items() if k != key}).encode()
            )
    with pytest.raises(BadMessage):
        StateMessage.from_json(json.dumps({**values, "proximity": [0.03]}).encode())
    with pytest.raises(BadMessage, match="push"):
        StateMessage.from_json(json.dumps({**values, "push": [12.5, -3.0]}).encode())


@given(st.binary(max_size=100))
def test_bytes_that_are_no_message_are_refused(payload: bytes) -> None:
    for kind in (StateMessage, CommandMessage):
        with pytest.raises(BadMessage):
            kind.from_json(payload)


def test_a_message_too_long_is_refused() -> None:
    with pytest.raises(BadMessage, match="long"):
        StateMessage.from_json(MESSAGE.to_json() + b" " * 5000)


def test_nothing_that_is_no_number_is_sent() -> None:
    with pytest.raises(ValueError, match="JSON"):
        StateMessage.of_state(
            VehicleState(1.0, Twist(nan, 0.0)), session="abcd", number=1, time=0.0
        ).to_json()


@given(st.lists(st.tuples(st.integers(0, 30), st.floats(0, 3)), max_size=40))
def test_numbers_and_clock_of_what_comes_through_only_grow(sent: list[tuple[int, float]]) -> None:
    gate, through = MessageGate(), []
    for number, time in sent:
        if not gate.reason_to_drop(command(number, time), 100.0 + time):
            through.append((number, time))
    assert all(a[0] < b[0] and a[1] < b[1] for a, b in pairwise(through))


def test_what_comes_late_is_dropped_whatever_the_clocks_show() -> None:
    gate = MessageGate()
    for number in range(10):  # sent every 0.1 s, on a clock that shows 1000 s more
        assert not gate.reason_to_drop(command(number, 1000 + 0.1 * number), 0.1 * number + 0.01)
    assert not gate.reason_to_drop(command(10, 1001.0), 1.2)
    assert "late" in gate.reason_to_drop(command(11, 1001.1), 1.4)
    # A burst after a hold-up: late ones stay out until the sender has caught up.
    assert "late" in gate.reason_to_drop(command(12, 1001.2), 1.6)
    assert not gate.reason_to_drop(command(13, 1001.6), 1.61)


def test_clocks_may_run_apart_slowly() -> None:
    gate = MessageGate()
    for second in range(20_000):
        assert not gate.reason_to_drop(command(second, second * (1 - 5e-4)), second)


def test_another_session_stays_out() -> None:
    gate = MessageGate()
    assert not gate.reason_to_drop(command(5, 1.0), 1.0)
    assert "session" in gate.reason_to_drop(command(6, 1.1, "efgh"), 1.1)
    gate.restart_session("efgh")
    assert not gate.reason_to_drop(command(1, 0.2, "efgh"), 1.2)
