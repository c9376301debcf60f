"""The frame in which results are given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tjscan.core.frames import Array, inverse_pose


@dataclass(frozen=True, slots=True, eq=False)
class JointOrBaseFrame:
    """Frame of the results: the joint's where the job says where the joint is, else the base frame.

    Parameters
    ----------
    T_b_j : ndarray, shape (4, 4), optional
        Pose of the joint in the base frame.
    """

    T_b_j: Array | None = None

    @property
    def letter(self) -> str:
        """Letter of the frame: j for the joint's, b for the base's."""
        return "b" if self.T_b_j is None else "j"

    @property
    def T_r_b(self) -> Array:
        """Pose of the base frame in it, shape (4, 4)."""
        return np.eye(4) if self.T_b_j is None else inverse_pose(self.T_b_j)
