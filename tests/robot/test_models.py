"""The arms' URDFs: what the generator writes, with the maker's numbers."""

from __future__ import annotations

from importlib.resources import files

import arm_models
import numpy as np
import pytest

from tjscan.core.frames import pose_from_euler_zyx
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.urdf import ARM_MODELS

UR_MODELS = tuple(arm_models.ARMS)
SPEEDS_DEG = {
    "ur5e": [180] * 6,
    "ur10e": [120, 120, 180, 180, 180, 180],
    "ur16e": [120, 120, 180, 180, 180, 180],
    "ur20": [120, 120, 150, 210, 210, 210],
    "ur30": [120, 120, 150, 210, 210, 210],
}


@pytest.mark.parametrize("model", ARM_MODELS)
def test_the_committed_urdf_is_what_the_generator_writes(model: str) -> None:
    committed = (files("tjscan.robot.models") / f"{model}.urdf").read_text(encoding="utf-8")
    assert committed == arm_models.urdf_text(model)


@pytest.mark.parametrize("model", UR_MODELS)
def test_every_model_has_the_makers_limits(model: str) -> None:
    arm = Kinematics.load(model)
    turn = np.radians([360, 360, 180, 360, 360, 360])
    np.testing.assert_allclose(arm.upper, turn, rtol=1e-15)
    np.testing.assert_allclose(arm.lower, -turn, rtol=1e-15)
    np.testing.assert_allclose(arm.velocity, np.radians(SPEEDS_DEG[model]), rtol=1e-15)
    assert arm.name == model
    assert arm.joint_names == arm_models.JOINTS
    assert arm.link_names == (*arm_models.LINKS, "flange")


def test_writing_covers_every_model(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("models")
    arm_models.write_urdfs(folder)
    assert {file.stem for file in folder.iterdir()} == set(ARM_MODELS)


@pytest.mark.parametrize("model", UR_MODELS)
def test_bodies_span_their_links_and_stay_behind_the_flange(model: str) -> None:
    arm = arm_models.ARMS[model]
    *_, wrist_3 = bodies = arm_models.link_capsules(arm)
    assert bodies[0].start[2] == bodies[0].radius  # the round end touches the floor
    assert wrist_3.end[2] + wrist_3.radius == pytest.approx(arm.d6, abs=1e-12)
    assert (bodies[2].length, bodies[3].length) == (abs(arm.a2), abs(arm.a3))


LIMITS_DEG = {
    "kr5_arc": [(-155, 155), (-180, 65), (-15, 158), (-350, 350), (-130, 130), (-350, 350)],
    "irb1600_10_145": [(-180, 180), (-90, 120), (-245, 65), (-200, 200), (-115, 115), (-400, 400)],
    "m10ia": [(-180, 180), (-90, 160), (-180, 264), (-190, 190), (-190, 190), (-360, 360)],
}
WRIST_ARM_SPEEDS_DEG = {
    "kr5_arc": [154, 154, 228, 343, 384, 721],
    "irb1600_10_145": [180, 180, 185, 385, 400, 460],
    "m10ia": [210, 190, 210, 400, 400, 600],
}
WRIST_REACHES = {"kr5_arc": 1.412, "irb1600_10_145": 1.45, "m10ia": 1.420}
"""Metres from axis 1 to the wrist, as the makers state them."""

# From the dimensions by hand: joint angles in degrees, and the pose of the flange in millimetres
# and degrees about z, y, x, as KUKA's A, B, C and FANUC's R, P, W are.
POSES_BY_HAND = [
    ("kr5_arc", (0, 0, 0, 0, 0, 0), (1515, 0, 520), (0, 90, 0)),
    ("kr5_arc", (0, -90, 90, 0, 0, 0), (915, 0, 1120), (0, 90, 0)),
    ("kr5_arc", (0, -90, 90, 0, 90, 0), (800, 0, 1005), (180, 0, 180)),
    ("kr5_arc", (90, -90, 90, 0, 90, 0), (0, -800, 1005), (90, 0, 180)),
    ("irb1600_10_145", (0, 0, 0, 0, 0, 0), (815, 0, 1186.5), (0, 90, 0)),
    ("irb1600_10_145", (90, 0, 0, 0, 90, 0), (0, 750, 1121.5), (-90, 0, 180)),
    ("m10ia", (0, 0, 0, 0, 0, 0), (890, 0, 800), (0, -90, 180)),
    ("m10ia", (0, 0, 0, 0, -90, 0), (790, 0, 700), (0, 0, 180)),
]


@pytest.mark.parametrize("model", arm_models.WRIST_ARMS)
def test_an_arm_with_a_spherical_wrist_has_the_makers_limits_and_reach(model: str) -> None:
    arm = Kinematics.load(model)
    limits = np.radians(LIMITS_DEG[model])
    np.testing.assert_allclose(np.column_stack((arm.lower, arm.upper)), limits, rtol=1e-15)
    np.testing.assert_allclose(arm.velocity, np.radians(WRIST_ARM_SPEEDS_DEG[model]), rtol=1e-15)
    _, shoulder, upper, *fore = arm.joint_placements[:5, :3, 3]
    stretched = shoulder[0] + np.linalg.norm(upper) + np.linalg.norm(np.sum(fore, axis=0))
    assert stretched == pytest.approx(WRIST_REACHES[model], abs=1e-3)


@pytest.mark.parametrize(("model", "joints_deg", "position_mm", "zyx_deg"), POSES_BY_HAND)
def test_the_flange_is_where_the_dimensions_put_it(
    model: str,
    joints_deg: tuple[float, ...],
    position_mm: tuple[float, ...],
    zyx_deg: tuple[float, ...],
) -> None:
    T_b_f = pose_from_euler_zyx(np.array(position_mm) / 1e3, np.radians(zyx_deg))
    forward = Kinematics.load(model).forward(np.radians(joints_deg))
    np.testing.assert_allclose(forward, T_b_f, rtol=0, atol=1e-12)
