"""Programs of our own on a controller: run to their end, watched, stopped, outputs left off."""

import threading
from collections.abc import Iterator

import pytest
from ur_cell import HOME, KINEMATICS, address, arm_at, output_is_on, tell_dashboard

from tjscan.core.errors import ArmFault, PoseNotReached
from tjscan.core.frames import pose
from tjscan.core.pose_vector import pose_to_vector
from tjscan.robot.ur.moving import UrProgram
from tjscan_loopback.process import UrLoopbackProcess

pytest.importorskip("rtde_control")

OUTPUT = 3
END = pose(p=(0.0, 0.0, 0.05)) @ KINEMATICS.forward(HOME)
OFF = f"def off():\n  set_standard_digital_out({OUTPUT}, False)\nend"


def moving(speed: float, before: str = "") -> UrProgram:
    """Upwards by 50 mm with the output on, at a speed in m/s; after a line of its own."""
    target = ", ".join(f"{x:.9f}" for x in pose_to_vector(END))
    script = (
        f"def up():\n{before}  set_standard_digital_out({OUTPUT}, True)\n"
        f"  movel(p[{target}], a=0.5, v={speed})\n"
        f"  set_standard_digital_out({OUTPUT}, False)\nend"
    )
    return UrProgram(script, END, OFF, OUTPUT)


@pytest.fixture(scope="module")
def running() -> Iterator[UrLoopbackProcess]:
    with UrLoopbackProcess(address()) as loopback:
        yield loopback


@pytest.fixture
def loopback(running: UrLoopbackProcess) -> UrLoopbackProcess:
    running.schedule_fault("clear")
    running.schedule_fault("home")
    return running


def test_a_program_runs_to_its_end(loopback: UrLoopbackProcess) -> None:
    """For longer than the controller waits for a sign of life of this computer."""
    seen: list[bool] = []
    with arm_at(loopback.host) as arm:
        arm.run_program(moving(0.03), lambda: seen.append(output_is_on(loopback.host, OUTPUT)))
    assert seen == [True]
    assert not output_is_on(loopback.host, OUTPUT)


def test_a_stop_ends_the_program_and_switches_its_output_off(loopback: UrLoopbackProcess) -> None:
    with arm_at(loopback.host) as arm:
        stopper = threading.Thread(target=arm.stop)
        with pytest.raises(ArmFault, match="stopped on its way"):
            arm.run_program(moving(0.002), stopper.start)
        stopper.join()
    assert not output_is_on(loopback.host, OUTPUT)


def test_a_program_that_somebody_else_ends_is_told_from_one_that_came_to_its_end(
    loopback: UrLoopbackProcess,
) -> None:
    with arm_at(loopback.host) as arm, pytest.raises(PoseNotReached, match="the program ended"):
        arm.run_program(moving(0.002), lambda: loopback.schedule_fault("stop-program"))
    assert not output_is_on(loopback.host, OUTPUT)


def test_a_program_that_holds_goes_on_once_it_is_let(loopback: UrLoopbackProcess) -> None:
    """And the operator takes longer than the controller waits for a sign of life."""
    operator = threading.Timer(1.5, tell_dashboard, (loopback.host, "play"))
    hold = '  sleep(0.2)\n  popup("go on", blocking=True)\n'
    with arm_at(loopback.host) as arm:
        arm.run_program(moving(0.1, hold), operator.start)
    operator.join()
    assert not output_is_on(loopback.host, OUTPUT)


def test_a_program_that_holds_at_once_has_begun(loopback: UrLoopbackProcess) -> None:
    operator = threading.Timer(0.5, tell_dashboard, (loopback.host, "play"))
    with arm_at(loopback.host) as arm:
        arm.run_program(moving(0.1, '  popup("go on", blocking=True)\n'), operator.start)
    operator.join()
    assert not output_is_on(loopback.host, OUTPUT)


def test_a_hold_is_ended_by_a_stop(loopback: UrLoopbackProcess) -> None:
    hold = '  sleep(0.2)\n  popup("go on", blocking=True)\n'
    with arm_at(loopback.host) as arm:
        stopper = threading.Timer(0.5, arm.stop)
        with pytest.raises(ArmFault, match="stopped on its way"):
            arm.run_program(moving(0.1, hold), stopper.start)
        stopper.join()


def test_a_pause_with_the_output_on_ends_the_program(loopback: UrLoopbackProcess) -> None:
    """An arc that burns on in one place is no pause."""
    with arm_at(loopback.host) as arm, pytest.raises(PoseNotReached, match="the program ended"):
        arm.run_program(moving(0.002), lambda: tell_dashboard(loopback.host, "pause"))
    assert not output_is_on(loopback.host, OUTPUT)


def test_a_fault_of_the_arm_is_told_by_its_own_error(loopback: UrLoopbackProcess) -> None:
    from tjscan.core.errors import ProtectiveStop

    with arm_at(loopback.host) as arm, pytest.raises(ProtectiveStop):
        arm.run_program(moving(0.002), lambda: loopback.schedule_fault("protective-stop"))


def test_where_nobody_watches_any_more_the_controller_ends_the_program(
    loopback: UrLoopbackProcess,
) -> None:
    """The client that feeds the watchdog is gone, as when this computer fails."""
    with arm_at(loopback.host) as arm:
        session = arm._connected_session

        def vanish() -> None:
            session.link._process.kill()

        with pytest.raises(ArmFault):
            arm.run_program(moving(0.002), vanish)
