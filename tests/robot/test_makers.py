"""Drivers of three makers, through their process and UDP, against the loopback controllers."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from cells import EXAMPLES, FAULTLESS, scan_example
from command import tjscan
from maker_cell import (
    ABB,
    ARRIVAL,
    FANUC,
    KUKA,
    Maker,
    MakerCell,
    assert_is_at,
    assert_was_never_too_fast,
    stream_processes,
)
from pydantic import TypeAdapter, ValidationError
from ur_cell import address

from tjscan.core import errors
from tjscan.core.frames import Array, pose
from tjscan.robot.cyclic.arm import CyclicArm
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits

SILENCE = 5.0
"""Seconds after which a controller is silent: a busy machine is, for less."""

MAKERS = pytest.mark.parametrize("maker", [ABB, FANUC, KUKA], ids=lambda maker: maker.name)


@pytest.fixture(scope="module", params=[ABB, FANUC, KUKA], ids=lambda maker: maker.name)
def running(request: pytest.FixtureRequest) -> Iterator[MakerCell]:
    """A controller that stays for all tests of this module."""
    with MakerCell(request.param) as cell:
        yield cell


@pytest.fixture
def cell(running: MakerCell) -> Iterator[MakerCell]:
    """That controller, all right and where it started; no process of the driver is left behind."""
    running.schedule_fault("home")
    running.unread_output()
    yield running
    assert stream_processes() == []


def test_moves_arrive_where_they_were_told_to(cell: MakerCell) -> None:
    beside = cell.maker.beside_home
    with cell.arm() as arm:
        before = arm.state()
        for move, T_b_f in (
            (arm.move_joint_to_pose, beside(0.05, 0.03)),
            (arm.move_linear, beside(0.0, 0.04)),
            (arm.move_linear, beside(0.0, 0.04)),
            (arm.move_linear, beside()),
        ):
            reached = move(T_b_f)
            assert_is_at(cell, T_b_f)
            np.testing.assert_allclose(reached.T_b_f[:3, 3], T_b_f[:3, 3], rtol=0, atol=ARRIVAL)
            np.testing.assert_array_equal(cell.maker.kinematics.forward(reached.q), reached.T_b_f)
            assert reached.time > before.time
            before = reached
    cell.wait_for_line("ended")
    assert_was_never_too_fast(cell)


@pytest.mark.parametrize(
    ("fault", "event"),
    [
        ("lose-packet", "that never came"),
        ("double-packet", "with a repeated {}"),
        ("old-packet", "with an older {}"),
        ("foreign-packet", "from another address"),
    ],
)
def test_one_packet_more_or_less_is_nothing_but_an_event(
    cell: MakerCell, fault: str, event: str
) -> None:
    heard: list[str] = []
    event, goal = event.format(cell.maker.stamp), cell.maker.beside_home(0.0, 0.05)
    with cell.arm() as arm:
        arm.report_events_to(lambda name, sentence: heard.append(f"{name}: {sentence}"))
        for cycles in (20, 60):
            cell.schedule_fault(f"{fault} {cycles}")
        arm.move_joint_to_pose(goal)
        cell.wait_for_line(f"fault {fault}")
        assert_is_at(cell, goal)
    assert_was_never_too_fast(cell)
    assert [line.rpartition(" of the controller ")[2] for line in heard] == [event]


@pytest.mark.parametrize("fault", ["lose-answer", "late-answer"])
def test_an_answer_that_is_lost_or_late_is_made_up_for(cell: MakerCell, fault: str) -> None:
    goal = cell.maker.beside_home(0.0, 0.05)
    with cell.arm() as arm:
        for cycles in (20, 60):
            cell.schedule_fault(f"{fault} {cycles}")
        arm.move_joint_to_pose(goal)
        cell.wait_for_line(f"fault {fault}")
        assert_is_at(cell, goal)
    if cell.maker is KUKA:  # which reports what it took
        assert_was_never_too_fast(cell)


LOST = errors.ArmConnectionLost
ENDS: dict[str, dict[str, tuple[type[errors.ArmFault], str]]] = {
    "abb": {
        "lose-answers": (LOST, "answers did not reach"),
        "lose-packets": (LOST, "seqno .* jumped"),
        "wrong-seqno": (LOST, "seqno .* jumped"),
        "wrong-type": (LOST, "mtype is 4"),
        "malformed": (LOST, "refused"),
        "frozen-seqno": (errors.ArmNotResponding, "repeated seqno"),
        "stop": (errors.ArmNotResponding, "nothing new came"),
        "stand": (errors.ProtectiveStop, "motors of the arm are off"),
        "stop-program": (errors.ProgramStopped, "the RAPID program .* is stopped"),
    },
    "fanuc": {
        "lose-answers": (LOST, "answers did not reach"),
        "lose-packets": (LOST, "number .* jumped"),
        "wrong-number": (LOST, "number .* jumped"),
        "wrong-type": (LOST, "type 203"),
        "malformed": (LOST, "194 bytes"),
        "frozen-number": (errors.ArmNotResponding, "repeated number"),
        "stop": (errors.ArmNotResponding, "nothing new came"),
        "stand": (errors.EmergencyStop, "emergency stop"),
        "stop-program": (errors.ProgramStopped, "stream motion program .* is stopped"),
    },
    "kuka": {
        "lose-answers": (LOST, "answers did not reach"),
        "lose-packets": (LOST, "IPOC .* jumped"),
        "wrong-ipoc": (LOST, "IPOC .* jumped"),
        "wrong-type": (LOST, "Type 'KAKU'"),
        "malformed": (LOST, "no XML"),
        "frozen-ipoc": (errors.ArmNotResponding, "repeated IPOC"),
        "stop": (errors.ArmNotResponding, "nothing new came"),
        "stand": (errors.ProtectiveStop, "the arm stands"),
        "stop-program": (errors.ProgramStopped, "interpreter's state is 4"),
    },
}
SILENCING = ("lose-answers", "frozen-seqno", "frozen-number", "frozen-ipoc", "stop")


@pytest.mark.parametrize("number", range(9))
def test_each_fault_in_a_move_ends_it_by_name_and_holds(cell: MakerCell, number: int) -> None:
    fault, (error, words) = list(ENDS[cell.maker.name].items())[number]
    goal = cell.maker.beside_home(0.0, 0.2)
    with cell.arm(silence=SILENCE if fault in SILENCING else 30.0) as arm:
        cell.schedule_fault(f"{fault} 40")
        with pytest.raises(error, match=words):
            arm.move_joint_to_pose(goal)
        with pytest.raises(error, match=words):
            arm.move_joint_to_pose(cell.maker.beside_home())
        with pytest.raises(error, match=words):
            arm.state()
    rests = cell.true_q()
    assert np.linalg.norm(cell.maker.kinematics.forward(rests)[:3, 3] - goal[:3, 3]) > 0.05
    assert_was_never_too_fast(cell)
    np.testing.assert_array_equal(cell.true_q(), rests)


def test_a_stop_from_another_thread_ends_the_move(cell: MakerCell) -> None:
    with cell.arm(limits=MotionLimits(tcp_speed=0.05)) as arm:

        def stop() -> None:
            cell.wait_for_line("fault double-packet")
            arm.stop()

        cell.schedule_fault("double-packet 40")
        stopper = threading.Thread(target=stop)
        stopper.start()
        with pytest.raises(errors.ArmFault, match="stopped on its way"):
            arm.move_joint_to_pose(cell.maker.beside_home(0.0, 0.2))
        stopper.join()
        here = cell.true_q()
        with pytest.raises(errors.ArmFault, match="was stopped"):
            arm.move_joint_to_pose(cell.maker.beside_home())
        np.testing.assert_array_equal(cell.true_q(), here)
        arm.accept_moves_again()
        arm.move_joint_to_pose(cell.maker.beside_home())
        assert_is_at(cell, cell.maker.beside_home())
    assert_was_never_too_fast(cell)


def test_another_arm_than_the_job_says_is_refused(cell: MakerCell) -> None:
    with (
        pytest.raises(errors.ConfigurationError, match="name the right arm"),
        CyclicArm(Kinematics.load("ur10e"), cell.settings()),
    ):
        pass


class OtherWayArm(CyclicArm):
    """An arm whose first joint turns the other way in the model."""

    def _model_angles(self, q: Array) -> Array:
        return np.asarray(q * (-1, 1, 1, 1, 1, 1))

    _controller_angles = _model_angles


def test_a_joint_that_turns_the_other_way_from_0_is_found_after_the_first_move() -> None:
    straight = ("0", "0", "0", "0", "60", "0")
    home = ABB.kinematics.forward(np.radians([float(angle) for angle in straight]))
    with (
        MakerCell(ABB, "--fast", "--home-deg", *straight) as cell,
        OtherWayArm(ABB.kinematics, cell.settings()) as arm,
    ):
        for T_b_f in (pose(p=(0.0, 0.05, 0.0)) @ home, home):
            with pytest.raises(errors.ArmFault, match="a joint may turn the other way"):
                arm.move_joint_to_pose(T_b_f)
        assert abs(cell.true_q()[0]) > np.radians(1)


def test_a_second_program_is_refused_and_disturbs_nothing(cell: MakerCell) -> None:
    with cell.arm() as arm:
        with pytest.raises(errors.ArmNotConnected, match="can't be listened on"), cell.arm():
            pass
        arm.move_joint_to_pose(cell.maker.beside_home(0.0, 0.05))
        assert_is_at(cell, cell.maker.beside_home(0.0, 0.05))
    with pytest.raises(errors.ArmFault, match="not connected"):
        cell.arm().state()


@MAKERS
def test_no_controller_is_told(maker: Maker) -> None:
    silent = maker.settings(address(), bind=address(), connect_limit=1.0)
    with (
        pytest.raises(errors.ArmNotConnected, match="no packet came"),
        CyclicArm(maker.kinematics, silent),
    ):
        pass


@MAKERS
def test_a_slower_controller_than_the_job_says_is_refused(maker: Maker) -> None:
    with (
        MakerCell(maker, "--fast", "--cycle-ms", "12") as cell,
        pytest.raises(errors.ArmFault, match="where cycle_ms = "),
        cell.arm() as arm,
    ):
        arm.move_joint_to_pose(maker.beside_home(0.0, 0.2))


def test_a_controller_without_a_terminal_is_moved_too() -> None:
    """As ``tjscan abb-loopback &`` of a script has no stdin."""
    cell = MakerCell(ABB)
    options = ("--fast", "--host", cell.host, "--computer", f"{cell.bind}:{ABB.port}")
    program = [sys.executable, "-c", "from tjscan.cli import main; main()", "abb-loopback"]
    with subprocess.Popen(
        [*program, *options], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True
    ) as controller:
        assert controller.stdout is not None
        assert controller.stdout.readline().startswith("ready")
        try:
            with cell.arm(silence=SILENCE) as arm:
                goal = ABB.beside_home(0.05)
                reached = arm.move_joint_to_pose(goal)
        finally:
            controller.kill()
    np.testing.assert_allclose(reached.T_b_f[:3, 3], goal[:3, 3], rtol=0, atol=ARRIVAL)


def test_j3_from_the_horizontal_is_found_by_the_pose() -> None:
    with MakerCell(FANUC, "--fast", "--j3-from-horizontal") as cell, cell.arm() as arm:
        np.testing.assert_allclose(arm.state().q, FANUC.home, atol=1e-6)
        arm.move_joint_to_pose(FANUC.beside_home(0.05, 0.05))
        assert_is_at(cell, FANUC.beside_home(0.05, 0.05))


@pytest.mark.parametrize("j2_deg", ["0", "0.8"])
def test_with_j2_near_0_its_count_of_j3_is_unknown_and_it_is_refused(j2_deg: str) -> None:
    home = ("--home-deg", "0", j2_deg, "0", "0", "-60", "0")
    with (
        MakerCell(FANUC, "--fast", *home) as cell,
        pytest.raises(errors.ConfigurationError, match="jog J2"),
        cell.arm(),
    ):
        pass


def test_an_unsmoothed_path_is_refused_for_its_jerk_by_the_controller() -> None:
    with MakerCell(FANUC) as cell, cell.arm(smoothing=0.0) as arm:
        with pytest.raises(errors.ProtectiveStop, match="with an error"):
            arm.move_joint_to_pose(FANUC.beside_home(0.0, 0.2))
        assert "jerk" in cell.wait_for_line("stopped")


@MAKERS
def test_a_scan_finds_the_sections_that_it_finds_with_the_simulated_arm(maker: Maker) -> None:
    """The maker's example, before its loopback controller as it stands."""
    short, job = FAULTLESS | {"scan.step_mm": 80.0}, EXAMPLES / f"{maker.model}.toml"
    with MakerCell(maker, "--fast", "--cycle-ms", "12") as cell:
        table = {"host": cell.host, "bind": cell.bind, "cycle_ms": 12.0, "silence_s": 30.0}
        driven = scan_example(
            short | {"arm.driver": maker.name, f"arm.{maker.name}": table}, file=job
        )
        assert_was_never_too_fast(cell)
    simulated = scan_example(short, file=job)
    assert len(driven.sections) == len(simulated.sections) >= 8
    for one, other in zip(driven.sections, simulated.sections, strict=True):
        np.testing.assert_allclose(one.points_b, other.points_b, rtol=0, atol=1e-5)  # 0.01 mm


@pytest.mark.parametrize(
    ("maker", "keys", "words"),
    [
        (ABB, {"host": "10.0.0.5"}, "can't send"),
        (ABB, {"host": "127.0.0.5", "cycle_ms": 6.0}, "multiple"),
        (FANUC, {"host": "127.0.0.5", "port": 70000}, "65535"),
        (FANUC, {"host": "10.0.0.5"}, "can't send"),
    ],
)
def test_a_table_that_can_not_be_is_refused(
    maker: Maker, keys: dict[str, object], words: str
) -> None:
    with pytest.raises(ValidationError, match=words):
        TypeAdapter(maker.settings).validate_python(keys)


@pytest.mark.parametrize(
    "options",
    [
        ("abb-loopback", "--cycle-ms", "5"),
        ("abb-loopback", "--timeout-s", "nan"),
        ("abb-loopback", "--timeout-s", "0"),
        ("abb-loopback", "--timeout-s=-1"),
        ("fanuc-loopback", "--patience=-5"),
        ("kuka-loopback", "--timeout=-3"),
        ("abb-loopback", "--computer", "192.168.0.10:6510"),
        ("fanuc-loopback", "--cycle-ms", "99"),
        ("fanuc-loopback", "--host", "0.0.0.0"),
    ],
)
def test_a_loopback_refuses_what_can_not_be(options: tuple[str, ...]) -> None:
    assert tjscan(*options) == 2
