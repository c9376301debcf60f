"""Frame t, the paper's s': fixed in the sensor, laid on the groove to be scanned."""

from __future__ import annotations

from enum import StrEnum
from math import pi

from numpy.typing import ArrayLike

from tjscan.core.frames import Array, pose, rot_x, rot_y, rot_z


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
