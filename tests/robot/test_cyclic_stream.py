"""Streams of three makers, packet by packet, against their loopbacks without a wire."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maker_cell import ABB, FANUC, KUKA, Maker

from tjscan.core import errors
from tjscan.core.frames import Array
from tjscan.robot.abb import packets as egm
from tjscan.robot.cyclic.arm import rows_of_cycles
from tjscan.robot.cyclic.stream import CyclePacket, CyclicStream, PacketRefused
from tjscan.robot.fanuc import packets as stmo
from tjscan.robot.path import JointTrajectory, MotionLimits, PathPlanner
from tjscan.robot.settings import InputShaper
from tjscan_loopback.abb.controller import EgmController
from tjscan_loopback.abb.controller import parse_answer as parse_sensor
from tjscan_loopback.cyclic.controller import CyclicController
from tjscan_loopback.fanuc.controller import StreamController, parse_command
from tjscan_loopback.kuka.controller import RsiController

CONTROLLER = ("10.0.0.5", 40001)
CYCLES = {"abb": 4e-3, "fanuc": 8e-3, "kuka": 4e-3}
CONTROLLERS: dict[str, type[CyclicController]] = {
    "abb": EgmController,
    "fanuc": StreamController,
    "kuka": RsiController,
}
WIRE = np.radians(1e-9)
CAPABLE = stmo.CAPABILITY_FORMAT.pack(stmo.READ_CAPABILITY, 3, 1, 8, 0, 3, 0)

makers = pytest.mark.parametrize("maker", [ABB, FANUC], ids=lambda maker: maker.name)


def goal_of(maker: Maker) -> Array:
    return np.asarray(maker.home + np.radians([6.0, -3.0, 5.0, 2.0, -4.0, 8.0]))


def path_of(maker: Maker, shaper: InputShaper | None = None) -> JointTrajectory:
    planner = PathPlanner(maker.kinematics, MotionLimits(shaper=shaper))
    return planner.path_to_joint_angles(maker.home, goal_of(maker))


PATHS = {maker.name: path_of(maker) for maker in (ABB, FANUC)}


def stream_to(maker: Maker) -> CyclicStream[Any]:
    return maker.settings("127.0.0.1").make_stream(CONTROLLER[0])


class Pair:
    """A controller and the stream that answers it, without a wire between them."""

    def __init__(self, maker: Maker, path: JointTrajectory | None = None) -> None:
        self.said: list[str] = []
        cycle = CYCLES[maker.name]
        self.controller = CONTROLLERS[maker.name](
            maker.kinematics,
            maker.home,
            cycle_ms=round(1e3 * cycle),
            patience=10_000,
            report_line=self.said.append,
        )
        self.stream = stream_to(maker)
        if maker is FANUC:
            assert self.stream.answer(CAPABLE, CONTROLLER) is None
        self.path = path or PATHS[maker.name]
        self.rows = rows_of_cycles(self.path, cycle)
        self.goal = goal_of(maker)
        self.cycle()

    def cycle(self, *, packet_lost: bool = False, answer_lost: bool = False) -> Array:
        """One cycle; returns the joint angles that the controller commands after it."""
        data = None
        if not packet_lost:
            data = self.stream.answer(self.controller.packet(), CONTROLLER)
        answer = None if data is None else self.controller.parse(data)
        assert answer is None or answer.stamp == self.controller.stamp
        self.controller.end_cycle(None if answer_lost else answer)
        return self.controller.commanded

    def begin(self) -> None:
        self.stream.begin_move(self.rows, self.path.ramp)


@makers
def test_a_path_is_run_through_to_its_end(maker: Maker) -> None:
    pair = Pair(maker)
    pair.begin()
    passed = [pair.cycle() for _ in range(len(pair.rows) + 40)]
    assert not pair.stream.moving
    np.testing.assert_allclose(passed[-1], pair.goal, rtol=0, atol=WIRE)
    assert pair.said == ["at rest"]
    share = (passed - pair.rows[0]) / (pair.goal - pair.rows[0])
    np.testing.assert_allclose(share, share[:, :1].repeat(6, axis=1), atol=1e-6)


def sway_left(maker: Maker, shaper: InputShaper | None) -> float:
    """Sway of 3 Hz, damped by 2 %, when a move ends that pushes as it accelerates; of any scale."""
    pair = Pair(maker, path_of(maker, shaper))
    pair.begin()
    commanded = np.array([pair.cycle() for _ in range(len(pair.rows) + 40)])
    assert not pair.stream.moving
    np.testing.assert_allclose(commanded[-1], pair.goal, rtol=0, atol=WIRE * 1e4)
    pushes = np.diff(commanded[:, 0], 2)
    left = CYCLES[maker.name] * np.arange(len(pushes))[::-1]
    return float(abs(np.sum(pushes * np.exp((-0.02 + 1j) * 6 * np.pi * left))))


@pytest.mark.parametrize("off", [0.9, 1.0, 1.1])
@pytest.mark.parametrize("maker", [ABB, FANUC, KUKA], ids=lambda maker: maker.name)
def test_a_shaped_move_arrives_shaped(maker: Maker, off: float) -> None:
    shaped = sway_left(maker, InputShaper(frequency=3.0 * off, damping=0.02))
    assert shaped < 0.05 * sway_left(maker, None)


@makers
@given(st.lists(st.sampled_from([True, *[False] * 9]), max_size=150))
def test_packets_that_are_lost_never_cost_speed(maker: Maker, losses: list[bool]) -> None:
    pair = Pair(maker)
    pair.begin()
    fastest = np.abs(np.diff(pair.rows, axis=0)).max(axis=0) * (1 + 1e-6) + WIRE
    before, left = pair.controller.commanded, iter(losses)
    for _ in range(len(pair.rows) + len(losses) + 60):
        now = pair.cycle(packet_lost=next(left, False))
        assert (np.abs(now - before) <= fastest).all()
        before = now
    assert not pair.stream.moving
    if pair.stream.fault is None:
        np.testing.assert_allclose(before, pair.goal, rtol=0, atol=WIRE)
        assert set(pair.said) <= {"at rest"}


@given(st.lists(st.sampled_from([True, *[False] * 9]), max_size=150))
def test_answers_to_a_fanuc_that_are_lost_never_cost_speed(losses: list[bool]) -> None:
    pair = Pair(FANUC)
    pair.begin()
    fastest = np.abs(np.diff(pair.rows, axis=0)).max(axis=0) * (1 + 1e-6) + WIRE
    before, left = pair.controller.commanded, iter(losses)
    # Where it went on while commands were missing, it is up to an acceleration of a few cycles off.
    ramp_step = np.radians(80) * CYCLES["fanuc"] ** 2 * 3
    for _ in range(len(pair.rows) + len(losses) + 60):
        now = pair.cycle(answer_lost=next(left, False))
        assert (np.abs(now - before) <= fastest + ramp_step).all()
        before = now
    assert pair.stream.fault is None
    np.testing.assert_allclose(before, pair.goal, rtol=0, atol=WIRE)


@makers
@pytest.mark.parametrize("begun", [0, 10, 50, 90])
def test_it_brakes_along_its_path(maker: Maker, begun: int) -> None:
    pair = Pair(maker)
    pair.begin()
    for _ in range(begun):
        pair.cycle()
    pair.stream.brake()
    passed = [pair.cycle() for _ in range(int(pair.path.ramp / CYCLES[maker.name]) + 30)]
    assert not pair.stream.moving
    np.testing.assert_array_equal(passed[-1], passed[-2])
    share = (passed[-1] - pair.rows[0]) / (pair.goal - pair.rows[0])
    np.testing.assert_allclose(share, share.mean(), atol=1e-3)
    assert pair.said in ([], ["at rest"])


@makers
def test_a_program_that_is_started_again_is_not_answered(maker: Maker) -> None:
    pair = Pair(maker)
    pair.begin()
    for _ in range(20):
        pair.cycle()
    pair.controller.stamp += 300
    assert pair.stream.answer(pair.controller.packet(), CONTROLLER) is None
    assert isinstance(pair.stream.fault, errors.ArmConnectionLost)
    again = Pair(maker)
    for _ in range(20):
        again.cycle()
    again.controller.start()
    assert again.stream.answer(again.controller.packet(), CONTROLLER) is None
    assert "with an older" in str(again.stream.ignored)


def test_a_program_that_goes_on_counting_is_told_by_its_clock() -> None:
    pair = Pair(ABB)
    pair.cycle()
    pair.controller.program += 1
    assert pair.stream.answer(pair.controller.packet(), CONTROLLER) is None
    assert isinstance(pair.stream.fault, errors.ArmConnectionLost)


def test_an_abb_that_hears_nothing_is_not_answered_once_its_lag_has_passed() -> None:
    pair = Pair(ABB)
    pair.begin()
    for _ in range(30):
        pair.cycle()
    for _ in range(40):
        pair.cycle(answer_lost=True)
    held = pair.controller.commanded
    assert isinstance(pair.stream.fault, errors.ArmConnectionLost)
    np.testing.assert_array_equal(pair.cycle(), held)


@pytest.mark.parametrize(
    ("rapid", "words"), [(1, "the RAPID program .* is stopped"), (2, "EGM has ended")]
)
def test_a_stopped_program_and_egm_that_has_ended_are_told_apart(rapid: int, words: str) -> None:
    q = np.zeros(6)
    packet = egm.EgmPacket(1, 0.0, q, q, q[:3], 0, 1, egm.MCI_RUNNING - 1, rapid)
    fault = stream_to(ABB)._reported_fault(packet)
    assert isinstance(fault, errors.ProgramStopped)
    assert re.match(words, str(fault))


def test_a_fanuc_rests_before_its_motion_is_ended() -> None:
    pair = Pair(FANUC)
    pair.begin()
    for _ in range(40):
        pair.cycle()
    pair.stream.leave()
    passed = []
    while not pair.stream.ended:
        passed.append(pair.cycle())
    np.testing.assert_array_equal(passed[-2], passed[-25])


@makers
def test_why_a_packet_is_not_answered_yet_is_told(maker: Maker) -> None:
    controller = Pair(maker).controller
    controller.standing = True
    fresh = stream_to(maker)
    assert fresh.answer(controller.packet(), CONTROLLER) is None
    assert "emergency stop" in str(fresh.ignored)


@makers
def test_numbers_begin_again_after_the_last(maker: Maker) -> None:
    again = Pair(maker)
    again.controller.stamp = 2**32 - 3
    stream = again.stream
    stream._packet = None
    for _ in range(6):
        data = again.controller.packet()
        assert stream.answer(data, CONTROLLER) is not None
        again.controller.stamp += 1
    assert stream.fault is None
    assert stream.ignored == {}


def test_an_abb_is_answered_once_egm_runs_and_a_fanuc_once_it_takes_commands() -> None:
    for maker in (ABB, FANUC):
        pair = Pair(maker)
        fresh = stream_to(maker)
        if maker is FANUC:
            assert fresh.answer(pair.controller.packet(), CONTROLLER) is None
            assert fresh.answer(CAPABLE, CONTROLLER) is None
        pair.controller.program_runs = False
        assert fresh.answer(pair.controller.packet(), CONTROLLER) is None
        assert not fresh.connected
        pair.controller.program_runs = True
        assert fresh.answer(pair.controller.packet(), CONTROLLER) is not None


PARSERS: list[Callable[[bytes], CyclePacket]] = [
    egm.parse_packet,
    lambda data: stmo.parse_status(data, 8e-3),
]


@pytest.mark.parametrize("parse", PARSERS, ids=["abb", "fanuc"])
@given(st.binary(max_size=500))
def test_nonsense_is_refused_by_name(parse: Callable[[bytes], CyclePacket], data: bytes) -> None:
    with pytest.raises(PacketRefused):
        parse(data)


angles = st.lists(st.floats(-6.3, 6.3), min_size=6, max_size=6).map(np.array)


@given(angles, st.integers(0, 2**32 - 1), st.booleans())
def test_what_is_sent_is_what_the_other_side_reads(q: Array, number: int, last: bool) -> None:
    """The loopbacks have coders of their own."""
    packet = egm.EgmPacket(number, 0.0, q, q, q[:3], 0, 1, 3, 2)
    sensor = parse_sensor(egm.format_answer(q, packet))
    command = parse_command(stmo.format_command(q, number, last=last))
    assert sensor is not None
    assert command is not None
    np.testing.assert_allclose(sensor.q, q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(command.q, q, rtol=0, atol=1e-14)
    assert (sensor.stamp, command.stamp, command.stop) == (number, number, last)


@makers
@given(angles, st.integers(0, 2**31))
def test_what_the_controller_sends_is_what_is_read(maker: Maker, q: Array, number: int) -> None:
    kinematics = maker.kinematics
    controller = CONTROLLERS[maker.name](
        kinematics, q, cycle_ms=8, patience=9, report_line=lambda line: None
    )
    controller.stamp = number
    packet = PARSERS[maker is FANUC](controller.packet())
    rounding = 1e-6 if maker is FANUC else 1e-12
    np.testing.assert_allclose(packet.q, q, rtol=0, atol=rounding)
    np.testing.assert_allclose(packet.tool_b, kinematics.forward(q)[:3, 3], rtol=0, atol=rounding)
    assert packet.stamp == number


@given(st.binary(max_size=400))
def test_nonsense_is_no_answer(data: bytes) -> None:
    assert parse_sensor(data) is None
    assert parse_command(data) is None
