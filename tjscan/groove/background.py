"""Points that are no steel: runs of reflections before or behind the surface, and what they cost.

Light that took another way comes back as a whole run of points, which jumps off the surface at
one end or both. Its points hang together, so that they are no more worth explaining than a few
independent ones. A run that leaves a side without a jump is steel: it has to be explained.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove.segments import Index

JUMP_DISTANCE, JUMP_STEEPNESS = 0.5e-3, 1.5
"""Neighbouring points of one surface lie no farther apart than this, in metres, with this many
times the distance of their neighbours."""

HOLE_COLUMNS: Final = 6
"""Columns without points after which nothing shows whether a surface goes on."""

RUN_COST, POINT_COST = 3.0, 0.35
"""What a run of reflections costs, in outliers, and each of its points."""


@dataclass(frozen=True, slots=True, eq=False)
class PointRuns:
    """Runs of points that hang together, in the order of a row.

    Parameters
    ----------
    first : ndarray of int, shape (m,)
        First point of each run.
    count : ndarray of int, shape (m,)
        Its number of points.
    jumps : ndarray of bool, shape (m,)
        Whether it jumps off what is seen before or after it.
    """

    first: Index
    count: Index
    jumps: NDArray[np.bool_]

    def bounds_of_run(self, point: int) -> tuple[int, int]:
        """First point of the run that a point belongs to, and the one after its last."""
        k = int(self.first.searchsorted(point, side="right")) - 1
        return int(self.first[k]), int(self.first[k] + self.count[k])

    def within(self, start: int, end: int) -> PointRuns:
        """The runs of the points from `start` to before `end`; what is cut off is no reflection."""
        a, b = int(self.first.searchsorted(start, side="right")) - 1, self.first.searchsorted(end)
        first = self.first[a:b].copy()
        stop = first + self.count[a:b]
        whole = (first >= start) & (stop <= end)
        first[0] = start
        return PointRuns(first - start, np.minimum(stop, end) - first, self.jumps[a:b] & whole)

    def total_cost(self, costs: Array) -> Array:
        """What all points cost, in outliers, if whole runs that jump may be reflections.

        Parameters
        ----------
        costs : ndarray, shape (..., n)
            What each point pays for its distance from its side, 1 for an outlier.
        """
        paid = np.add.reduceat(costs, self.first, axis=-1)
        off = self.jumps & (np.minimum.reduceat(costs, self.first, axis=-1) >= 1)
        cheaper = np.minimum(paid, RUN_COST + POINT_COST * self.count)
        return np.asarray(np.where(off, cheaper, paid).sum(axis=-1))


def find_runs(points: Array, columns: Index) -> PointRuns:
    """Divide a row of points, shape (n, 2), where neighbours jump or a wide hole lies between.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        x and z in metres.
    columns : ndarray of int, shape (n,)
    """
    step = np.hypot(*np.diff(points, axis=0).T)
    apart = np.abs(np.diff(columns))
    each = np.concatenate((step[:1] / apart[:1], step / apart, step[-1:] / apart[-1:]))
    usual = np.minimum(each[:-2], each[2:])
    hole = apart > HOLE_COLUMNS
    jump = ~hole & (step > JUMP_DISTANCE + JUMP_STEEPNESS * usual * apart)
    ends = np.flatnonzero(jump | hole) + 1
    first = np.concatenate(([0], ends))
    count = np.diff(np.concatenate((first, [len(points)])))
    jumped = np.concatenate(([False], jump[ends - 1], [False]))
    return PointRuns(first, count, jumped[:-1] | jumped[1:])
