"""Corrections for a KUKA arm, packet by packet, against the loopback controller without a wire."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maker_cell import KUKA

from tjscan.core import errors
from tjscan.core.frames import Array
from tjscan.robot.cyclic.arm import rows_of_cycles
from tjscan.robot.cyclic.stream import SHORTEST_PAUSE, PacketRefused
from tjscan.robot.kuka.packets import parse_packet
from tjscan.robot.kuka.stream import CorrectionStream
from tjscan.robot.path import MotionLimits, PathPlanner
from tjscan_loopback.kuka.controller import RsiController, parse_answer

HOME, KINEMATICS = KUKA.home, KUKA.kinematics
CONTROLLER = ("10.0.0.5", 40001)
CYCLE = 4e-3
GOAL = HOME + np.radians([6.0, -3.0, 5.0, 2.0, -4.0, 8.0])
PATH = PathPlanner(KINEMATICS, MotionLimits()).path_to_joint_angles(HOME, GOAL)
ROWS = rows_of_cycles(PATH, CYCLE)

WIRE = np.radians(1e-4)
"""Radians: the last digit of what the controller sends."""


class Pair:
    """A controller and the stream that answers it, without a wire between them."""

    def __init__(self, *, patience: int = 10_000) -> None:
        self.said: list[str] = []
        self.controller = RsiController(
            KINEMATICS, HOME, cycle_ms=4, patience=patience, report_line=self.said.append
        )
        self.stream = CorrectionStream(CONTROLLER[0], "tjscan", CYCLE)
        self.cycle()

    def cycle(self, *, packet_lost: bool = False, answer_lost: bool = False) -> Array:
        """One cycle; returns the joint angles that the controller commands after it."""
        data = None
        if not packet_lost:
            data = self.stream.answer(self.controller.packet(), CONTROLLER)
        answer = None if data is None else parse_answer(data)
        if answer is not None:
            assert answer.stamp == self.controller.stamp
        self.controller.end_cycle(None if answer_lost else answer)
        return self.controller.commanded

    def begin(self) -> None:
        self.stream.begin_move(ROWS, PATH.ramp)


def test_a_path_is_run_through_a_row_a_cycle_to_its_end() -> None:
    pair = Pair()
    pair.begin()
    for row in ROWS[1:]:
        np.testing.assert_allclose(pair.cycle(), row, rtol=0, atol=WIRE)
    assert not pair.stream.moving
    np.testing.assert_allclose(pair.cycle(), GOAL, rtol=0, atol=WIRE)


@given(st.lists(st.sampled_from(["packet", "answer", "", "", "", "", "", ""]), max_size=200))
def test_what_is_lost_costs_time_and_never_speed(losses: list[str]) -> None:
    pair = Pair()
    pair.begin()
    fastest = np.abs(np.diff(ROWS, axis=0)).max(axis=0) + WIRE
    before = pair.controller.commanded
    # Packets that are lost too often end the move; here it is the speed that counts.
    left = iter([*losses, ""])
    while (lost := next(left, None)) is not None or pair.stream.moving:
        now = pair.cycle(packet_lost=lost == "packet", answer_lost=lost == "answer")
        assert (np.abs(now - before) <= fastest).all()
        before = now
    before = pair.cycle()
    assert set(pair.said) <= {"at rest"}
    if pair.stream.fault is None:
        np.testing.assert_allclose(before, GOAL, rtol=0, atol=WIRE)
    else:
        assert not pair.stream.moving


def test_after_a_pause_the_path_begins_slowly_again() -> None:
    pair = Pair()
    pair.begin()
    for _ in range(len(ROWS) // 2):
        pair.cycle()
    before = pair.cycle()
    for _ in range(SHORTEST_PAUSE):
        paused = pair.cycle(answer_lost=True)
    np.testing.assert_array_equal(paused, before)
    steps = np.abs(np.diff([paused, *(pair.cycle() for _ in range(40))], axis=0)).max(axis=1)
    grows = np.abs(np.diff(ROWS, axis=0)).max() * CYCLE / PATH.ramp
    assert steps[-1] > 0
    assert steps[0] <= 2 * grows + WIRE
    assert np.diff(steps).max() <= 2 * grows + WIRE


def test_a_program_that_is_started_again_is_not_answered() -> None:
    """Its corrections count from where the arm is now: the old ones would move it by them all."""
    pair = Pair()
    pair.begin()
    while pair.stream.moving:
        pair.cycle()
    ipoc = pair.controller.stamp
    later = pair.controller.packet().replace(str(ipoc).encode(), str(ipoc + 300).encode())
    assert pair.stream.answer(later, CONTROLLER) is None
    assert isinstance(pair.stream.fault, errors.ArmConnectionLost)
    silent = Pair()
    silent.stream.fail_for_silence(0.5)
    assert silent.stream.answer(silent.controller.packet(), CONTROLLER) is None


@pytest.mark.parametrize("noise_deg", [0.0, 0.0008])
def test_an_arm_that_is_held_is_seen_whatever_its_encoders_noise(noise_deg: float) -> None:
    pair = Pair()
    pair.begin()
    held = parse_packet(pair.controller.packet())
    for k in range(len(ROWS)):
        pair.stream._advance()
        pair.stream._check_arm_follows(replace(held, q=HOME + np.radians(noise_deg) * (k % 2)))
    assert isinstance(pair.stream.fault, errors.ProtectiveStop)


@given(st.integers(0, len(ROWS)))
def test_it_brakes_along_its_path_within_the_ramp(begun: int) -> None:
    pair = Pair()
    pair.begin()
    for _ in range(begun):
        pair.cycle()
    pair.stream.brake()
    passed = [pair.cycle() for _ in range(int(PATH.ramp / CYCLE) + 2)]
    assert not pair.stream.moving
    np.testing.assert_array_equal(passed[-1], passed[-2])
    # On the straight line in joint space from HOME to GOAL.
    share = (passed[-1] - HOME) / (GOAL - HOME)
    np.testing.assert_allclose(share, share.mean(), atol=1e-3)


def test_no_other_path_is_begun_while_the_arm_moves() -> None:
    pair = Pair()
    pair.begin()
    pair.cycle()
    with pytest.raises(errors.ArmFault, match="still moves"):
        pair.begin()


def test_leaving_it_comes_to_rest_and_ends_the_motion() -> None:
    pair = Pair()
    pair.begin()
    for _ in range(30):
        pair.cycle()
    pair.stream.leave()
    while not pair.stream.ended:
        pair.cycle()
    assert pair.said == ["at rest", "ended"]


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda packet: packet.replace(b'D="0"', b'D="3"'), "before this program listened"),
        (lambda packet: packet.replace(b'ASPos A1="-90', b'ASPos A1="-91'), "corrected the arm"),
    ],
)
def test_rsi_that_ran_already_is_not_answered(change: object, word: str) -> None:
    controller = RsiController(
        KINEMATICS, HOME, cycle_ms=4, patience=9, report_line=lambda line: None
    )
    stream = CorrectionStream(CONTROLLER[0], "tjscan", CYCLE)
    assert callable(change)
    packet = change(controller.packet())
    assert packet != controller.packet()
    assert stream.answer(packet, CONTROLLER) is None
    with pytest.raises(errors.ArmNotConnected, match=word):
        stream.state()


def test_a_later_packet_of_the_same_address_and_another_port_is_ignored() -> None:
    pair = Pair()
    for sender in (("10.0.0.6", 40001), ("10.0.0.5", 40002)):
        assert pair.stream.answer(pair.controller.packet(), sender) is None
    state = pair.stream.state()
    assert state is not None
    assert state.ignored == {"from another address": 2}
    pair.cycle()


@given(
    st.binary(max_size=300) | st.text(alphabet='<>RobTypeKUKA="/ 01.', max_size=300).map(str.encode)
)
def test_nonsense_is_refused_by_name(data: bytes) -> None:
    with pytest.raises(PacketRefused):
        parse_packet(data)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        (b'Type="KUKA"', b'Type="KAKU"', "Type 'KAKU'"),
        (b"Rob", b"Bor", "<Bor>"),
        (b"<Delay ", b"<Dolay ", "no <Delay>"),
        (b'A6="', b'A7="', "<AIPos> has not a number for each"),
        (b'AIPos A1="-90.0000"', b'AIPos A1="nan"', "<AIPos>"),
        (b"<IPOC>", b"<IPOC>-", "no time stamp"),
        (b"<IPOC>", b"<IPOC>1234567890123456", "no time stamp"),
        (b"</Rob>", b"", "no XML"),
        (b"</Rob>", b" " * 5000 + b"</Rob>", "longer"),
    ],
)
def test_a_packet_that_is_not_the_controllers_is_refused_by_name(
    old: bytes, new: bytes, word: str
) -> None:
    packet = Pair().controller.packet()
    parse_packet(packet)
    assert old in packet
    with pytest.raises(PacketRefused, match=word):
        parse_packet(packet.replace(old, new))
