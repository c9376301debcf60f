"""The real arm's driver follows paths on the loopback controller, whatever comes between."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from followed import START, distance_from_paths, gentle_path
from ur_cell import KINEMATICS, address, arm_at

from tjscan.core import errors
from tjscan.core.frames import Array, pose
from tjscan.robot.arm import ArmState
from tjscan.robot.following import Following, JointMotion
from tjscan.robot.ur.arm import UrArm
from tjscan.robot.ur.dashboard import DashboardClient
from tjscan.robot.ur.following import UrFollowing
from tjscan_loopback.process import UrLoopbackProcess

pytest.importorskip("rtde_control")

REPLAN_PERIOD = 0.15
AHEAD = 0.4
"""Seconds that a path is given ahead: more than scans need, on a busy machine too."""

BESIDE = 1e-3
"""Radians by which an arm that lags behind cuts the corners of its path."""

CLOCK = 5000.0

LONGEST_PROGRAM = 60.0
"""Seconds in which a program ends that hears nothing more, on a busy machine."""


@pytest.fixture(scope="module")
def running() -> Iterator[UrLoopbackProcess]:
    degrees = [f"{angle:.9f}" for angle in np.degrees(START)]
    options = ("--hz", "500", "--fast", "--clock", str(CLOCK), "80")
    with UrLoopbackProcess(address(), *options, "--home-deg", *degrees) as loopback:
        yield loopback


@pytest.fixture
def loopback(running: UrLoopbackProcess) -> UrLoopbackProcess:
    await_end_of_program(running)
    running.schedule_fault("home")
    return running


def await_end_of_program(loopback: UrLoopbackProcess) -> None:
    """Let the controller go on if it was frozen, until its program has ended."""
    loopback.schedule_fault("clear")
    dashboard, until = DashboardClient(loopback.host), time.monotonic() + LONGEST_PROGRAM
    while dashboard.ask_dashboard_value("running") != "false":
        assert time.monotonic() < until, loopback.unread_output()
        time.sleep(0.05)
    dashboard.close()


class Follower:
    """Leads an arm along paths that change again and again, and remembers everything."""

    def __init__(self, following: Following, seed: int) -> None:
        assert isinstance(following, UrFollowing)
        self.following, self.random = following, np.random.default_rng(seed)
        self.states: list[ArmState] = list(following.states())
        self.path = JointMotion.at_rest(self.states[-1].q, following.now)
        self.paths, self.refused = [self.path], 0

    def lead(self, seconds: float) -> None:
        """Follow for some seconds on the wall's clock, then no more."""
        until, due = time.monotonic() + seconds, 0.0
        while (now := time.monotonic()) < until:
            if now > due:
                due = now + REPLAN_PERIOD
                self.replan()
            self.look()
            time.sleep(0.005)

    def replan(self) -> None:
        self.path = self.following._motion  # or the one before, where that was refused
        later = gentle_path(self.random, self.path, self.following.now + AHEAD)
        self.paths.append(later)
        try:
            self.following.replace(later)
        except errors.PathNotExtended:
            self.refused += 1
        else:
            self.path = later

    def look(self) -> None:
        self.states += self.following.states()

    def look_on(self, seconds: float) -> None:
        """Look for some seconds on the controller's clock, which is slow on a busy machine."""
        until = self.states[-1].time + seconds
        while self.states[-1].time < until:
            self.look()
            time.sleep(0.005)

    def wait_for_rest(self) -> None:
        self.look()
        while self.following.now < self.following._motion.end + 0.3:
            self.look()
            time.sleep(0.005)
        self.path = self.following._motion

    def farthest(self) -> float:
        return max(distance_from_paths(state.q, self.paths) for state in self.states[::20])


def lead_into(
    arm: UrArm, paths: list[JointMotion], come: Callable[[], object], seconds: float
) -> None:
    """Lead an arm along paths, which are remembered, until something comes, and on."""
    with arm.follow() as following:
        follower = Follower(following, seed=3)
        follower.paths = paths
        follower.lead(1.0)
        come()
        follower.lead(seconds)


def joint_angles(loopback: UrLoopbackProcess) -> Array:
    """Joint angles that another client sees."""
    from rtde_receive import RTDEReceiveInterface

    link = RTDEReceiveInterface(loopback.host, 125.0, ["actual_q", "actual_qd"])
    try:
        time.sleep(0.1)
        assert not np.any(link.getActualQd())
        return np.array(link.getActualQ())
    finally:
        link.disconnect()


def test_the_arm_follows_to_the_end_and_moves_as_before_afterwards(
    loopback: UrLoopbackProcess,
) -> None:
    goal = pose(p=(0.0, 0.0, 0.02)) @ KINEMATICS.forward(START)
    with arm_at(loopback.host) as arm:
        arm.move_linear(goal)
        for seed in range(2):
            with arm.follow() as following:
                follower = Follower(following, seed)
                follower.lead(2.0)
                follower.wait_for_rest()
            assert follower.refused < len(follower.paths) - 1  # a busy machine sends many late
            assert follower.farthest() < BESIDE
            np.testing.assert_allclose(follower.states[-1].q, follower.path.q[-1], atol=1e-5)
            np.testing.assert_allclose(arm.state().q, follower.path.q[-1], atol=1e-5)
            times = np.array([state.time for state in follower.states])
            assert times[0] > CLOCK
            assert np.diff(times).max() < 0.02
            for state in follower.states[::50]:
                np.testing.assert_allclose(KINEMATICS.forward(state.q), state.T_b_f, atol=1e-6)
        arm.move_joint_to_pose(goal)


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        ("protective-stop", errors.ProtectiveStop),
        ("emergency-stop", errors.EmergencyStop),
        ("power-off", errors.ArmNotPowered),
        ("local-mode", errors.ArmNotInRemoteMode),
        ("drop-link", errors.ArmConnectionLost),
        ("stop-program", errors.ProgramStopped),
        ("freeze", errors.ArmNotResponding),
    ],
)
def test_a_fault_is_told_by_its_name_and_the_arm_rests_on_its_path(
    loopback: UrLoopbackProcess, fault: str, error: type[errors.ArmFault]
) -> None:
    paths: list[JointMotion] = []
    with arm_at(loopback.host) as arm, pytest.raises(error):
        lead_into(arm, paths, lambda: loopback.schedule_fault(fault), 8.0)
    await_end_of_program(loopback)
    assert distance_from_paths(joint_angles(loopback), paths) < BESIDE


@pytest.mark.parametrize(
    "fault", ["lose-packets", "late-packets", "double-packets", "reorder-packets"]
)
def test_packets_may_come_late_twice_or_never(loopback: UrLoopbackProcess, fault: str) -> None:
    with arm_at(loopback.host) as arm, arm.follow() as following:
        follower = Follower(following, 4)
        loopback.schedule_fault(fault)
        follower.lead(3.0)
        loopback.schedule_fault("clear")
        follower.look()
        follower.look_on(3.0)  # to the end of whichever path is followed
    assert follower.farthest() < BESIDE
    assert len({len(follower.paths), follower.refused}) == 2  # not all were refused


def test_where_nothing_more_arrives_the_arm_rests_at_the_end_of_its_path(
    loopback: UrLoopbackProcess,
) -> None:
    with arm_at(loopback.host) as arm, arm.follow() as following:
        follower = Follower(following, 5)
        follower.lead(1.0)
        loopback.schedule_fault("freeze-registers")
        follower.look_on(3.0)
        assert distance_from_paths(follower.states[-1].q, follower.paths) < BESIDE
        assert np.abs(follower.states[-1].q - follower.states[-9].q).max() < 1e-6
        loopback.schedule_fault("clear")


def test_at_half_speed_the_same_path_takes_twice_as_long(loopback: UrLoopbackProcess) -> None:
    loopback.schedule_fault("slider-half")
    with arm_at(loopback.host) as arm, arm.follow() as following:
        follower = Follower(following, 6)
        follower.replan()
        began = follower.states[-1].time
        follower.wait_for_rest()
    assert follower.farthest() < BESIDE
    duration = follower.states[-1].time - began
    assert duration == pytest.approx(2 * (follower.path.end + 0.3 - began), rel=0.1)


def test_a_stop_brings_it_to_rest_on_its_path(loopback: UrLoopbackProcess) -> None:
    paths: list[JointMotion] = []
    with arm_at(loopback.host) as arm:
        with pytest.raises(errors.ArmFault, match="stopped on its path"):
            lead_into(arm, paths, threading.Timer(0.3, arm.stop).start, 3.0)
        assert distance_from_paths(arm.state().q, paths) < BESIDE


def test_without_the_client_the_arm_rests_at_the_end_of_its_path(
    loopback: UrLoopbackProcess,
) -> None:
    """The process that sends knots is gone, as when this computer fails."""
    paths: list[JointMotion] = []

    def vanish() -> None:
        arm._connected_session.link._process.kill()
        await_end_of_program(loopback)

    with arm_at(loopback.host) as arm, pytest.raises(errors.ArmFault):
        lead_into(arm, paths, vanish, 1.0)
    assert distance_from_paths(joint_angles(loopback), paths) < BESIDE
