"""The arms' URDFs: what the generator writes, with the maker's numbers."""

from __future__ import annotations

from importlib.resources import files

import arm_models
import numpy as np
import pytest

from tjscan.robot.kinematics import Kinematics
from tjscan.robot.urdf import ARM_MODELS

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


@pytest.mark.parametrize("model", ARM_MODELS)
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


@pytest.mark.parametrize("model", ARM_MODELS)
def test_bodies_span_their_links_and_stay_behind_the_flange(model: str) -> None:
    arm = arm_models.ARMS[model]
    *_, wrist_3 = bodies = arm_models.link_capsules(arm)
    assert bodies[0].start[2] == bodies[0].radius  # the round end touches the floor
    assert wrist_3.end[2] + wrist_3.radius == pytest.approx(arm.d6, abs=1e-12)
    assert (bodies[2].length, bodies[3].length) == (abs(arm.a2), abs(arm.a3))
