"""Deviations of an arm's joints from their places in its model: offset, length and twist.

The frame of each joint is off by a small motion in its own axes: a translation (a length), a tilt
of its axis (a twist) and a turn about it (an offset). Six numbers a joint are more than the flange
can show, and stay regular where axes are parallel, as the axes of joints 2, 3 and 4 of a Universal
Robots arm are (Hayati and Mirmirani 1985, Improving the absolute positioning accuracy of robot
manipulators, J. Robotic Systems 2(4), on why DH parameters do not).
"""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array
from tjscan.core.pose_vector import pose_from_vector
from tjscan.robot.kinematics import Kinematics


def axis_bases(kinematics: Kinematics) -> Array:
    """Rotations that take a frame whose z is the joint's axis into the joint's, shape (n, 3, 3)."""
    bases = []
    for axis in kinematics.joint_axes:
        x, y = np.linalg.svd(axis[None])[2][1:]
        upright = np.eye(3) if np.allclose(axis, (0, 0, 1)) else np.column_stack((x, y, axis))
        bases.append(upright * (1, np.sign(np.linalg.det(upright)), 1))
    return np.array(bases)


def with_deviations(kinematics: Kinematics, deviations: Array) -> Kinematics:
    """Return the arm with its joints' frames moved by small motions.

    Parameters
    ----------
    kinematics : Kinematics
        The arm.
    deviations : ndarray, shape (n, 6)
        Translation (metres) and rotation vector of each joint's frame, in axes of its own whose
        z is the joint's axis; see `axis_bases`.
    """
    own = np.asarray(deviations, dtype=float).reshape(-1, 2, 3)
    in_joint = np.einsum("nij,nkj->nki", axis_bases(kinematics), own).reshape(-1, 6)
    moves = np.array([pose_from_vector(step) for step in in_joint])
    return kinematics.with_joint_placements(kinematics.joint_placements @ moves)


def deviation_jacobian(kinematics: Kinematics, q: Array) -> Array:
    """Motion of the flange for small deviations, shape (6, n, 6), in the axes of f.

    Translation (metres) and rotation (radians), by the deviations of `with_deviations`.
    """
    J = kinematics.placement_jacobian(q).reshape(6, -1, 2, 3)
    turned = np.einsum("knci,nij->kncj", J, axis_bases(kinematics))
    return np.asarray(turned.reshape(6, -1, 6))


def length_growth(kinematics: Kinematics) -> Array:
    """Deviations of an arm whose links are longer by their own length, shape (n, 6).

    What the last joint carries stays as it is.
    """
    placements = kinematics.joint_placements
    own = np.einsum("nji,nj->ni", placements[:, :3, :3], placements[:, :3, 3])
    along = np.einsum("nji,nj->ni", axis_bases(kinematics), own)
    return np.hstack((along, np.zeros_like(along)))
