"""A sensor that is fixed in the room while the arm carries the target: poses are inverted.

Seen from the flange the sensor moves, on the base as if that were its flange. T_b_f of a target's
model is then the base in the flange's frame, T_f_s is the sensor in the base's, and the target's
parameters count in the flange's.
"""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array, inverse_pose, skew_matrix


def inverse_poses(T: Array) -> Array:
    """Inverse of each pose, shape (n, 4, 4)."""
    return np.stack([inverse_pose(one) for one in T])


def inverse_pose_errors(T_b_f: Array) -> Array:
    """Effect of a small error of each pose on its inverse.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.

    Returns
    -------
    ndarray, shape (n, 6, 6)
        From translation and rotation about the flange's origin in the axes of b, to translation
        and rotation of T_f_b about the base's origin in the axes of f.
    """
    R_f_b = T_b_f[:, :3, :3].transpose(0, 2, 1)
    errors = np.zeros((len(T_b_f), 6, 6))
    errors[:, :3, :3] = errors[:, 3:, 3:] = -R_f_b
    errors[:, :3, 3:] = -R_f_b @ skew_matrix(T_b_f[:, :3, 3])
    return errors
