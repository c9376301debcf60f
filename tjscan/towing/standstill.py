"""Notice a vehicle that stands although it is told to drive."""

from __future__ import annotations

from collections import deque
from math import hypot
from typing import Final

import numpy as np

from tjscan.core.frames import Array

WINDOW: Final = 3.0
"""Seconds that are looked at."""

ASKED: Final = 0.02
"""Metres that a vehicle must have been told to go before its standing says anything."""

SHARE: Final = 0.3
"""Share of what was asked below which it counts as standing."""

RETRY: Final = 10.0
"""Seconds after which a vehicle that stood is told to drive again; twice as long after each
time that it did not."""


class StandstillCheck:
    """Whether one vehicle stands for good; without a fault of its own it is tried again."""

    def __init__(self) -> None:
        self._way: deque[tuple[float, Array, Array]] = deque()
        self._since: float | None = None
        self._retry = RETRY
        self._doubted = self._faulty = False

    @property
    def doubted(self) -> bool:
        """Whether it stands, or stood and was not seen to drive since, though it is tried again."""
        return self._doubted

    def update(self, time: float, pose: Array, asked: Array, *, fault: bool) -> bool:
        """Whether it stands for good.

        Parameters
        ----------
        time : float
            Seconds.
        pose : ndarray, shape (3,)
            Where it is.
        asked : ndarray, shape (2,)
            Way along x and y that it was told to go since the last update, metres.
        fault : bool
            Whether it reports one itself.
        """
        if fault:  # when it is mended, the vehicle says so itself
            self._since = None
            self._faulty = self._doubted = True
            self._way.clear()
            return True
        if self._faulty:
            self._faulty = self._doubted = False
        if self._since is not None:
            if time - self._since < self._retry:
                return True
            self._retry *= 2
            self._since = None
            self._way.clear()
        self._way.append((time, pose[:2], asked))
        while len(self._way) > 1 and time - self._way[1][0] >= WINDOW:
            self._way.popleft()
        if time - self._way[0][0] < WINDOW:
            return False
        total = np.sum([way for *_, way in list(self._way)[1:]], axis=0)
        moved = pose[:2] - self._way[0][1]
        if hypot(*total) <= ASKED:
            return False
        self._doubted = hypot(*moved) < SHARE * hypot(*total)
        if self._doubted:
            self._since = time
        else:
            self._retry = RETRY
        return self._doubted
