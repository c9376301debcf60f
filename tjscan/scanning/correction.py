"""The correction substep: look at the section from the right side and distance, eq. (12)-(13)."""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array, cross, pose, unit_vector


def correction_target_pose(T_b_g_last: Array, T_b_g_predicted: Array) -> Array:
    """Set-point of frame t for the correction substep.

    Parameters
    ----------
    T_b_g_last : ndarray, shape (4, 4)
        Frame g of the last finished section, i-1.
    T_b_g_predicted : ndarray, shape (4, 4)
        Frame g as read after the prediction substep, i1.

    Returns
    -------
    ndarray, shape (4, 4)
        T_b_t of substep i2: its origin in the groove, x along the motion, y up the brace.

    Notes
    -----
    Cibicik et al. 2022, eq. (12)-(13). It holds for both directions: x follows the motion,
    so z points out of the joint counterclockwise and into it clockwise.
    """
    x_b = unit_vector(T_b_g_predicted[:3, 3] - T_b_g_last[:3, 3])
    y_b = unit_vector(cross(cross(x_b, T_b_g_predicted[:3, 1]), x_b))
    z_b = cross(x_b, y_b)
    return pose(np.column_stack((x_b, y_b, z_b)), T_b_g_predicted[:3, 3])
