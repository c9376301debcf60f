"""How a bead is welded along its way: rows of speed, place, weave and wire feed, and its weave."""

from __future__ import annotations

from dataclasses import fields
from typing import Self

import numpy as np

from tjscan.core.frames import Array, array_dataclass


@array_dataclass
class BeadSegments:
    """How a bead is welded along its way: rows that hold at places, linear between two of them.

    Before its first row and behind its last one these hold on: a table of one row is a bead that
    is welded alike all along.

    Parameters
    ----------
    s : ndarray, shape (n,)
        Where a row holds, metres along the groove or the joint; all rising, or all falling.
    speed : ndarray, shape (n,)
        Travel speed, m/s.
    offset : ndarray, shape (n,)
        Of the torch from its path, to the right in the direction of travel, metres.
    height : ndarray, shape (n,)
        Of the torch over its path, out of the work, metres.
    weave : ndarray, shape (n,)
        How far it swings to either side, metres.
    feed : ndarray, shape (n,)
        Wire feed, m/s; NaN where it is not stated.
    """

    s: Array
    speed: Array
    offset: Array
    height: Array
    weave: Array
    feed: Array

    def __post_init__(self) -> None:
        steps = np.diff(np.atleast_1d(self.s))  # rows at one place have none
        if not ((steps > 0).all() or (steps < 0).all()):
            raise ValueError("rows must come in their order along the bead, no two at one place")

    def at(self, s: Array) -> Self:
        """Rows at other places, shape (m,) or (), metres."""
        order = np.argsort(self.s)
        columns = (getattr(self, field.name)[order] for field in fields(self)[1:])
        return type(self)(s, *(np.interp(s, self.s[order], column) for column in columns))


def weave_corners(period: float, dwell: float) -> Array:
    """Times within a swing at which a weave's torch leaves or comes to its ends, shape (6,).

    From the middle out to the right end, where it dwells, to the left end, and back; seconds.
    """
    swing = 0.5 * period - dwell
    steps = 0.5 * swing, dwell, swing, dwell, 0.5 * swing
    return np.append(0.0, np.cumsum(steps))


def weave_swing(time: Array, period: float, dwell: float) -> Array:
    """How a weave swings, from -1 to 1, positive to the right.

    Parameters
    ----------
    time : ndarray, shape (...)
        Since the arc was struck, seconds.
    period : float
        Of a whole swing there and back, dwells included, seconds.
    dwell : float
        How long it stays at each end, seconds.
    """
    into = np.mod(time, period)
    return np.interp(into, weave_corners(period, dwell), (0.0, 1.0, 1.0, -1.0, -1.0, 0.0))
