"""What one profile says about the target, and the flange pose it was taken from."""

from __future__ import annotations

from dataclasses import dataclass

from tjscan.calibration.circle_fit import CircleFit
from tjscan.calibration.line_fit import LineFit
from tjscan.calibration.roof_fit import RoofFit
from tjscan.core.frames import Array, readonly_copy


@dataclass(frozen=True, slots=True, eq=False)
class LineSample:
    """A line fitted to a profile of the board, and the flange pose it was taken from.

    Parameters
    ----------
    name : str
        What reports call it.
    T_b_f : ndarray, shape (4, 4)
        Flange pose, as the arm read it.
    fit : LineFit
        The line, frame s.
    """

    name: str
    T_b_f: Array
    fit: LineFit

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_b_f", readonly_copy(self.T_b_f))


@dataclass(frozen=True, slots=True, eq=False)
class ArcSample:
    """A circle fitted to a profile of the ball, and the flange pose; see `LineSample`."""

    name: str
    T_b_f: Array
    fit: CircleFit

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_b_f", readonly_copy(self.T_b_f))


@dataclass(frozen=True, slots=True, eq=False)
class RoofSample:
    """Two lines fitted to a profile of the roof edge, and the flange pose; see `LineSample`."""

    name: str
    T_b_f: Array
    fit: RoofFit

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_b_f", readonly_copy(self.T_b_f))
