"""An arm that is corrected stands where it is told to."""

from __future__ import annotations

from functools import cache

import numpy as np

from tjscan.core.frames import Array, pose, rotation_angle_between
from tjscan.robot.arm import Arm
from tjscan.robot.deviations import CorrectedArm, deviate_joint_frames
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance
from tjscan.robot.simulated import SimulatedArm, SimulatedArmErrors

WELL = np.radians([10, -80, 100, -60, -80, 20])
SOLVED = 1e-7
"""Metres and radians that two inverse solutions on top of each other may be off."""


@cache
def kinematics() -> Kinematics:
    return Kinematics.load("ur10e")


@cache
def true_kinematics() -> Kinematics:
    rng = np.random.default_rng(3)
    return deviate_joint_frames(
        kinematics(), PlacementTolerance().sigmas * rng.standard_normal((6, 6))
    )


def true_arm() -> SimulatedArm:
    still = np.zeros(6)
    errors = SimulatedArmErrors(true_kinematics(), np.zeros((6, 6)), still, still, 0.0, 1.0)
    return SimulatedArm(kinematics(), WELL, repeatability=(0, 0), errors=errors)


def ahead(x: float) -> Array:
    T_b_f = kinematics().forward(WELL)
    return pose(T_b_f[:3, :3], T_b_f[:3, 3] + [0, x, 0])


def test_with_the_true_deviations_it_stands_where_it_is_told_and_says_so() -> None:
    true = true_arm()
    arm: Arm = CorrectedArm(true, kinematics(), true_kinematics())
    with arm:
        for move in (arm.move_linear, arm.move_joint_to_pose):
            for T_b_f in (ahead(0.05), ahead(0.0)):
                arm.check_moves(T_b_f)
                state = move(T_b_f)
                for found in (true.true_T_b_f, state.T_b_f, arm.state().T_b_f):
                    np.testing.assert_allclose(found[:3, 3], T_b_f[:3, 3], rtol=0, atol=SOLVED)
                    assert rotation_angle_between(found, T_b_f) < SOLVED
                np.testing.assert_array_equal(state.q, true.state().q)


def test_a_controller_that_knows_its_own_calibration_is_corrected_alike() -> None:
    # The deviations were found on top of what this controller reads.
    own = deviate_joint_frames(kinematics(), np.full((6, 6), 2e-4))
    inner = SimulatedArm(own, WELL, repeatability=(0, 0))
    arm = CorrectedArm(inner, kinematics(), true_kinematics())
    with arm:
        assert np.linalg.norm(arm.move_linear(ahead(0.03)).T_b_f[:3, 3] - ahead(0.03)[:3, 3]) < 1e-6
