"""What a scan is asked to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tjscan.core.frames import Array
from tjscan.scanning.adaptive import Adaptive
from tjscan.scanning.correction_criterion import CorrectionCriterion
from tjscan.scanning.prediction import Prediction
from tjscan.scanning.target import Direction, target_in_sensor


@dataclass(frozen=True, slots=True)
class ScanPlan:
    """Step, direction, view and end of a scan.

    Parameters
    ----------
    step : float
        Distance from section to section, d_st, metres.
    prediction : Prediction or "smooth"
        How the motion is carried on: one of the paper's cases, or along the seam of two tubes.
    direction : Direction
        Which way round the brace.
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
    skip : CorrectionCriterion, optional
        When a prediction view may be the section's, and no correction is made; never where left
        out, as in the paper.
    adaptive : Adaptive, optional
        What may change from section to section: it says how long the steps are, not `step`.
    return_tolerance : float
        How far a section may seem to have moved when it is seen once more, metres.
    """

    step: float
    prediction: Prediction | Literal["smooth"]
    direction: Direction
    pull_angle: float
    standoff: float
    offset: float = 0.0
    length: float | None = None
    sections: int | None = None
    skip: CorrectionCriterion | None = None
    adaptive: Adaptive | None = None
    return_tolerance: float = 0.5e-3

    def target(self, work_angle: float) -> Array:
        """T_s_t for a groove with this work angle, shape (4, 4)."""
        p_s_t = (self.offset, 0.0, self.standoff)
        return target_in_sensor(work_angle, self.pull_angle, p_s_t, self.direction)
