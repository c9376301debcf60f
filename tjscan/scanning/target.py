"""Frame t, the paper's s': fixed in the sensor, laid on the groove to be scanned, eq. (12)-(15)."""

from __future__ import annotations

from enum import StrEnum
from math import pi

import numpy as np
from numpy.typing import ArrayLike

from tjscan.core.frames import Array, cross, pose, rot_x, rot_y, rot_z, unit_vector


class ScanDirection(StrEnum):
    """Which way round the brace the scan goes, seen from above."""

    COUNTERCLOCKWISE = "counterclockwise"
    CLOCKWISE = "clockwise"


R_S_T = rot_z(pi / 2) @ rot_x(pi)
"""The large constant rotation of eq. (14): x_t along y_s, y_t along x_s, z_t back to the sensor."""

R_REVERSED = rot_y(pi)
"""What turns frame g (or t) round for the clockwise scan, eq. (27): x back, z into the joint."""


def target_pose_in_sensor(
    work_angle: float, pull_angle: float, p_s_t: ArrayLike, direction: ScanDirection
) -> Array:
    """Pose T_s_t of the target frame in the sensor frame.

    Parameters
    ----------
    work_angle : float
        β: how far the sensor is raised above z_g, so that it looks from the middle of the
        groove's opening, radians.
    pull_angle : float
        α: how far the laser plane is turned from the groove's normal plane, the sensor
        leading and looking back, radians.
    p_s_t : array_like, shape (3,)
        Where the groove's origin shall appear in the laser plane, metres: (0, 0, stand-off) for
        the middle of the line.
    direction : ScanDirection
        Which way round.

    Returns
    -------
    ndarray, shape (4, 4)
        T_s_t, eq. (14).

    Notes
    -----
    Cibicik et al. 2022, eq. (14), (15) and (28). For the clockwise scan the constant rotation
    gains the half turn of eq. (27), which the paper leaves unsaid: x_t follows the motion,
    so z_t has to point into the joint.
    """
    if direction is ScanDirection.COUNTERCLOCKWISE:
        R = R_S_T @ rot_y(-pull_angle) @ rot_x(work_angle)  # (14), (15)
    else:
        R = R_S_T @ R_REVERSED @ rot_y(pull_angle) @ rot_x(-work_angle)  # (14), (28)
    return pose(R, p_s_t)


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
