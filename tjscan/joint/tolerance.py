"""How far a joint's fit-up may lie from its drawing, as the drawing states it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True, slots=True)
class FitUpTolerance:
    """Largest difference of a measured fit-up from its drawing, to either side; metres, radians.

    Parameters
    ----------
    groove_angle : float
        Radians.
    root_opening : float
        Also of the root bead's width, where one is laid.
    root_face, depth : float
    high_low : float
        By which brace or leg may stand out of where they are drawn, or in.
    """

    groove_angle: float = inf
    root_opening: float = inf
    root_face: float = inf
    depth: float = inf
    high_low: float = inf


NOT_STATED = FitUpTolerance()
"""Of a drawing that states none."""
