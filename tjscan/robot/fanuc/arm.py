"""A FANUC arm, moved by joint angles over Stream Motion."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core import errors
from tjscan.core.frames import Array
from tjscan.robot.cyclic.arm import WRONG_ARM_MODEL_DISTANCE, CyclicArm

UNCLEAR_J3_DISTANCE: Final = 4 * WRONG_ARM_MODEL_DISTANCE
"""Metres between the flanges of both counts of J3, below which the pose does not show which."""

J2_AT_J3: Final = np.outer(np.eye(6)[1], np.eye(6)[2])
"""Joint angles times this have J2 in the place of J3, and else 0."""


class FanucArm(CyclicArm):
    """A FANUC arm, or the loopback controller in its place; see `CyclicArm`.

    A controller counts J3 from the upper arm, as the model does, or from the horizontal; its pose
    shows which.
    """

    _j3_from_horizontal = False

    def _check_arm_model(self) -> None:
        state = self._read_state()
        counts = (state.q, state.q + state.q @ J2_AT_J3)
        flanges_b = np.array([self.kinematics.forward(q)[:3, 3] for q in counts])
        if np.linalg.norm(flanges_b[0] - flanges_b[1]) < UNCLEAR_J3_DISTANCE:
            raise errors.ConfigurationError(
                "with J2 near 0 the arm does not show whether its controller counts J3 from the "
                "horizontal or from the upper arm: jog J2 by 5 deg, then start again",
                key="arm.model",
            )
        apart = np.linalg.norm(flanges_b - state.tool_b, axis=1)
        self._j3_from_horizontal = bool(apart[1] < apart[0])
        self._check_flange()

    def _model_angles(self, q: Array) -> Array:
        return np.asarray(q + self._j3_from_horizontal * q @ J2_AT_J3)

    def _controller_angles(self, q: Array) -> Array:
        return np.asarray(q - self._j3_from_horizontal * q @ J2_AT_J3)
