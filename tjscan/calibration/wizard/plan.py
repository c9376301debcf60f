"""What a calibration goes by: the board, the sensor as far as it is known, and what they err by."""

from __future__ import annotations

from dataclasses import dataclass

from tjscan.calibration.arm_error import FlangeMoves
from tjscan.calibration.measuring_range import MeasuringRange
from tjscan.calibration.noise import NoiseModel
from tjscan.core.frames import Array, frozen_arrays
from tjscan.laser.deviation import LaserDeviation


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class CalibrationPlan:
    """Plan of a calibration: where board and sensor roughly are, and how many lines to take.

    Parameters
    ----------
    T_b_board : ndarray, shape (4, 4)
        About where the board is: origin in the middle of its face, z away from it.
    half_sizes : ndarray, shape (2,)
        Half its sides along its x and y, in metres.
    tip_f : ndarray, shape (3,)
        The probe's tip in frame f, in metres. The flange's z points into the board to touch.
    T_f_s : ndarray, shape (4, 4)
        About where the sensor sits on the flange.
    window : MeasuringRange
        What the sensor sees.
    noise : NoiseModel
        What measurements err by.
    touches, lines : int
        How many to take.
    flange_moves : callable, optional
        How the arm's geometry error moves its flange, where its model is known.
    laser : LaserDeviation, optional
        By what the laser may deviate.
    """

    T_b_board: Array
    half_sizes: Array
    tip_f: Array
    T_f_s: Array
    window: MeasuringRange
    noise: NoiseModel
    touches: int
    lines: int
    flange_moves: FlangeMoves | None = None
    laser: LaserDeviation | None = None
