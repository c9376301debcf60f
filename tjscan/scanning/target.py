"""Frame t, the paper's s': fixed in the sensor, laid on the groove to be scanned, eq. (12)-(15).

The prediction substep lays it on the next section, from the last two, eq. (6)-(11).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import pi
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tjscan.core.frames import Array, cross, pose, rot_x, rot_y, rot_z, unit_vector
from tjscan.scanning.section import Sections, SetPoint, SetPointPredictor


class ScanDirection(StrEnum):
    """Which way round the brace the scan goes, seen from above."""

    COUNTERCLOCKWISE = "counterclockwise"
    CLOCKWISE = "clockwise"


R_S_T = rot_z(pi / 2) @ rot_x(pi)
"""The large constant rotation of eq. (14): x_t along y_s, y_t along x_s, z_t back to the sensor."""

REVERSED_FRAME_ROTATION = rot_y(pi)
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
        R = R_S_T @ REVERSED_FRAME_ROTATION @ rot_y(pull_angle) @ rot_x(-work_angle)  # (14), (28)
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
    along = T_b_g_predicted[:3, 3] - T_b_g_last[:3, 3]
    return target_pose_along(along, T_b_g_predicted[:3, 1], T_b_g_predicted[:3, 3])


def target_pose_along(along_b: Array, up_b: Array, origin_b: Array) -> Array:
    """Frame t with its x axis along a direction, its y axis as near to another as can be.

    Parameters
    ----------
    along_b, up_b : ndarray, shape (3,)
        Of the motion, and up the brace.
    origin_b : ndarray, shape (3,)
        Where it lies, metres.
    """
    x_b = unit_vector(along_b)
    y_b = unit_vector(cross(cross(x_b, up_b), x_b))
    return pose(np.column_stack((x_b, y_b, cross(x_b, y_b))), origin_b)


@dataclass(frozen=True, slots=True)
class PredictionCase:
    """One of the paper's cases: how the motion between the last two sections is extrapolated.

    Parameters
    ----------
    turns_frame : bool
        Turn frame t as the last two sections turned, eq. (9); else keep its orientation.
    turns_step : bool
        Turn the step as the last two sections turned, eq. (10); else step straight on.
    """

    turns_frame: bool
    turns_step: bool


PREDICTION_CASES = {
    1: PredictionCase(turns_frame=False, turns_step=False),
    2: PredictionCase(turns_frame=True, turns_step=True),
    3: PredictionCase(turns_frame=False, turns_step=True),
    4: PredictionCase(turns_frame=True, turns_step=False),
}
"""The four cases of the paper, section 4.2."""

SMOOTH_PREDICTION: Final = "smooth"
"""The fifth: see `tjscan.scanning.smooth`."""


def predicted_target_pose(
    T_b_t: Array,
    T_b_g_before: Array,
    T_b_g_last: Array,
    step: float,
    prediction: PredictionCase,
    direction: ScanDirection,
) -> Array:
    """Set-point of frame t for the prediction substep.

    Parameters
    ----------
    T_b_t : ndarray, shape (4, 4)
        Frame t as it is after the last correction.
    T_b_g_before, T_b_g_last : ndarray, shape (4, 4)
        Frames g of the sections i-2 and i-1.
    step : float
        d_st, metres.
    prediction : PredictionCase
        What is carried on.
    direction : ScanDirection
        Which way round.

    Returns
    -------
    ndarray, shape (4, 4)
        T_b_t of substep i1.

    Notes
    -----
    Cibicik et al. 2022, eq. (7)-(11), and (27) for the clockwise scan.
    """
    R_before, R_last = T_b_g_before[:3, :3], T_b_g_last[:3, :3]
    v_b = step * unit_vector(T_b_g_last[:3, 3] - T_b_g_before[:3, 3])  # (11)
    p_b = R_last @ R_before.T @ v_b if prediction.turns_step else v_b  # (10)
    T_I = pose(p=p_b)  # (8)
    if not prediction.turns_frame:
        return T_I @ T_b_t
    R_t = R_before.T @ R_last  # (9)
    if direction is ScanDirection.CLOCKWISE:
        R_t = REVERSED_FRAME_ROTATION.T @ R_t @ REVERSED_FRAME_ROTATION  # (27)
    return T_I @ T_b_t @ pose(R_t)  # (7)


def paper_predictor(prediction: PredictionCase, direction: ScanDirection) -> SetPointPredictor:
    """Predictor of set-points by a case of the paper.

    Parameters
    ----------
    prediction : PredictionCase
        The case.
    direction : ScanDirection
        Which way round.
    """

    def predictor(sections: Sections, step: float) -> SetPoint:
        before, last = sections[-2:]
        frames = last.T_b_t, before.T_b_g, last.T_b_g
        T_b_t = predicted_target_pose(*frames, step, prediction, direction)
        return SetPoint(T_b_t, last.T_s_t)

    return predictor
