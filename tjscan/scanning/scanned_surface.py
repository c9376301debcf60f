"""What has been scanned is in the arm's way from then on."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from tjscan.robot.clearance import Clearance
from tjscan.scanning.section import ScannedSection, View


class ScannedSurface:
    """A journal that tells an arm's clearance of the surface through the sections' points.

    Parameters
    ----------
    clearance : Clearance
        Is told after every section.
    sections : iterable of ScannedSection, optional
        What was found before.
    """

    def __init__(self, clearance: Clearance, sections: Iterable[ScannedSection] = ()) -> None:
        self._clearance = clearance
        self._points_b = [scan.points_b for scan in sections]
        self._tell()

    def view(self, view: View) -> None:
        """Leave a profile alone: its ghosts and flyers are nowhere."""

    def section(self, scan: ScannedSection) -> None:
        """Keep clear of the strip from the last section to this one."""
        self._points_b.append(scan.points_b)
        self._tell()

    def event(self, name: str, detail: str) -> None:
        """Pass over what happens otherwise."""

    def _tell(self) -> None:
        if len(self._points_b) > 1:
            points = np.array(self._points_b)
            self._clearance.see(points.reshape(-1, 3), strip_triangles(*points.shape[:2]))


def strip_triangles(rows: int, columns: int) -> NDArray[np.int64]:
    """Triangles of the surface through a grid of points, numbered row by row, shape (m, 3)."""
    grid = np.arange(rows * columns, dtype=np.int64).reshape(rows, columns)
    a, b, c, d = (
        corner.ravel() for corner in (grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:])
    )
    return np.vstack([np.column_stack([a, b, c]), np.column_stack([b, d, c])])
