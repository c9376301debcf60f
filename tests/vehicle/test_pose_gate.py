"""Which poses come through, and how old they are known to be."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.vehicle.mqtt.wire import (
    OTHER_CLOCK_CONFIRMATIONS,
    TAKEOVER_SILENCE,
    BadMessage,
    PoseGate,
    PoseMessage,
)


def pose(number: int, time: float, session: str = "first") -> PoseMessage:
    return PoseMessage(session=session, number=number, time=time, x=0.0, y=0.0, heading=0.0)


@given(st.lists(st.integers(0, 50), min_size=1, max_size=40), st.floats(-1e6, 1e6))
def test_what_comes_through_is_in_order_whatever_comes(numbers: list[int], clock: float) -> None:
    gate = PoseGate()
    through, times = [], []
    for place, number in enumerate(numbers):
        try:
            times.append(
                gate.measuring_time(pose(number, clock + 0.05 * number), 3.0 + 0.01 * place)
            )
            through.append(number)
        except BadMessage:
            pass
    assert through == sorted(set(through))
    assert times == sorted(set(times))
    assert through[0] == numbers[0]


@given(st.lists(st.floats(0.0, 0.4), min_size=2, max_size=40))
def test_a_late_pose_is_dated_by_when_it_was_measured(delays: list[float]) -> None:
    gate, offset = PoseGate(), 1234.5
    gate.measuring_time(pose(0, 0.0), offset)  # at once
    for number, delay in enumerate(delays, 1):
        sent = 0.5 * number
        measured = gate.measuring_time(pose(number, sent), offset + sent + delay)
        assert measured == pytest.approx(offset + sent, abs=0.03)  # the clocks may drift apart


def test_a_clock_that_jumps_is_believed_when_it_keeps_to_it() -> None:
    gate = PoseGate()
    for number in range(10):
        gate.measuring_time(pose(number, 0.05 * number), 100 + 0.05 * number)
    for first, jump in ((10, -3600.0), (40, 50.0)):
        dropped = 0
        for number in range(first, first + 30):
            try:
                measured = gate.measuring_time(
                    pose(number, 0.05 * number + jump), 100 + 0.05 * number
                )
            except BadMessage:
                dropped += 1
        assert dropped == OTHER_CLOCK_CONFIRMATIONS - 1
        assert measured == pytest.approx(100 + 0.05 * number)


def test_a_single_wrong_clock_steers_nothing() -> None:
    gate = PoseGate()
    for number in range(40):
        wrong = 1e4 if number % 7 == 3 else 0.0
        now = 5 + 0.05 * number
        if wrong:
            with pytest.raises(BadMessage, match="clock"):
                gate.measuring_time(pose(number, 0.05 * number + wrong), now)
        else:
            assert gate.measuring_time(pose(number, 0.05 * number), now) == pytest.approx(now)


def test_another_sender_takes_over_from_a_silent_one_alone() -> None:
    gate = PoseGate()
    gate.measuring_time(pose(5, 1.0), 10.0)
    with pytest.raises(BadMessage, match="session"):
        gate.measuring_time(pose(1, 7.0, "other"), 10.1)
    now = 10.0 + TAKEOVER_SILENCE
    assert gate.measuring_time(pose(2, 7.4, "other"), now) == now
    with pytest.raises(BadMessage, match="session"):
        gate.measuring_time(pose(6, 1.05), now + 0.05)
