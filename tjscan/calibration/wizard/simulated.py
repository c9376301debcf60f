"""A simulated probe that touches the board."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from tjscan.calibration.closed_form import PluckerPlane
from tjscan.calibration.wizard.session import poses_square_to_board
from tjscan.core.errors import PoseUnreachable
from tjscan.core.frames import Array, pose, transform_points
from tjscan.robot.arm import Arm, ArmState


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedTouchProbe:
    """A `TouchProbe` on a simulated arm: it stops near the point at which the tip meets the board.

    Parameters
    ----------
    arm : Arm
        The arm that carries the tip.
    tip_f : ndarray, shape (3,)
        The tip in frame f, in metres.
    T_b_board : ndarray, shape (4, 4)
        Approximate pose of the board: the tip comes down square to it.
    plane : PluckerPlane
        The true board, frame b.
    sigma : float
        Standard deviation of the tip about it, in metres, in each axis.
    approach : float
        Metres above the board from which the tip comes down.
    rng : numpy.random.Generator
        Source of the errors.
    true_flange : callable
        Gives the true flange pose, shape (4, 4), from which the tip touches.
    """

    touch_question: ClassVar[str] = "Move the probe tip down onto the board"

    arm: Arm
    tip_f: Array
    T_b_board: Array
    plane: PluckerPlane
    sigma: float
    approach: float
    rng: np.random.Generator
    true_flange: Callable[[], Array]

    def touch(self, place_b: Array) -> ArmState:
        """Come from above, touch the board, and go back up; raises as `TouchProbe.touch` does."""
        up = self.T_b_board[:3, 2]
        below = float(self.plane.signed_distances(place_b)) / float(self.plane.u @ up)
        contact_b = place_b - below * up + self.sigma * self.rng.standard_normal(3)
        for T_b_f in poses_square_to_board(
            self.T_b_board, self.tip_f, contact_b, self.arm.state().T_b_f
        ):
            above = pose(T_b_f[:3, :3], T_b_f[:3, 3] + self.approach * up)
            try:
                self.arm.move_joint_to_pose(above)
                touched = self.arm.move_linear(T_b_f)
            except PoseUnreachable as error:
                unreachable = error
                continue
            # The tip triggers when it truly meets the board; the arm is read then.
            tip_b = transform_points(self.true_flange(), self.tip_f)
            left = float((tip_b - contact_b) @ self.plane.u) / float(self.plane.u @ up)
            self.arm.move_linear(above)
            return replace(touched, T_b_f=pose(p=-left * up) @ touched.T_b_f)
        raise unreachable
