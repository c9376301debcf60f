"""A FANUC arm, moved by joint angles over Stream Motion."""

from __future__ import annotations

import numpy as np

from tjscan.core import errors
from tjscan.core.frames import Array
from tjscan.robot.cyclic.arm import WRONG_ARM_MODEL_DISTANCE, CyclicArm


class FanucArm(CyclicArm):
    """A FANUC arm, or the loopback controller in its place; see `CyclicArm`.

    A controller counts J3 from the upper arm, as the model does, or from the horizontal; its pose
    shows which.
    """

    _j3_from_horizontal = False

    def _check_arm_model(self) -> None:
        state, fitting = self._read_state(), []
        for self._j3_from_horizontal in (True, False):
            apart = self._flange_distance(self._model_angles(state.q), state)
            if apart <= WRONG_ARM_MODEL_DISTANCE:
                fitting.append(self._j3_from_horizontal)
        if len(fitting) == 2:
            raise errors.ConfigurationError(
                "with J2 near 0 the arm does not show whether its controller counts J3 from the "
                "horizontal or from the upper arm: jog J2 by 5 deg, then start again",
                key="arm.model",
            )
        self._j3_from_horizontal = True in fitting
        super()._check_arm_model()

    def _model_angles(self, q: Array) -> Array:
        return q + self._j3_from_horizontal * _j2_at_j3(q)

    def _controller_angles(self, q: Array) -> Array:
        return q - self._j3_from_horizontal * _j2_at_j3(q)


def _j2_at_j3(q: Array) -> Array:
    angles = np.zeros_like(q)
    angles[..., 2] = q[..., 1]
    return angles
