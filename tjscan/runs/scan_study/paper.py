"""What Cibicik et al. (2022) measured on steel, as far as section 4.3 gives it in numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

CASE: Final = "scan.prediction_case"
STEP: Final = "scan.step_mm"

LARGEST_STEP_ERROR_PERCENT: Final = {1: 2.9, 2: 0.6, 3: 0.4, 4: 13.5}
"""Largest mean step error of each case over all step lengths (Fig. 14); signs are not given."""


@dataclass(frozen=True, slots=True)
class PaperBarValue:
    """Number that the paper's text gives for one bar of its Fig. 15 or 16.

    Parameters
    ----------
    case : int
        Of the prediction.
    step_mm : float
        Step length.
    value : float
        Millimetres or degrees.
    """

    case: int
    step_mm: float
    value: float


TRAVEL_MM: Final = (
    PaperBarValue(3, 10, 1945),
    PaperBarValue(4, 10, 3344),
    PaperBarValue(2, 100, 1718),
    PaperBarValue(3, 100, 1619),
)
"""Travel of the end effector (Fig. 15)."""

ROTATION_DEG: Final = (
    PaperBarValue(3, 10, 182),
    PaperBarValue(4, 10, 402),
    PaperBarValue(1, 100, 133),
    PaperBarValue(2, 100, 195),
)
"""Rotation of the end effector (Fig. 16)."""
