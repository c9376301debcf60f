"""What has been scanned is in the arm's way from then on."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from tjscan.robot.clearance import ClearPathPlanner
from tjscan.scanning.section import ScannedSection


class ScannedSurfaceObstacle:
    """Journal that makes the scanned surface an obstacle that the arm keeps clear of.

    Parameters
    ----------
    clearance : ClearPathPlanner
        Receives the surface after every section.
    sections : iterable of ScannedSection, optional
        What was found before.
    """

    def __init__(
        self, clearance: ClearPathPlanner, sections: Iterable[ScannedSection] = ()
    ) -> None:
        self._clearance = clearance
        self._points_b = [section.points_b for section in sections]
        self._update()

    def record(self, message: object) -> None:
        """Add the strip from the last section to this one; false points of profiles are none."""
        if isinstance(message, ScannedSection):
            self._points_b.append(message.points_b)
            self._update()

    def _update(self) -> None:
        if len(self._points_b) > 1:
            points = np.array(self._points_b)
            self._clearance.set_measured_surface(
                points.reshape(-1, 3), grid_triangles(*points.shape[:2])
            )


def grid_triangles(rows: int, columns: int) -> NDArray[np.int64]:
    """Triangles of the surface through a grid of points, numbered row by row.

    Parameters
    ----------
    rows, columns : int
        Of the grid.

    Returns
    -------
    ndarray, shape (m, 3)
        Numbers of each triangle's corners.
    """
    grid = np.arange(rows * columns, dtype=np.int64).reshape(rows, columns)
    a, b, c, d = (
        corner.ravel() for corner in (grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:])
    )
    return np.vstack([np.column_stack([a, b, c]), np.column_stack([b, d, c])])
