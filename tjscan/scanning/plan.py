"""What a scan is asked to do."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from tjscan.core.frames import Array
from tjscan.core.units import DEG, LIST_OR_WORD_IN_FILE, MM, FileKey, PoseSettings, SettingsTable
from tjscan.scanning.adaptive import AdaptiveStepSettings
from tjscan.scanning.correction_criterion import CorrectionCriterion
from tjscan.scanning.prediction import SMOOTH_PREDICTION
from tjscan.scanning.target import ScanDirection, target_pose_in_sensor


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanPlan(SettingsTable):
    """The table [scan]: step, direction, view and end of a scan.

    Parameters
    ----------
    direction : ScanDirection
        Which way round the brace.
    step : float
        Distance from section to section, d_st, metres.
    prediction : int or "smooth"
        How the motion is carried on: one of the paper's cases, or along the seam of two tubes.
    pull_angle : float
        α, radians.
    standoff : float
        z_s at which the groove's origin shall appear, metres.
    offset : float
        x_s at which it shall appear, metres; negative shows more of the brace.
    length : float, optional
        Stop after this much groove, counted from the second taught section, metres.
    sections : int, optional
        Stop after this many sections, the two taught ones included.
    return_tolerance : float
        How far a section may seem to have moved when it is seen again, metres.
    criterion : CorrectionCriterion
        When a prediction view may be the section's, and no correction is made; see `skip`.
    adaptive : AdaptiveStepSettings, optional
        What may change from section to section: it decides how long the steps are, not `step`.
    first, second : PoseSettings, optional
        The taught poses of the flange in frame b; each station has its own.
    """

    direction: Annotated[ScanDirection, LIST_OR_WORD_IN_FILE] = ScanDirection.COUNTERCLOCKWISE
    step: Annotated[float, Ge(5), Le(300), MM] = 0.04
    prediction: Annotated[Literal[1, 2, 3, 4, "smooth"], FileKey("prediction_case")] = 3
    pull_angle: Annotated[float, Ge(-45), Le(45), DEG] = radians(10)
    standoff: Annotated[float, Ge(10), Le(2000), MM] = 0.23
    offset: Annotated[float, Ge(-500), Le(500), MM.with_key("view_offset_mm")] = -0.015
    length: Annotated[float | None, Gt(0), MM] = None
    sections: Annotated[int | None, Ge(3)] = None
    return_tolerance: Annotated[float, Gt(0), Le(50), MM.with_key("resume_tolerance_mm")] = 0.5e-3
    criterion: Annotated[CorrectionCriterion, FileKey("skip")] = field(
        default_factory=CorrectionCriterion
    )
    adaptive: AdaptiveStepSettings | None = None
    first: PoseSettings | None = None
    second: PoseSettings | None = None

    @property
    def correction_criterion(self) -> CorrectionCriterion | None:
        """Criterion for skipping corrections; None where each is made, as in the paper."""
        enabled = self.criterion.enabled
        if enabled is None:
            enabled = self.prediction == SMOOTH_PREDICTION
        return self.criterion if enabled else None

    def target_pose_in_sensor(self, work_angle: float) -> Array:
        """T_s_t for a groove with this work angle, shape (4, 4)."""
        p_s_t = (self.offset, 0.0, self.standoff)
        return target_pose_in_sensor(work_angle, self.pull_angle, p_s_t, self.direction)
