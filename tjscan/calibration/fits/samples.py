"""What one profile says about the target, and the flange pose it was taken from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

from tjscan.calibration.fits.circle import CircleFit
from tjscan.calibration.fits.line import LineFit
from tjscan.calibration.fits.roof import RoofFit
from tjscan.core.frames import Array, frozen_arrays

Fit = TypeVar("Fit", LineFit, CircleFit, RoofFit)


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class PosedFit(Generic[Fit]):
    """What was fitted to a profile, and the flange pose it was taken from.

    Parameters
    ----------
    name : str
        What reports call it.
    T_b_f : ndarray, shape (4, 4)
        Flange pose, as the arm read it.
    fit : LineFit, CircleFit or RoofFit
        Frame s.
    by_laser : ndarray, shape (k, m), or None
        How it changes with each draw of the laser's deviation, see `line_by_laser`; none where
        nothing is stated of that.
    by_arm : ndarray, shape (6, m), or None
        How the flange moves with each draw of the arm's geometry, see `ArmGeometry.moves`; none
        where the arm's posture is not known.
    """

    name: str
    T_b_f: Array
    fit: Fit
    by_laser: Array | None = None
    by_arm: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LineSample(PosedFit[LineFit]):
    """A line fitted to a profile of the board."""


@dataclass(frozen=True, slots=True, eq=False)
class ArcSample(PosedFit[CircleFit]):
    """A circle fitted to a profile of the ball."""


@dataclass(frozen=True, slots=True, eq=False)
class RoofSample(PosedFit[RoofFit]):
    """Two lines fitted to a profile of the roof edge."""
