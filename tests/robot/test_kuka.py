"""A KUKA arm's driver, through its own process and UDP, against the loopback controller."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from cells import EXAMPLES, FAULTLESS, scan_example
from command import tjscan
from kuka_cell import HOME, KINEMATICS, LIMITS, KukaCell, beside_home, stream_processes
from pydantic import TypeAdapter, ValidationError
from ur_cell import address

from tjscan.core import errors
from tjscan.core.frames import Array, rotation_angle_between
from tjscan.robot.cyclic.arm import CyclicArm as KukaArm
from tjscan.robot.cyclic.arm import rows_of_cycles
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.kuka.settings import KukaSettings
from tjscan.robot.path import MotionLimits, PathPlanner

JOB = EXAMPLES / "kr5_arc.toml"

ARRIVAL = 1e-5
"""Metres between a goal and the arm."""

ARRIVAL_TURN = np.radians(1e-3)

ROUNDING = 1e-4
"""Share of a joint's speed that the digits of a packet are."""

SILENCE = 5.0
"""Seconds after which a controller is silent: a busy machine is, for less."""

SILENCING = ("lose-answers", "frozen-ipoc", "stop")
"""Faults after which nothing new comes."""

SLOWLY = MotionLimits(tcp_speed=0.05)


@pytest.fixture(scope="module")
def running() -> Iterator[KukaCell]:
    """A controller that stays for all tests of this module."""
    with KukaCell() as cell:
        yield cell


@pytest.fixture
def cell(running: KukaCell) -> Iterator[KukaCell]:
    """That controller, all right and where it started; no process of the driver is left behind."""
    running.schedule_fault("home")
    running.unread_output()
    yield running
    assert stream_processes() == []


def assert_is_at(cell: KukaCell, T_b_f: Array) -> None:
    there = KINEMATICS.forward(cell.true_q())
    np.testing.assert_allclose(there[:3, 3], T_b_f[:3, 3], rtol=0, atol=ARRIVAL)
    assert rotation_angle_between(there, T_b_f) < ARRIVAL_TURN


def assert_was_never_too_fast(cell: KukaCell) -> None:
    truth = cell.ask_for_truth()
    assert truth["fastest"] <= LIMITS.joint_speed * (1 + ROUNDING)
    assert truth["misread"] == 0


def test_moves_arrive_where_they_were_told_to(cell: KukaCell) -> None:
    with cell.arm() as arm:
        before = arm.state()
        for move, T_b_f in (
            (arm.move_joint_to_pose, beside_home(0.05, 0.03)),
            (arm.move_linear, beside_home(0.0, 0.04)),
            (arm.move_linear, beside_home(0.0, 0.04)),
            (arm.move_linear, beside_home()),
        ):
            reached = move(T_b_f)
            assert_is_at(cell, T_b_f)
            np.testing.assert_allclose(reached.T_b_f[:3, 3], T_b_f[:3, 3], rtol=0, atol=ARRIVAL)
            np.testing.assert_array_equal(KINEMATICS.forward(reached.q), reached.T_b_f)
            assert reached.time > before.time
            before = reached
    cell.wait_for_line("ended")
    assert_was_never_too_fast(cell)


@pytest.mark.parametrize(
    ("fault", "event"),
    [
        ("lose-answer", None),
        ("late-answer", None),
        ("lose-packet", "that never came"),
        ("double-packet", "with a repeated IPOC"),
        ("old-packet", "with an older IPOC"),
        ("foreign-packet", "from another address"),
    ],
)
def test_one_packet_more_or_less_is_nothing_but_an_event(
    cell: KukaCell, fault: str, event: str | None
) -> None:
    heard: list[str] = []
    with cell.arm() as arm:
        arm.report_events_to(lambda name, sentence: heard.append(f"{name}: {sentence}"))
        for cycles in (20, 60):
            cell.schedule_fault(f"{fault} {cycles}")
        arm.move_joint_to_pose(beside_home(0.05))
        cell.wait_for_line(f"fault {fault}")
        assert_is_at(cell, beside_home(0.05))
    assert_was_never_too_fast(cell)
    assert [line.rpartition(" of the controller ")[2] for line in heard] == [event] * bool(event)


@pytest.mark.parametrize(
    ("fault", "error", "words"),
    [
        ("lose-answers", errors.ArmConnectionLost, "answers did not reach"),
        ("lose-packets", errors.ArmConnectionLost, r"IPOC .* jumped"),
        ("wrong-ipoc", errors.ArmConnectionLost, r"IPOC .* jumped"),
        ("wrong-type", errors.ArmConnectionLost, "Type 'KAKU'"),
        ("malformed", errors.ArmConnectionLost, "no XML"),
        ("frozen-ipoc", errors.ArmNotResponding, "repeated IPOC"),
        ("stop", errors.ArmNotResponding, "nothing new came"),
        ("stand", errors.ProtectiveStop, "the arm stands"),
        ("stop-program", errors.ProgramStopped, "interpreter's state is 4"),
    ],
)
def test_each_fault_in_a_move_ends_it_by_name_and_holds(
    cell: KukaCell, fault: str, error: type[errors.ArmFault], words: str
) -> None:
    goal = beside_home(0.3)
    with cell.arm(silence=SILENCE if fault in SILENCING else 30.0) as arm:
        cell.schedule_fault(f"{fault} 40")
        with pytest.raises(error, match=words):
            arm.move_joint_to_pose(goal)
        with pytest.raises(error, match=words):
            arm.move_joint_to_pose(beside_home())
        with pytest.raises(error, match=words):
            arm.state()
    rests = cell.true_q()
    assert np.linalg.norm(KINEMATICS.forward(rests)[:3, 3] - goal[:3, 3]) > 0.1
    assert_was_never_too_fast(cell)
    np.testing.assert_array_equal(cell.true_q(), rests)


def test_a_controller_that_hears_nothing_stops_within_its_time_out(cell: KukaCell) -> None:
    with cell.arm(silence=SILENCE) as arm:

        def hold_up() -> None:
            cell.wait_for_line("fault double-packet")
            (process,) = stream_processes()
            os.kill(process, signal.SIGSTOP)
            cell.schedule_fault("unanswered")
            cell.wait_for_line("stopped: 100 answers")
            os.kill(process, signal.SIGCONT)

        cell.schedule_fault("double-packet 40")
        holder = threading.Thread(target=hold_up)
        holder.start()
        with pytest.raises(errors.MoveSupervisionLost, match="held up"):
            arm.move_joint_to_pose(beside_home(0.3))
        holder.join()
    assert_was_never_too_fast(cell)
    cell.schedule_fault("clear")
    with cell.arm() as arm:  # a person started the program again
        arm.move_joint_to_pose(beside_home(0.05))
        assert_is_at(cell, beside_home(0.05))


DRIVER = """
import sys
sys.path.insert(0, sys.argv[3])
from tjscan.core.errors import MoveSupervisionLost
from tjscan.robot.cyclic.arm import CyclicArm as KukaArm
from tjscan.robot.kuka.settings import KukaSettings
from tjscan.robot.path import MotionLimits, PathPlanner
from kuka_cell import KINEMATICS, beside_home
settings = KukaSettings(sys.argv[1], bind=sys.argv[2], silence_limit=30.0)
with KukaArm(KINEMATICS, settings, MotionLimits(tcp_speed=0.005)) as arm:
    for _ in range(2):
        try:
            arm.move_joint_to_pose(beside_home(0.3))
            print("arrived")
        except MoveSupervisionLost as fault:
            print("stopped", fault)
"""
"""A program that moves an arm, for a minute on the controller's clock."""


@pytest.fixture
def program(cell: KukaCell) -> Iterator[subprocess.Popen[str]]:
    """A program that moves the arm; it is ended."""
    folder = str(Path(__file__).parents[1] / "support")
    command = [sys.executable, "-c", DRIVER, cell.host, cell.bind, folder]
    cell.schedule_fault("double-packet 100")
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        cell.wait_for_line("fault double-packet")
        yield process
        process.kill()


def test_the_arm_comes_to_rest_when_the_program_is_killed(
    cell: KukaCell, program: subprocess.Popen[str]
) -> None:
    program.kill()
    cell.wait_for_line("at rest")
    cell.wait_for_line("ended")
    assert np.linalg.norm(KINEMATICS.forward(cell.true_q()) - beside_home(0.3)) > 0.01
    assert_was_never_too_fast(cell)


def test_the_arm_comes_to_rest_when_the_program_stands_still(
    cell: KukaCell, program: subprocess.Popen[str]
) -> None:
    program.send_signal(signal.SIGSTOP)
    try:
        cell.wait_for_line("at rest")
    finally:
        program.send_signal(signal.SIGCONT)
    said, _ = program.communicate()
    assert said.count("stopped this program paused") == 2  # the second is not begun
    assert "arrived" not in said
    assert_was_never_too_fast(cell)


def test_a_stop_from_another_thread_ends_the_move_and_holds_until_it_is_taken_back(
    cell: KukaCell,
) -> None:
    with cell.arm(limits=SLOWLY) as arm:

        def stop() -> None:
            cell.wait_for_line("fault double-packet")
            arm.stop()

        cell.schedule_fault("double-packet 40")
        stopper = threading.Thread(target=stop)
        stopper.start()
        with pytest.raises(errors.ArmFault, match="stopped on its way"):
            arm.move_joint_to_pose(beside_home(0.3))
        stopper.join()
        here = cell.true_q()
        with pytest.raises(errors.ArmFault, match="was stopped"):
            arm.move_joint_to_pose(beside_home())
        np.testing.assert_array_equal(cell.true_q(), here)
        arm.accept_moves_again()
        arm.move_joint_to_pose(beside_home())
        assert_is_at(cell, beside_home())
    assert_was_never_too_fast(cell)


def test_an_arm_that_is_held_short_of_its_goal_has_not_arrived(cell: KukaCell) -> None:
    goal = beside_home(0.05)
    rows = rows_of_cycles(PathPlanner(KINEMATICS, LIMITS).joint_path(HOME, goal), 4e-3)
    with cell.arm() as arm:
        cell.schedule_fault(f"stand {len(rows) - 15}")
        with pytest.raises(errors.PoseNotReached):
            arm.move_joint_to_pose(goal)
        with pytest.raises(errors.PoseNotReached):
            arm.move_joint_to_pose(beside_home())


def test_a_pose_out_of_reach_moves_nothing(cell: KukaCell) -> None:
    with cell.arm() as arm:
        with pytest.raises(errors.PoseUnreachable):
            arm.move_linear(beside_home(5.0))
        with pytest.raises(errors.PoseUnreachable):
            arm.check_moves(beside_home(0.05), beside_home(5.0))
    assert not any(line.startswith("at rest") for line in cell.unread_output())


def test_no_controller_and_no_address_are_told_apart(cell: KukaCell) -> None:
    silent = KukaSettings(address(), bind=address(), connect_limit=1.0)
    with pytest.raises(errors.ArmNotConnected, match="no packet came"), KukaArm(KINEMATICS, silent):
        pass
    with (
        cell.arm(),
        pytest.raises(errors.ArmNotConnected, match="can't be listened on"),
        cell.arm(),
    ):
        pass
    with pytest.raises(errors.ArmFault, match="not connected"):
        cell.arm().state()


def test_another_arm_than_the_job_says_is_refused(cell: KukaCell) -> None:
    with (
        pytest.raises(errors.ConfigurationError, match=r"name the right arm"),
        KukaArm(Kinematics.load("m10ia"), cell.settings()),
    ):
        pass


def test_a_slower_controller_than_the_job_says_is_refused_by_its_clock() -> None:
    with (
        KukaCell("--fast", "--cycle-ms", "12") as cell,
        cell.arm() as arm,
        pytest.raises(errors.ArmConnectionLost, match="where cycle_ms = 4"),
    ):
        arm.move_joint_to_pose(beside_home(0.3))  # each packet shows two lost ones


def test_it_moves_on_the_walls_clock_too() -> None:
    # A busy machine misses cycles; that costs time.
    cell = KukaCell("--realtime", "--cycle-ms", "12", "--timeout", "100000")
    with cell, KukaArm(KINEMATICS, cell.settings(cycle=12e-3), LIMITS) as arm:
        arm.move_joint_to_pose(beside_home(0.05))
        assert_is_at(cell, beside_home(0.05))


def test_a_scan_finds_the_sections_that_it_finds_with_the_simulated_arm() -> None:
    short = FAULTLESS | {"scan.step_mm": 80.0}
    with KukaCell("--fast", "--cycle-ms", "12") as cell:
        table = {"host": cell.host, "bind": cell.bind, "cycle_ms": 12.0, "silence_s": 30.0}
        driven = scan_example(short | {"arm.driver": "kuka", "arm.kuka": table}, file=JOB)
        assert_was_never_too_fast(cell)
    simulated = scan_example(short, file=JOB)
    assert len(driven.sections) == len(simulated.sections) >= 8
    for one, other in zip(driven.sections, simulated.sections, strict=True):
        np.testing.assert_allclose(one.points_b, other.points_b, rtol=0, atol=1e-5)  # 0.01 mm


def test_a_dry_run_moves_nothing(cell: KukaCell) -> None:
    kuka = ("--arm.driver", "kuka", "--arm.kuka.host", cell.host, "--arm.kuka.bind", cell.bind)
    assert tjscan("scan", JOB, *kuka, "--arm.kuka.silence-s", "30", "--dry-run") == 0
    assert not any(line.startswith("at rest") for line in cell.unread_output())


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"host": "10.0.0.5"}, "can't send"),
        ({"host": "127.0.0.5", "cycle_ms": 5.0}, "4 (IPO_FAST) or 12 (IPO)"),
        ({"host": "127.0.0.5", "sen_type": '"/>'}, "letters and digits"),
        ({"host": "127.0.0.5", "port": 70000}, "65535"),
        ({}, "host"),
    ],
)
def test_a_table_that_can_not_be_is_refused(keys: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=re.escape(words)):
        TypeAdapter(KukaSettings).validate_python(keys)
