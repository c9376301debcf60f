"""Notice a vehicle that stands although it is told to drive."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import hypot, log
from typing import Final

import numpy as np

from tjscan.core.frames import Array

WINDOW: Final = 3.0
"""Seconds that are looked at, at least: what a vehicle lags behind its orders is little of them."""

LONGEST: Final = 30.0
"""The same at most, where much of it is needed to tell standing from noise."""

ASKED: Final = 0.02
"""Metres that a vehicle must have been told to go before its standing says anything."""

SHARE: Final = 0.6
"""Share of what was asked that a vehicle goes at least, if it drives: its wheels slip."""

ERROR_RATE: Final = 1e-6
"""With which a look takes a vehicle that drives for one that stands, at most."""

CERTAIN: Final = log(1 / ERROR_RATE)

EXPECTED: Final = 2.0
"""Evidence to be expected in a window, over what is needed: it is found in spite of noise."""

RETRY: Final = 10.0
"""Seconds after which a vehicle that stood is told to drive again; twice as long after each
time that it did not."""


class StandstillCheck:
    """Whether one vehicle stands for good; without a fault of its own it is tried again.

    Two hypotheses are held against each other: it goes `SHARE` of the way that it is told to go,
    and it goes none. What is seen of its way is off by the noise of the two poses at its ends. The
    logarithm of the likelihoods' ratio decides once it passes log(1 / `ERROR_RATE`): the other
    hypothesis then gives such a ratio no oftener than that (Wald, Sequential analysis, 1947, 3.2).
    The window is as long as it takes until either is to be expected to pass it by far.
    """

    def __init__(self) -> None:
        self._way: deque[_Seen] = deque()
        self._since: float | None = None
        self._retry = RETRY
        self._doubted = self._faulty = False

    @property
    def doubted(self) -> bool:
        """Whether it stands, or stood and was not seen to drive since, though it is tried again."""
        return self._doubted

    def update(
        self, time: float, pose: Array, asked: Array, *, sigma: float, fault: bool = False
    ) -> bool:
        """Whether it stands for good.

        Parameters
        ----------
        time : float
            Seconds.
        pose : ndarray, shape (3,)
            Where it is.
        asked : ndarray, shape (2,)
            Way along x and y that it was told to go since the last update, metres.
        sigma : float
            Standard deviation of its place, metres.
        fault : bool, optional
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
        total = asked + (self._way[-1].asked if self._way else 0.0)
        self._way.append(_Seen(time, pose[:2], total, sigma))
        while self._is_enough_from(1) or time - self._way[0].time > LONGEST:
            self._way.popleft()
        if not self._is_enough_from(0):
            return False
        evidence = self._evidence()
        if evidence > CERTAIN:
            self._doubted, self._since = True, time
        elif evidence < -CERTAIN:
            self._doubted, self._retry = False, RETRY
        return self._since is not None

    def _is_enough_from(self, k: int) -> bool:
        """Whether the way from the one at k on is enough to judge it by."""
        if k >= len(self._way):
            return False
        begin, end = self._way[k], self._way[-1]
        asked = hypot(*(end.asked - begin.asked))
        noise = hypot(begin.sigma, end.sigma)
        return (
            end.time - begin.time >= WINDOW
            and asked > ASKED
            and (SHARE * asked / noise) ** 2 / 2 >= EXPECTED * CERTAIN
        )

    def _evidence(self) -> float:
        """Logarithm of the likelihoods' ratio, standing over driving."""
        begin, end = self._way[0], self._way[-1]
        driven, moved = SHARE * (end.asked - begin.asked), end.place - begin.place
        off, still = np.sum((moved - driven) ** 2), np.sum(moved**2)
        return float((off - still) / (2 * (begin.sigma**2 + end.sigma**2)))


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """A vehicle at a time, where it is, how far it was told to go until then, and the noise."""

    time: float
    place: Array
    asked: Array
    sigma: float
