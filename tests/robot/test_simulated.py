"""The simulated arm: the protocol, its clock, its errors and its refusals."""

from __future__ import annotations

import threading
from functools import cache

import numpy as np
import pytest

from tjscan.core.errors import ArmFault, ConfigurationError, PoseUnreachable
from tjscan.core.frames import Array, pose, rotation_angle_between
from tjscan.robot.arm import Arm, ArmState
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits, PathPlanner
from tjscan.robot.simulated import SimulatedArm

WELL = np.radians([10, -80, 100, -60, -80, 20])

SOLVED = 5e-9
"""Metres and radians the inverse kinematics may be off."""


@cache
def kinematics() -> Kinematics:
    return Kinematics.load("ur10e")


def ahead(x: float = 0.04) -> Array:
    T_b_f = kinematics().forward(WELL)
    return pose(T_b_f[:3, :3], T_b_f[:3, 3] + [0, x, 0])


def test_it_fulfils_the_protocol_and_reports_what_it_was_told() -> None:
    arm: Arm = SimulatedArm(kinematics(), WELL)
    with arm:
        for move in (arm.move_linear, arm.move_joint_to_pose):
            for T_b_f in (ahead(0.05), ahead(0.0)):
                reached = move(T_b_f)
                np.testing.assert_allclose(reached.T_b_f, T_b_f, rtol=0, atol=SOLVED)
                np.testing.assert_array_equal(reached.q, arm.state().q)


def test_its_clock_runs_with_its_motion() -> None:
    path = PathPlanner(kinematics(), MotionLimits()).linear_path(WELL, ahead())
    with SimulatedArm(kinematics(), WELL) as arm:
        assert arm.state().time == 0
        assert arm.move_linear(ahead()).time == path.duration
        assert arm.state().time == path.duration
        assert arm.move_linear(ahead(0)).time == pytest.approx(2 * path.duration, rel=1e-3)


def test_checking_moves_nothing() -> None:
    with SimulatedArm(kinematics(), WELL) as arm:
        truth = arm.true_T_b_f
        arm.check_moves(ahead())
        assert arm.state().time == 0
        np.testing.assert_array_equal(arm.state().q, WELL)
        np.testing.assert_array_equal(arm.true_T_b_f, truth)


def test_an_unreachable_pose_leaves_it_where_it_is() -> None:
    with SimulatedArm(kinematics(), WELL) as arm:
        truth = arm.true_T_b_f
        for order in (arm.check_moves, arm.move_linear, arm.move_joint_to_pose):
            with pytest.raises(PoseUnreachable, match="reach"):
                order(ahead(3.0))
        assert arm.state().time == 0
        np.testing.assert_array_equal(arm.state().q, WELL)
        np.testing.assert_array_equal(arm.true_T_b_f, truth)


def errors(arm: SimulatedArm, moves: int) -> tuple[Array, Array]:
    """Distances and angles between the true and the reported poses of a number of moves."""
    distances, angles = [], []
    with arm:
        for i in range(moves):
            state = arm.move_joint_to_pose(ahead(0.001 * (i % 2)))
            distances.append(np.linalg.norm(arm.true_T_b_f[:3, 3] - state.T_b_f[:3, 3]))
            angles.append(rotation_angle_between(arm.true_T_b_f, state.T_b_f))
    return np.array(distances), np.array(angles)


def test_repeatability_is_the_root_mean_square_of_the_error() -> None:
    arm = SimulatedArm(kinematics(), WELL, repeatability=(5e-5, 2e-4))
    distances, angles = errors(arm, 600)
    # The root mean square of 600 draws of three normals is known to about 2.4 %: 4 sigma.
    assert np.sqrt(np.mean(distances**2)) == pytest.approx(5e-5, rel=0.1)
    assert np.sqrt(np.mean(angles**2)) == pytest.approx(2e-4, rel=0.1)


def test_a_perfect_arm_stands_where_it_says() -> None:
    arm = SimulatedArm(kinematics(), WELL, repeatability=(0, 0))
    distances, angles = errors(arm, 3)
    assert distances.max() == 0
    assert angles.max() < 1e-15 + SOLVED


def test_the_seed_decides_the_errors() -> None:
    def run(seed: int) -> Array:
        return errors(SimulatedArm(kinematics(), WELL, seed=seed), 5)[0]

    np.testing.assert_array_equal(run(1), run(1))
    assert (run(1) != run(2)).all()


def test_it_obeys_only_while_connected() -> None:
    arm = SimulatedArm(kinematics(), WELL)
    with arm:
        pass
    for order in (arm.check_moves, arm.move_linear, arm.move_joint_to_pose):
        with pytest.raises(ArmFault, match="'with' block"):
            order(ahead())
    with pytest.raises(ArmFault, match="'with' block"):
        arm.state()


def test_in_real_time_it_takes_its_time_and_reaches_the_same() -> None:
    limits = MotionLimits(tcp_speed=1.0, tcp_acceleration=20.0, joint_acceleration=20.0)
    states = []
    for realtime in (False, True):
        with SimulatedArm(kinematics(), WELL, limits=limits, realtime=realtime) as arm:
            states.append(arm.move_linear(ahead()))
    assert states[0].time == states[1].time > 0
    np.testing.assert_array_equal(states[0].q, states[1].q)


def test_a_stop_ends_a_move_on_its_path() -> None:
    limits = MotionLimits(tcp_speed=0.01)  # five seconds, of which it is given a few hundredths
    end = ahead(0.05)
    caught: list[ArmFault] = []
    with SimulatedArm(kinematics(), WELL, limits=limits, realtime=True) as arm:

        def move() -> None:
            try:
                arm.move_linear(end)
            except ArmFault as fault:
                caught.append(fault)

        thread = threading.Thread(target=move)
        thread.start()
        while arm.state().time == 0:
            pass
        with pytest.raises(ArmFault, match="moving already"):
            arm.move_linear(end)
        arm.stop()
        thread.join(timeout=5)
        assert not thread.is_alive()
        assert "was stopped after" in str(caught[0])
        state: ArmState = arm.state()
        assert 0 < state.time < 5
        way = state.T_b_f[:3, 3] - kinematics().forward(WELL)[:3, 3]
        # On the line, within the micrometres that a spline strays from it.
        assert 0 < way[1] < 0.05
        assert np.linalg.norm(way[[0, 2]]) < 5e-6


@pytest.mark.parametrize("realtime", [True, False])
def test_a_stop_between_two_moves_holds_until_it_is_taken_back(realtime: bool) -> None:
    with SimulatedArm(kinematics(), WELL, realtime=realtime) as arm:
        arm.stop()
        for move in (arm.move_linear, arm.move_joint_to_pose):
            with pytest.raises(ArmFault, match="taken back"):
                move(ahead())
        np.testing.assert_array_equal(arm.state().q, WELL)
        assert arm.state().time == 0
        arm.accept_moves_again()
        arm.move_linear(ahead(0.002))
    with arm:  # the stop on leaving is taken back by entering
        arm.move_linear(ahead(0.001))


@pytest.mark.parametrize(
    ("q", "complaint"),
    [
        (np.zeros(5), "6 joints, not 5"),
        (np.radians([0, 0, 181, 0, 0, 0]), r"elbow_joint starts at 181\.0 deg"),
        (np.array([0, 0, 0, np.nan, 0, 0]), "wrist_1_joint"),
    ],
)
def test_a_start_that_can_not_be_is_refused(q: Array, complaint: str) -> None:
    with pytest.raises(ConfigurationError, match=complaint):
        SimulatedArm(kinematics(), q)
