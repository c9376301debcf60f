"""Other ways to read a list of poses: the mistakes that are made when arms' files are converted."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array, inverse_pose


def other_readings(T_b_f: Array) -> dict[str, Array]:
    """Poses that the same numbers mean under other conventions, by what they are called.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses as they were read.
    """
    R = Rotation.from_matrix(T_b_f[:, :3, :3])
    zyx = R.as_euler("ZYX")
    quaternion = R.as_quat()
    turned = {
        "with the angles in the opposite order": Rotation.from_euler("ZYX", zyx[:, ::-1]),
        "with angles about fixed in place of moving axes": Rotation.from_euler("zyx", zyx),
        "with angles about moving x, y, z axes": Rotation.from_euler("XYZ", zyx),
        "with a rotation vector in place of angles about z, y, x": Rotation.from_rotvec(
            zyx[:, ::-1]
        ),
        "with angles about z, y, x in place of a rotation vector": Rotation.from_euler(
            "ZYX", R.as_rotvec()[:, ::-1]
        ),
        "with the quaternion's scalar first in place of last": Rotation.from_quat(
            np.roll(quaternion, -1, axis=1)
        ),
        "with the quaternion's scalar last in place of first": Rotation.from_quat(
            np.roll(quaternion, 1, axis=1)
        ),
        "with every rotation inverted": R.inv(),
    }
    readings = {"inverted: of the base in the flange's frame": _inverted(T_b_f)}
    for name, rotation in turned.items():
        T = T_b_f.copy()
        T[:, :3, :3] = rotation.as_matrix()
        readings[name] = T
    return readings


def _inverted(T_b_f: Array) -> Array:
    return np.stack([inverse_pose(T) for T in T_b_f])
