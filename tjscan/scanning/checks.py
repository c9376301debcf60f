"""What every set-point has to pass before the arm moves."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.errors import SetPointRefused
from tjscan.core.frames import Array, inverse_pose, rotation_angle_between
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import SetPoint, StepRequest

FARTHEST_STEPS: Final = 2.0
"""Steps that a set-point lies from the last section, at most."""

LARGEST_VIEW_SHIFT: Final = 0.02
"""Metres that the groove may be meant to appear from where the plan wants it in the sensor."""

ORTHONORMAL_TOLERANCE: Final = 1e-6
"""How far from orthonormal a rotation may be that was computed."""


def check_set_point(to: SetPoint, step: StepRequest, plan: ScanPlan) -> None:
    """Refuse a set-point that is further from the last section than its step allows.

    Parameters
    ----------
    to : SetPoint
        Of either substep.
    step : StepRequest
        The step under way.
    plan : ScanPlan
        Where in the sensor the groove shall appear.

    Raises
    ------
    SetPointRefused
        If it is no pose, too far away, turned too far, or at another stand-off than was planned.
    """
    for name, T in (("T_b_t", to.T_b_t), ("T_s_t", to.T_s_t)):
        if not _is_pose(T):
            raise SetPointRefused(f"its {name} is no pose")
    p_b = to.T_b_t[:3, 3]
    starts = (step.groove_origin_b, step.last.T_b_t[:3, 3])
    away = min(float(np.linalg.norm(p_b - start)) for start in starts)
    if not away <= FARTHEST_STEPS * step.length:  # a length that is no number allows none
        raise SetPointRefused(
            f"it lies {1e3 * away:.1f} mm from the last section, after a step of "
            f"{1e3 * step.length:.1f} mm"
        )
    T_b_s = to.T_b_t @ inverse_pose(to.T_s_t)
    turn = rotation_angle_between(step.last.view.T_b_s, T_b_s)
    if turn > step.max_rotation:
        raise SetPointRefused(
            f"it turns the sensor by {np.degrees(turn):.0f}° from the last section, "
            f"{np.degrees(step.max_rotation):.0f}° are plausible for a step of "
            f"{1e3 * step.length:.1f} mm"
        )
    beside = float(np.linalg.norm(to.T_s_t[:3, 3] - (plan.offset, 0.0, plan.standoff)))
    if beside > LARGEST_VIEW_SHIFT:
        raise SetPointRefused(
            f"the groove would appear {1e3 * beside:.1f} mm from where it is planned in the sensor"
        )


def _is_pose(T: Array) -> bool:
    if T.shape != (4, 4) or not np.isfinite(T).all() or np.abs(T).max() > 1e6:
        return False
    R = T[:3, :3]
    orthonormal = np.abs(R @ R.T - np.eye(3)).max() < ORTHONORMAL_TOLERANCE and np.linalg.det(R) > 0
    return bool(orthonormal and (T[3] == (0.0, 0.0, 0.0, 1.0)).all())
