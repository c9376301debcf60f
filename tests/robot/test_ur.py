"""A real arm's driver, through the real client library and TCP, against the loopback controller."""

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from cells import FAULTLESS, PAPER, scan_example
from command import tjscan
from ur_cell import (
    HOME,
    KINEMATICS,
    SLOWLY,
    address,
    arm_at,
    beside_home,
    client_processes,
    slow_arm_at,
)

from tjscan.core.errors import (
    ArmBusy,
    ArmConnectionLost,
    ArmFault,
    ArmNotConnected,
    ArmNotInRemoteMode,
    ArmNotPowered,
    ArmNotResponding,
    ConfigurationError,
    EmergencyStop,
    MoveSupervisionLost,
    PoseNotReached,
    PoseUnreachable,
    ProgramStopped,
    ProtectiveStop,
    RegistersInUse,
    TargetRefused,
    message_with_notes,
)
from tjscan.core.frames import pose, rot_y, rot_z, rotation_angle_between
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.ur.arm import UrArm
from tjscan.robot.ur.dashboard import DashboardClient
from tjscan.robot.ur.messages import (
    PROGRAM_PLAYING,
    ControllerState,
    RobotMode,
    SafetyMode,
    fault_from_state,
)
from tjscan.robot.ur.settings import UrSettings
from tjscan.scanning.recording import read_recorded_scan
from tjscan_loopback.process import UrLoopbackProcess
from tjscan_loopback.ur.server import RTDE_PORT
from tjscan_loopback.ur.wire import PACKAGE_HEADER, PackageKind

pytest.importorskip("rtde_control")

SAME = 1e-6
"""Metres and radians: both sides solve the same inverse, to 1e-7."""


@pytest.fixture(scope="module")
def running() -> Iterator[UrLoopbackProcess]:
    """A controller that stays for all tests of this module."""
    with UrLoopbackProcess(address(), "--fast") as loopback:
        yield loopback


@pytest.fixture
def loopback(running: UrLoopbackProcess) -> Iterator[UrLoopbackProcess]:
    """That controller, all right and where it started; no client's process is left behind."""
    running.schedule_fault("clear")
    running.schedule_fault("home")
    yield running
    running.schedule_fault("clear")
    assert client_processes() == []


def test_moves_arrive_where_they_were_told_to(loopback: UrLoopbackProcess) -> None:
    with arm_at(loopback.host) as arm:
        for move, T_b_f in (
            (arm.move_joint_to_pose, beside_home(0.05, 0.0, 0.03)),
            (arm.move_linear, beside_home(0.0, 0.04, 0.0)),
            (arm.move_linear, beside_home()),
        ):
            reached = move(T_b_f)
            np.testing.assert_allclose(reached.T_b_f[:3, 3], T_b_f[:3, 3], atol=SAME)
            assert rotation_angle_between(reached.T_b_f, T_b_f) < SAME
            np.testing.assert_allclose(
                KINEMATICS.forward(reached.q), reached.T_b_f, rtol=0, atol=SAME
            )
            before = reached
        assert arm.state().time >= before.time


@pytest.mark.parametrize("off", [0.0, 1e-9, 2e-6])
def test_a_line_to_where_the_arm_is_moves_nothing(loopback: UrLoopbackProcess, off: float) -> None:
    with arm_at(loopback.host) as arm:
        here = arm.move_joint_to_pose(beside_home())
        for _ in range(2):
            state = arm.move_linear(here.T_b_f @ pose(p=(off, 0.0, 0.0)))
        np.testing.assert_allclose(state.T_b_f, here.T_b_f, atol=1e-5)
        arm.move_linear(beside_home(0.02))


def test_it_says_which_arm_it_is_and_sets_what_it_carries(loopback: UrLoopbackProcess) -> None:
    settings = UrSettings(loopback.host, payload=1.25, payload_centre=(0.0, 0.01, 0.08))
    with UrArm(KINEMATICS, settings) as arm:
        assert arm.identity.model == "UR10"
        assert arm.identity.serial
        assert "5.23" in arm.identity.software
        assert arm.identity.payload == pytest.approx(1.25)


def test_nothing_is_moved_to_where_the_arm_does_not_reach(loopback: UrLoopbackProcess) -> None:
    with arm_at(loopback.host) as arm:
        before = arm.state()
        for move in (arm.move_joint_to_pose, arm.move_linear, arm.check_moves):
            with pytest.raises(PoseUnreachable):
                move(beside_home(3.0))
        np.testing.assert_array_equal(arm.state().q, before.q)


def test_another_arm_than_the_job_says_is_refused(loopback: UrLoopbackProcess) -> None:
    with (
        pytest.raises(ConfigurationError, match=r"arm\.model"),
        arm_at(loopback.host, Kinematics.load("ur5e")),
    ):
        pass


MID_MOVE = {
    "protective-stop": ProtectiveStop,
    "emergency-stop": EmergencyStop,
    "power-off": ArmNotPowered,
    "stop-program": ProgramStopped,
    "drop-link": ArmConnectionLost,
    "freeze": ArmNotResponding,
    "local-mode": ArmNotInRemoteMode,
    "miss-target": PoseNotReached,
}


@pytest.mark.parametrize("fault", MID_MOVE)
def test_a_fault_in_mid_move_ends_in_its_error_and_nothing_resumes(
    loopback: UrLoopbackProcess, fault: str
) -> None:
    # A busy machine, too, may be silent for a second.
    with arm_at(loopback.host, silence=1.0 if fault == "freeze" else 30.0) as arm:
        start = arm.move_joint_to_pose(beside_home())
        loopback.schedule_fault(f"{fault} 1" if fault != "miss-target" else fault)
        with pytest.raises(MID_MOVE[fault]) as caught:
            arm.move_linear(beside_home(0.08))
        with pytest.raises(type(caught.value)):
            arm.move_linear(beside_home())
        with pytest.raises(type(caught.value)):
            arm.state()
    loopback.schedule_fault("clear")
    with arm_at(loopback.host) as arm:
        # It stands where the fault left it: on the way, or beside where it should be.
        moved = np.linalg.norm(arm.state().T_b_f[:3, 3] - start.T_b_f[:3, 3])
        assert 1e-3 < moved < 0.09
        arm.move_linear(beside_home())


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        ("protective-stop", ProtectiveStop),
        ("emergency-stop", EmergencyStop),
        ("power-off", ArmNotPowered),
        ("local-mode", ArmNotInRemoteMode),
        ("freeze", ArmNotResponding),
    ],
)
def test_an_arm_that_is_not_ready_is_not_connected(
    loopback: UrLoopbackProcess, fault: str, error: type[ArmFault]
) -> None:
    loopback.schedule_fault(fault)
    with pytest.raises(error), arm_at(loopback.host):
        pass


def test_nobody_at_the_address_is_told_at_once() -> None:
    with pytest.raises(ArmNotConnected, match="no controller answers"), arm_at(address()):
        pass


def test_a_program_of_somebody_else_is_left_alone(loopback: UrLoopbackProcess) -> None:
    with arm_at(loopback.host) as first:
        with pytest.raises(ArmBusy), arm_at(loopback.host):
            pass
        first.move_joint_to_pose(beside_home(0.02))


def test_inputs_that_another_client_writes_are_not_taken(loopback: UrLoopbackProcess) -> None:
    names = b"input_int_register_0,input_double_register_0"
    with socket.create_connection((loopback.host, RTDE_PORT)) as other:
        other.sendall(
            PACKAGE_HEADER.pack(PACKAGE_HEADER.size + len(names), PackageKind.INPUTS) + names
        )
        assert b"IN_USE" not in other.recv(1 << 12)
        with pytest.raises(RegistersInUse), arm_at(loopback.host):
            pass


def test_a_controller_that_takes_no_programs_is_told_apart(loopback: UrLoopbackProcess) -> None:
    # A dashboard, and nothing else behind that address.
    with socket.create_server((address(), 29999)) as server:
        host = server.getsockname()[0]
        answers = {
            b"safetystatus": b"Safetystatus: NORMAL",
            b"robotmode": b"Robotmode: RUNNING",
            b"is in remote control": b"true",
            b"running": b"Program running: false",
        }

        def answer() -> None:
            connection, _ = server.accept()
            with connection, connection.makefile("rb") as lines:
                connection.sendall(b"Connected\n")
                for line in lines:
                    connection.sendall(answers[line.strip()] + b"\n")

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(ArmNotConnected, match="commands"), arm_at(host):
            pass
        thread.join()


def test_a_target_that_the_controller_refuses_is_not_moved_to(loopback: UrLoopbackProcess) -> None:
    with arm_at(loopback.host) as arm:
        before = arm.move_joint_to_pose(beside_home())
        loopback.schedule_fault("refuse-targets")
        with pytest.raises(TargetRefused, match="safety"):
            arm.move_linear(beside_home(0.05))
        np.testing.assert_array_equal(arm.state().q, before.q)
        loopback.schedule_fault("clear")
        arm.move_linear(beside_home(0.05))  # refused targets do no harm


def test_a_stop_ends_the_move_and_leaves_the_arm_at_hand() -> None:
    with UrLoopbackProcess(address()) as loopback, slow_arm_at(loopback.host) as arm:

        def stop() -> None:
            loopback.wait_for_line("move")
            arm.stop()

        stopper = threading.Thread(target=stop)
        stopper.start()
        with pytest.raises(ArmFault, match="stopped on its way"):
            arm.move_joint_to_pose(beside_home(0.3))
        stopper.join()
        stands = arm.state()
        assert np.abs(stands.q - HOME).max() < 0.2
        with pytest.raises(ArmFault, match="taken back"):
            arm.move_joint_to_pose(beside_home())
        # The brake's last state may come after the stop was confirmed: the links are two.
        np.testing.assert_allclose(arm.state().q, stands.q, atol=1e-4)
        arm.accept_moves_again()
        np.testing.assert_allclose(arm.move_joint_to_pose(beside_home()).q, HOME, atol=1e-5)
    assert client_processes() == []


def test_a_stop_given_before_a_move_begins_holds(loopback: UrLoopbackProcess) -> None:
    with arm_at(loopback.host) as arm:
        before = arm.state()
        arm.stop()
        for move in (arm.move_joint_to_pose, arm.move_linear):
            with pytest.raises(ArmFault, match="taken back"):
                move(beside_home(0.1))
        np.testing.assert_array_equal(arm.state().q, before.q)
    with arm:  # connecting again takes it back
        arm.move_joint_to_pose(beside_home(0.05))


def test_a_controller_that_does_not_end_the_program_is_told_of(loopback: UrLoopbackProcess) -> None:
    with arm_at(loopback.host) as arm:
        loopback.schedule_fault("refuse-stop")
        # Not its link alone: a client that connects again may end the program after all.
        (client,) = client_processes()
        os.kill(client, signal.SIGKILL)
        with pytest.raises(ArmConnectionLost) as caught:
            arm.move_linear(beside_home(0.08))
        assert "did not end the program" in message_with_notes(caught.value)
        assert "emergency stop" in message_with_notes(caught.value)


def test_nothing_to_stop_is_stopped(loopback: UrLoopbackProcess) -> None:
    for order in ("clear", "refuse-stop"):
        loopback.schedule_fault(order)
        with closing(DashboardClient(loopback.host)) as dashboard:
            dashboard.stop_program()


DRIVER = """
import sys
sys.path.insert(0, sys.argv[2])
from tjscan.core.errors import MoveSupervisionLost
from tjscan.robot.path import MotionLimits
from tjscan.robot.ur.arm import UrArm
from tjscan.robot.ur.settings import UrSettings
from ur_cell import KINEMATICS, beside_home
with UrArm(KINEMATICS, UrSettings(sys.argv[1]), MotionLimits(tcp_speed=0.05)) as arm:
    for _ in range(2):
        try:
            arm.move_joint_to_pose(beside_home(0.3))
            print("arrived")
        except MoveSupervisionLost as fault:
            print("stopped", fault)
"""
"""A program that moves an arm, for six seconds if they are not shortened."""


def test_the_arm_stops_when_the_program_is_killed() -> None:
    with UrLoopbackProcess(address()) as loopback:
        folder = str(Path(__file__).parents[1] / "support")
        with subprocess.Popen([sys.executable, "-c", DRIVER, loopback.host, folder]) as program:
            loopback.wait_for_line("move")
            program.kill()
        loopback.wait_for_line("program stopped")
        with arm_at(loopback.host) as arm:
            assert np.abs(arm.state().q - HOME).max() < 0.2


def test_the_arm_stops_when_the_program_stands_still() -> None:
    with UrLoopbackProcess(address()) as loopback:
        folder = str(Path(__file__).parents[1] / "support")
        command = [sys.executable, "-c", DRIVER, loopback.host, folder]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
            loopback.wait_for_line("move")
            program.send_signal(signal.SIGSTOP)
            try:
                # Its client lives, and answers the controller's watchdog.
                loopback.wait_for_line("program stopped")
            finally:
                program.send_signal(signal.SIGCONT)
            said, _ = program.communicate()
        assert said.count("stopped this program paused") == 2  # the second is not begun
        assert "arrived" not in said
        assert not any(line.startswith("move") for line in loopback.unread_output())
        with arm_at(loopback.host) as arm:
            moved = np.linalg.norm(arm.state().T_b_f[:3, 3] - beside_home()[:3, 3])
        # A second unfollowed, and what a busy machine adds; without a stop all of 0.3 m.
        assert 1e-3 < moved < 0.2


def test_a_program_that_stands_still_for_a_moment_moves_on() -> None:
    with UrLoopbackProcess(address(), "--fast") as loopback:
        folder = str(Path(__file__).parents[1] / "support")
        command = [sys.executable, "-c", DRIVER, loopback.host, folder]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
            loopback.wait_for_line("move")
            program.send_signal(signal.SIGSTOP)
            program.send_signal(signal.SIGCONT)
            said, _ = program.communicate()
        assert said.splitlines() == ["arrived", "arrived"]


def test_the_controllers_watchdog_stops_an_arm_whose_client_hangs() -> None:
    with UrLoopbackProcess(address()) as loopback, slow_arm_at(loopback.host) as arm:

        def hang() -> None:
            loopback.wait_for_line("move")
            for pid in client_processes():
                os.kill(pid, signal.SIGSTOP)

        hanger = threading.Thread(target=hang)
        hanger.start()
        # The client says nothing; that the controller is well, the dashboard knows.
        with pytest.raises(ArmNotResponding) as told:
            arm.move_joint_to_pose(beside_home(0.3))
        hanger.join()
        assert "Its dashboard does answer" in message_with_notes(told.value)
        loopback.wait_for_line("program stopped")
    assert client_processes() == []


def test_an_interrupted_scan_stops_the_arm(tmp_path: Path) -> None:
    with UrLoopbackProcess(address()) as loopback:
        scan = [sys.executable, "-c", "from tjscan.cli import main; main()", "scan", str(PAPER)]
        ur = ["--arm.driver", "ur", "--arm.ur.host", loopback.host, "--out", str(tmp_path / "run")]
        ur += ["--arm.speed-mm-s", "30"]  # for a first move that lasts
        with subprocess.Popen([*scan, *ur], stderr=subprocess.PIPE, text=True) as program:
            assert program.stderr is not None
            loopback.wait_for_line("move")
            program.send_signal(signal.SIGINT)
            assert any("Ctrl-C again" in line for line in program.stderr)
            program.send_signal(signal.SIGINT)  # and again, which stops the arm at once
            loopback.wait_for_line("program stopped")
            program.communicate()
            assert program.returncode == 130
        events = read_recorded_scan(tmp_path / "run").events
        assert [event.name for event in events] == ["arm", "interrupted"]
        assert "serial number 00000000000" in events[0].detail


def test_a_dashboard_that_hangs_up_is_connected_again(loopback: UrLoopbackProcess) -> None:
    events: list[tuple[str, str]] = []
    with arm_at(loopback.host, silence=20.0) as arm:
        arm.report_events_to(lambda name, detail: events.append((name, detail)))
        loopback.schedule_fault("drop-dashboard 1")
        for x in (0.05, 0.0):
            arm.move_joint_to_pose(beside_home(x))
        loopback.schedule_fault("drop-dashboard")  # and between two moves
        arm.move_joint_to_pose(beside_home(0.05))
    assert [name for name, _ in events] == ["dashboard"] * 2


def test_without_its_dashboard_the_arm_is_stopped() -> None:
    with UrLoopbackProcess(address()) as loopback:
        with slow_arm_at(loopback.host) as arm:

            def close() -> None:
                loopback.wait_for_line("move")
                loopback.schedule_fault("close-dashboard")

            closer = threading.Thread(target=close)
            closer.start()
            with pytest.raises(ArmConnectionLost, match="no second way to stop"):
                arm.move_joint_to_pose(beside_home(0.3))
            closer.join()
        loopback.schedule_fault("clear")
        with arm_at(loopback.host) as arm:
            assert np.linalg.norm(arm.state().T_b_f[:3, 3] - beside_home(0.3)[:3, 3]) > 0.01


@pytest.mark.parametrize(
    ("unheard", "unseen", "error"),
    [
        (0.1, 0.1, ProgramStopped),
        (1.4, 1.4, MoveSupervisionLost),
        (0.1, 1.2, ArmConnectionLost),
    ],
)
def test_a_stopped_program_is_put_down_to_the_one_who_fell_silent(
    unheard: float, unseen: float, error: type[ArmFault]
) -> None:
    zeros = (0.0,) * 6
    modes = (RobotMode.RUNNING, SafetyMode.NORMAL, PROGRAM_PLAYING + 2, 0)
    state = (True, 1.0, zeros, zeros, zeros, *modes, 1, True, unheard, unseen, None, None)
    fault = fault_from_state(ControllerState(*state))
    assert type(fault) is error
    assert ("pendant" in str(fault)) == (error is ProgramStopped)


def test_a_client_held_up_for_a_moment_too_long_is_told_as_that() -> None:
    with (
        UrLoopbackProcess(address()) as loopback,
        UrArm(KINEMATICS, UrSettings(loopback.host, silence_limit=10.0), SLOWLY) as arm,
    ):

        def hold_up() -> None:
            loopback.wait_for_line("move")
            (pid,) = client_processes()
            os.kill(pid, signal.SIGSTOP)
            loopback.wait_for_line("program stopped")  # its watchdog has
            os.kill(pid, signal.SIGCONT)

        holder = threading.Thread(target=hold_up)
        holder.start()
        with pytest.raises(MoveSupervisionLost, match=r"paused|was held up"):
            arm.move_joint_to_pose(beside_home(0.3))
        holder.join()


def test_a_scan_finds_the_sections_that_it_finds_with_the_simulated_arm(
    loopback: UrLoopbackProcess,
) -> None:
    simulated = scan_example(FAULTLESS)
    driven = scan_example(FAULTLESS | {"arm.driver": "ur", "arm.ur": {"host": loopback.host}})
    assert len(driven.sections) == len(simulated.sections) == 16
    for one, other in zip(driven.sections, simulated.sections, strict=True):
        np.testing.assert_allclose(one.points_b, other.points_b, atol=1e-5)  # 0.01 mm


def test_a_fault_in_a_scan_ends_with_its_exit_code_and_a_whole_recording(
    loopback: UrLoopbackProcess, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    loopback.schedule_fault("protective-stop 6")
    ur = ("--arm.driver", "ur", "--arm.ur.host", loopback.host)
    assert tjscan("scan", PAPER, *ur, "--out", run) == 4
    assert "protective stop" in capsys.readouterr().err
    scan = read_recorded_scan(run)
    assert len(scan.sections) == 3
    assert any(event.name == "failed" for event in scan.events)
    # While the stop stands, nothing goes on; when the operator has cleared it, the scan does.
    assert tjscan("scan", "--resume", run) == 4
    loopback.schedule_fault("clear")
    assert tjscan("scan", "--resume", run) == 0
    assert (run / "summary.json").exists()


def test_a_dry_run_moves_nothing(loopback: UrLoopbackProcess) -> None:
    loopback.unread_output()
    ur = ("--arm.driver", "ur", "--arm.ur.host", loopback.host)
    assert tjscan("scan", PAPER, *ur, "--dry-run") == 0
    assert not any(line.startswith("move") for line in loopback.unread_output())


def test_two_arms_work_side_by_side(loopback: UrLoopbackProcess) -> None:
    with (
        UrLoopbackProcess(address(), "--fast") as second,
        arm_at(loopback.host) as one,
        arm_at(second.host) as other,
    ):
        one.move_joint_to_pose(beside_home(0.05))
        reached = other.move_joint_to_pose(beside_home(0.0, 0.05))
        np.testing.assert_allclose(reached.T_b_f[:3, 3], beside_home(0.0, 0.05)[:3, 3], atol=SAME)
        np.testing.assert_allclose(one.state().T_b_f[:3, 3], beside_home(0.05)[:3, 3], atol=SAME)
        second.schedule_fault("protective-stop 1")
        with pytest.raises(ProtectiveStop):
            other.move_linear(beside_home())
        one.move_linear(beside_home())


def test_the_loopback_starts_where_it_is_told_to() -> None:
    for wrong in ("nan", "inf", "400"):
        angles = ("-100", "-90", "150", wrong, "-100", "10")
        assert tjscan("ur-loopback", "--host", address(), "--home-deg", *angles) == 2
    angles = ("-100", "-90", "150", "100", "-100", "10")
    with UrLoopbackProcess(address(), "--home-deg", *angles) as loopback:
        with arm_at(loopback.host) as arm:
            np.testing.assert_allclose(np.degrees(arm.state().q), [float(a) for a in angles])
        with pytest.raises(ArmNotConnected), UrLoopbackProcess(loopback.host):
            pass  # that address is taken


def test_the_loopback_listens_to_this_machine_alone() -> None:
    for host in ("0.0.0.0", "192.168.0.10", "localhost", "::1"):
        assert tjscan("ur-loopback", "--host", host) == 2
    assert tjscan("ur-loopback", "--model", "ur99", "--host", address()) == 2
    assert tjscan("ur-loopback", "--hz", "0", "--host", address()) == 2


def test_a_job_for_a_real_arm_needs_its_host(capsys: pytest.CaptureFixture[str]) -> None:
    assert tjscan("scan", PAPER, "--arm.driver", "ur", "--dry-run") == 2
    assert "[arm.ur]" in capsys.readouterr().err


def test_a_turn_on_the_spot_arrives_and_a_wide_one_is_not_begun(
    loopback: UrLoopbackProcess,
) -> None:
    with arm_at(loopback.host) as arm:
        before = arm.state()
        turned = before.T_b_f @ pose(rot_z(0.05))
        assert rotation_angle_between(arm.move_linear(turned).T_b_f, turned) < SAME
        here = arm.state().q
        with pytest.raises(TargetRefused, match="turn in parts"):
            arm.move_linear(turned @ pose(rot_y(0.6)))
        np.testing.assert_array_equal(arm.state().q, here)
