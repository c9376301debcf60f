"""The prediction substep: where the next section lies, from the last two, eq. (6)-(11)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from tjscan.core.frames import Array, pose, unit_vector
from tjscan.scanning.section import ScannedSection, SetPoint, SetPointPredictor
from tjscan.scanning.target import R_REVERSED, ScanDirection


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
        R_t = R_REVERSED.T @ R_t @ R_REVERSED  # (27)
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

    def predictor(sections: Sequence[ScannedSection], step: float) -> SetPoint:
        before, last = sections[-2:]
        T_b_t = predicted_target_pose(
            last.T_b_t, before.T_b_g, last.T_b_g, step, prediction, direction
        )
        return SetPoint(T_b_t, last.T_s_t)

    return predictor
