"""Denavit-Hartenberg parameters of an arm, as Universal Robots' controllers state them."""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array, array_dataclass, pose, rot_x, rot_z
from tjscan.robot.kinematics import Kinematics


@array_dataclass
class DhParameters:
    """Standard DH parameters: frame i is Rz(theta + q) Tz(d) Tx(a) Rx(alpha) in frame i - 1.

    Parameters
    ----------
    theta, a, d, alpha : ndarray, shape (6,)
        Radians and metres.
    """

    theta: Array
    a: Array
    d: Array
    alpha: Array

    def forward(self, q: Array) -> Array:
        """Pose of frame 6 in frame 0, shape (4, 4), for joint angles, shape (6,), in radians."""
        T = np.eye(4)
        for angle, a, d, alpha in zip(self.theta + q, self.a, self.d, self.alpha, strict=True):
            T = T @ pose(rot_z(angle), (0.0, 0.0, d)) @ pose(rot_x(alpha), (a, 0.0, 0.0))
        return T


COMPARED_POSTURES = 200
"""Joint angles at which two descriptions are compared, always the same ones."""


def compare_flange_with_model(dh: DhParameters, kinematics: Kinematics) -> tuple[float, float]:
    """Distances, RMS and largest, of the flange by DH parameters from where a model has it.

    Parameters
    ----------
    dh : DhParameters
        As a controller states them.
    kinematics : Kinematics
        An arm with six joints.
    """
    rng = np.random.default_rng(0)
    q = rng.uniform(-np.pi, np.pi, (COMPARED_POSTURES, 6))
    off = [dh.forward(one)[:3, 3] - kinematics.forward(one)[:3, 3] for one in q]
    apart = np.linalg.norm(off, axis=1)
    return float(np.sqrt(np.mean(apart**2))), float(apart.max())
