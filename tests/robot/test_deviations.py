"""Arms whose joints are not quite where their model places them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tjscan.core.frames import Array, inverse_pose, pose, rotation_angle_between
from tjscan.core.pose_vector import boxminus
from tjscan.robot.deviations import (
    deviate_joint_frames,
    deviation_jacobian,
    deviations_of_longer_links,
)
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import ArmErrorSettings, PlacementTolerance
from tjscan.robot.simulated import SimulatedArm, SimulatedArmErrors
from tjscan.robot.urdf import ARM_MODELS

WELL = np.radians([10, -80, 100, -60, -80, 20])
STEP = 1e-6
"""Small against what the second order of a deviation does: 1e-12."""


@cache
def kinematics(model: str = "ur10e") -> Kinematics:
    return Kinematics.load(model)


def posture(seed: int) -> Array:
    return np.random.default_rng(seed).uniform(-3, 3, 6)


@pytest.mark.parametrize("model", ARM_MODELS)
def test_the_jacobian_is_the_derivative_of_the_forward_kinematics(model: str) -> None:
    arm, q = kinematics(model), posture(1)
    J = deviation_jacobian(arm, q)
    for joint in range(6):
        for k in range(6):
            deviations = np.zeros((6, 6))
            deviations[joint, k] = STEP
            moved = inverse_pose(arm.forward(q)) @ deviate_joint_frames(arm, deviations).forward(q)
            np.testing.assert_allclose(
                boxminus(moved, np.eye(4)) / STEP, J[:, joint, k], rtol=0, atol=1e-5
            )


def test_an_offset_is_a_turn_of_the_joint() -> None:
    q, offsets = posture(2), 1e-3 * np.arange(1, 7)
    deviations = np.zeros((6, 6))
    deviations[:, 5] = offsets
    np.testing.assert_allclose(
        deviate_joint_frames(kinematics(), deviations).forward(q),
        kinematics().forward(q + offsets),
        rtol=0,
        atol=1e-14,
    )


def last_joint(T_b_f: Array) -> Array:
    """Origin of the last joint: the flange stands d6 before it, on the joint itself."""
    return np.asarray(T_b_f[:3, 3] - 0.11655 * T_b_f[:3, 2])


def test_growth_lengthens_every_link_alike() -> None:
    arm, q = kinematics(), posture(3)
    grown = deviate_joint_frames(arm, 0.01 * deviations_of_longer_links(arm)).forward(q)
    cold = arm.forward(q)
    np.testing.assert_allclose(last_joint(grown), 1.01 * last_joint(cold), rtol=0, atol=1e-14)
    assert rotation_angle_between(grown, cold) < 1e-7


def test_a_deviating_arm_is_solved_as_the_model_is() -> None:
    rng = np.random.default_rng(4)
    arm = deviate_joint_frames(
        kinematics(), PlacementTolerance().sigmas * rng.standard_normal((6, 6))
    )
    T_b_f = arm.forward(WELL)
    np.testing.assert_allclose(arm.inverse(T_b_f, near=WELL), WELL, rtol=0, atol=1e-9)
    assert len(arm.all_inverse_solutions(T_b_f, WELL)) == 8
    # The model itself is as it was.
    assert np.linalg.norm(kinematics().forward(WELL)[:3, 3] - T_b_f[:3, 3]) > 1e-5


def absolute_errors(seed: int, postures: Array) -> Array:
    errors = SimulatedArmErrors.draw_true_arm(kinematics(), ArmErrorSettings(), seed)
    still = np.zeros(6)
    off = [
        errors.flange_pose(q, still, 0.0)[:3, 3] - kinematics().forward(q)[:3, 3] for q in postures
    ]
    return np.asarray(np.linalg.norm(off, axis=1))


def test_a_drawn_arm_is_off_by_what_a_calibrated_one_is() -> None:
    postures = np.array([posture(seed) for seed in range(60)])
    rms = [np.sqrt(np.mean(absolute_errors(seed, postures) ** 2)) for seed in range(30)]
    assert 3e-4 < np.sqrt(np.mean(np.square(rms))) < 5e-4
    np.testing.assert_array_equal(absolute_errors(7, postures), absolute_errors(7, postures))


def test_the_arm_reports_what_its_controller_knows_and_stands_elsewhere() -> None:
    errors = SimulatedArmErrors.draw_true_arm(kinematics(), ArmErrorSettings(), 1)
    arm = SimulatedArm(kinematics(), WELL, repeatability=(0, 0), errors=errors)
    with arm:
        state = arm.state()
        np.testing.assert_array_equal(state.T_b_f, kinematics().forward(WELL))
        off = np.linalg.norm(arm.true_T_b_f[:3, 3] - state.T_b_f[:3, 3])
        assert 2e-5 < off < 2e-3


def test_backlash_shows_between_two_ways_to_one_place() -> None:
    settings = ArmErrorSettings(offset=0, length=0, twist=0, backlash=1e-3)
    errors = SimulatedArmErrors.draw_true_arm(kinematics(), settings, 1)
    arm = SimulatedArm(kinematics(), WELL, repeatability=(0, 0), errors=errors)
    place = kinematics().forward(WELL)
    seen = []
    with arm:
        for side in (0.05, -0.05):
            arm.move_joint_to_pose(pose(place[:3, :3], place[:3, 3] + [side, side, side]))
            arm.move_joint_to_pose(place)
            seen.append(arm.true_T_b_f)
    assert 1e-4 < np.linalg.norm(seen[0][:3, 3] - seen[1][:3, 3]) < 3e-3


def test_eccentricity_comes_back_after_a_turn_and_warmth_with_time() -> None:
    still = np.zeros(6)
    gears = ArmErrorSettings(offset=0, length=0, twist=0, eccentricity=1e-3)
    errors = SimulatedArmErrors.draw_true_arm(kinematics(), gears, 1)
    q, turn = posture(5), np.array([0, 0, 0, 2 * np.pi, 0, 0])
    there, again = errors.flange_pose(q, still, 0.0), errors.flange_pose(q + turn, still, 0.0)
    np.testing.assert_allclose(there, again, rtol=0, atol=1e-12)
    assert np.linalg.norm(there[:3, 3] - kinematics().forward(q)[:3, 3]) > 1e-5

    warm = ArmErrorSettings(offset=0, length=0, twist=0, growth=1e-3, warm_up=100)
    errors = SimulatedArmErrors.draw_true_arm(kinematics(), warm, 1)
    cold, hot = (last_joint(errors.flange_pose(q, still, time)) for time in (0.0, 1e4))
    np.testing.assert_allclose(cold, last_joint(kinematics().forward(q)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(hot, 1.001 * cold, rtol=0, atol=1e-12)
