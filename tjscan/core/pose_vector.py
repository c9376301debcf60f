"""Rotations and poses as vectors: conversions and small steps.

A pose counts as a position and a rotation side by side, the composite group R³ × SO(3) of
[1]_, section IV: its vector is ``(x, y, z, rx, ry, rz)``, metres and a rotation vector in radians,
as robot controllers show poses. Position and rotation do not mix as they do in the exponential of
SE(3).

References
----------
.. [1] Solà, Deray, Atchuthan (2018): A micro Lie theory for state estimation in robotics.
   https://arxiv.org/abs/1812.01537
"""

from __future__ import annotations

import numpy as np
import scipy  # its parts are loaded at first use
from numpy.typing import ArrayLike
from pytransform3d.rotations import left_jacobian_SO3

from tjscan.core.frames import Array, pose, skew_matrix


def rotation_from_vector(rotation_vector: ArrayLike) -> Array:
    """Rotation matrices of rotation vectors.

    Parameters
    ----------
    rotation_vector : array_like, shape (..., 3)
        Axis times angle, radians.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    v = np.asarray(rotation_vector, dtype=float)
    return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(v).as_matrix())


def rotation_to_vector(R: ArrayLike) -> Array:
    """Rotation vectors, shape (..., 3), no longer than pi, of rotations, shape (..., 3, 3)."""
    R = np.asarray(R, dtype=float)
    return np.asarray(scipy.spatial.transform.Rotation.from_matrix(R).as_rotvec())


def left_jacobian(rotation_vector: Array) -> Array:
    """Derivative of a rotation by its rotation vector, shape (3, 3).

    With R(w) for `rotation_from_vector`, ``R(w + dw) = R(left_jacobian(w) @ dw) @ R(w)`` for small
    dw ([1]_ eq. 145).

    Parameters
    ----------
    rotation_vector : ndarray, shape (3,)
        Radians.
    """
    return np.asarray(left_jacobian_SO3(rotation_vector))


def pose_from_vector(vector: ArrayLike) -> Array:
    """Pose, shape (4, 4), of a position and a rotation vector.

    Parameters
    ----------
    vector : array_like, shape (6,)
        Metres, then radians.
    """
    v = np.asarray(vector, dtype=float)
    return pose(rotation_from_vector(v[3:]), v[:3])


def pose_to_vector(T: Array) -> Array:
    """Position (metres) and rotation vector (radians) of a pose, shape (6,)."""
    return np.concatenate((T[:3, 3], rotation_to_vector(T[:3, :3])))


def boxplus(T: Array, step: Array) -> Array:
    """Pose that is a step away from another, along and about the axes of the outer frame.

    Parameters
    ----------
    T : ndarray, shape (4, 4)
        Where the step begins.
    step : ndarray, shape (6,)
        Translation in metres, then the rotation vector of a turn about the inner frame's origin
        in radians; both in the outer frame's axes.
    """
    return pose(rotation_from_vector(step[3:]) @ T[:3, :3], T[:3, 3] + step[:3])


def boxminus(T: Array, T_start: Array) -> Array:
    """Step from one pose to another, shape (6,): ``boxplus(T_start, step) = T``.

    Parameters
    ----------
    T, T_start : ndarray, shape (4, 4)
        Poses in the same outer frame.
    """
    return np.concatenate(
        (T[:3, 3] - T_start[:3, 3], rotation_to_vector(T[:3, :3] @ T_start[:3, :3].T))
    )


def adjoint(T: Array) -> Array:
    """Maps a small motion about the inner frame's origin to that about the outer one's.

    Parameters
    ----------
    T : ndarray, shape (4, 4)
        Pose of the inner frame in the outer one.

    Returns
    -------
    ndarray, shape (6, 6)
        For translations before rotations ([1]_ eq. 175).
    """
    R = T[:3, :3]
    return np.block([[R, skew_matrix(T[:3, 3]) @ R], [np.zeros((3, 3)), R]])
