"""What only a KUKA arm's driver is tried with, beside what `test_makers` tries with all three."""

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
from cells import EXAMPLES
from command import tjscan
from maker_cell import (
    KUKA,
    MakerCell,
    assert_is_at,
    assert_was_never_too_fast,
    stream_processes,
)
from pydantic import TypeAdapter, ValidationError

from tjscan.core import errors
from tjscan.robot.cyclic.arm import rows_of_cycles
from tjscan.robot.kuka.settings import KukaSettings
from tjscan.robot.path import PathPlanner

JOB = EXAMPLES / "kr5_arc.toml"

SILENCE = 5.0
"""Seconds after which a controller is silent: a busy machine is, for less."""


@pytest.fixture(scope="module")
def running() -> Iterator[MakerCell]:
    """A controller that stays for all tests of this module."""
    with MakerCell(KUKA) as cell:
        yield cell


@pytest.fixture
def cell(running: MakerCell) -> Iterator[MakerCell]:
    """That controller, all right and where it started; no process of the driver is left behind."""
    running.schedule_fault("home")
    running.unread_output()
    yield running
    assert stream_processes() == []


def test_a_controller_that_hears_nothing_stops_within_its_time_out(cell: MakerCell) -> None:
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
            arm.move_joint_to_pose(KUKA.beside_home(0.3))
        holder.join()
    assert_was_never_too_fast(cell)
    cell.schedule_fault("clear")
    with cell.arm() as arm:  # a person started the program again
        arm.move_joint_to_pose(KUKA.beside_home(0.05))
        assert_is_at(cell, KUKA.beside_home(0.05))


DRIVER = """
import sys
sys.path.insert(0, sys.argv[3])
from tjscan.core.errors import MoveSupervisionLost
from tjscan.robot.cyclic.arm import CyclicArm
from tjscan.robot.kuka.settings import KukaSettings
from tjscan.robot.path import MotionLimits, PathPlanner
from maker_cell import KUKA
settings = KukaSettings(sys.argv[1], bind=sys.argv[2], silence_limit=30.0)
with CyclicArm(KUKA.kinematics, settings, MotionLimits(tcp_speed=0.005)) as arm:
    for _ in range(2):
        try:
            arm.move_joint_to_pose(KUKA.beside_home(0.3))
            print("arrived")
        except MoveSupervisionLost as fault:
            print("stopped", fault)
"""
"""A program that moves an arm, for a minute on the controller's clock."""


@pytest.fixture
def program(cell: MakerCell) -> Iterator[subprocess.Popen[str]]:
    """A program that moves the arm; it is ended."""
    folder = str(Path(__file__).parents[1] / "support")
    command = [sys.executable, "-c", DRIVER, cell.host, cell.bind, folder]
    cell.schedule_fault("double-packet 100")
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        cell.wait_for_line("fault double-packet")
        yield process
        process.kill()


def test_the_arm_comes_to_rest_when_the_program_is_killed(
    cell: MakerCell, program: subprocess.Popen[str]
) -> None:
    program.kill()
    cell.wait_for_line("at rest")
    cell.wait_for_line("ended")
    assert np.linalg.norm(KUKA.kinematics.forward(cell.true_q()) - KUKA.beside_home(0.3)) > 0.01
    assert_was_never_too_fast(cell)


def test_the_arm_comes_to_rest_when_the_program_stands_still(
    cell: MakerCell, program: subprocess.Popen[str]
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


def test_an_arm_that_is_held_short_of_its_goal_has_not_arrived(cell: MakerCell) -> None:
    goal = KUKA.beside_home(0.05)
    rows = rows_of_cycles(
        PathPlanner(KUKA.kinematics, cell.limits).joint_path(KUKA.home, goal), 4e-3
    )
    with cell.arm() as arm:
        cell.schedule_fault(f"stand {len(rows) - 15}")
        with pytest.raises(errors.PoseNotReached):
            arm.move_joint_to_pose(goal)
        with pytest.raises(errors.PoseNotReached):
            arm.move_joint_to_pose(KUKA.beside_home())


def test_a_pose_out_of_reach_moves_nothing(cell: MakerCell) -> None:
    with cell.arm() as arm:
        with pytest.raises(errors.PoseUnreachable):
            arm.move_linear(KUKA.beside_home(5.0))
        with pytest.raises(errors.PoseUnreachable):
            arm.check_moves(KUKA.beside_home(0.05), KUKA.beside_home(5.0))
    assert not any(line.startswith("at rest") for line in cell.unread_output())


def test_it_moves_on_the_walls_clock_too() -> None:
    # A busy machine misses cycles; that costs time.
    cell = MakerCell(KUKA, "--realtime", "--cycle-ms", "12", "--timeout", "100000")
    with cell, cell.arm(cycle=12e-3) as arm:
        arm.move_joint_to_pose(KUKA.beside_home(0.05))
        assert_is_at(cell, KUKA.beside_home(0.05))


def test_a_dry_run_moves_nothing(cell: MakerCell) -> None:
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
