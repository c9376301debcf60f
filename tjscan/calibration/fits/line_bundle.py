"""Lines on a board, stacked with the poses of the flange they were seen from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tjscan.calibration.fits.line import LineFit
from tjscan.calibration.plucker import PluckerLine, line_through_point
from tjscan.core.frames import Array, frozen_arrays


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class LineBundle:
    """Lines on the board stacked with the flange poses they were taken from.

    Parameters
    ----------
    R_b_f : ndarray, shape (n, 3, 3)
        Orientations of the flange.
    p_b_f : ndarray, shape (n, 3)
        Positions of the flange, in metres.
    points_s, directions_s : ndarray, shape (n, 3)
        A point and the unit direction of each line in frame s, y = 0.
    """

    R_b_f: Array
    p_b_f: Array
    points_s: Array
    directions_s: Array

    @property
    def plucker_lines_s(self) -> PluckerLine:
        """All lines in frame s, in Plücker coordinates."""
        return line_through_point(self.points_s, self.directions_s)


def stack_lines(T_b_f: Array, fits: list[LineFit]) -> LineBundle:
    """Stack flange poses and lines into one bundle.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.
    fits : list of LineFit
        The line seen from each.
    """
    return LineBundle(
        T_b_f[:, :3, :3],
        T_b_f[:, :3, 3],
        np.stack([fit.point_s for fit in fits]),
        np.stack([fit.direction_s for fit in fits]),
    )
