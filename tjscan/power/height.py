"""The height of a torch by the current of its arc: relative, held against the height of a look.

A constant-voltage arc draws less current the longer the wire's free end is. A controller of the
measured current so keeps the torch's distance from the surface, as crawlers do. It is blind to
what else moves the current: wire that slips by 3 % passes for 1.1 mm of height. What it makes up
for is therefore bounded about the height that a look gave, and said where it is at the bound.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le

from tjscan.core.units import MM, SECONDS, SettingsTable
from tjscan.power.laws import ArcLaw

MEDIAN_SAMPLES: Final = 11
"""The height follows the median of so many currents: a short circuit or a misread one moves it by
nothing."""

FASTEST_HEIGHT_CHANGE: Final = 5e-3
"""At which the torch's height may change, m/s."""

LONGEST_PERIOD: Final = 0.05
"""Seconds between two currents that count, at most: none are made up for after a pause."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ArcHeightSettings(SettingsTable):
    """The table [weld.height]: a PID controller of the torch's height by the arc's current.

    Parameters
    ----------
    proportional : float
        Share of the deviation that is made up for at once.
    integral : float
        The same in each second, 1/s.
    derivative : float
        Seconds of the deviation's rate.
    reference : float
        Seconds of an arc whose median current counts as that of the look's height.
    most : float
        By which the torch may leave the look's height, metres.
    law : ArcLaw
        How the current falls with the free end.
    """

    proportional: Annotated[float, Ge(0), Le(1)] = 0.1
    integral: Annotated[float, Gt(0), Le(10)] = 2.0
    derivative: Annotated[float, Ge(0), Le(1), SECONDS] = 0.0
    reference: Annotated[float, Gt(0), Le(10), SECONDS] = 0.5
    most: Annotated[float, Gt(0), Le(10), MM] = 1.0e-3
    law: ArcLaw = field(default_factory=ArcLaw)


@dataclass(slots=True)
class ArcHeight:
    """Height of the torch over one arc.

    Parameters
    ----------
    settings : ArcHeightSettings

    Attributes
    ----------
    raised : float
        By how much the torch is to be above the look's height, metres.
    at_bound : bool
        Whether the current of this arc has asked for more than may be.
    """

    settings: ArcHeightSettings
    raised: float = 0.0
    at_bound: bool = False
    _usual: list[float] = field(default_factory=list)
    _latest: deque[float] = field(default_factory=lambda: deque(maxlen=MEDIAN_SAMPLES))
    _begun: float | None = None
    _last: tuple[float, float] = (0.0, 0.0)
    _sum: float = 0.0

    def update(self, time: float, feed: float, current: float) -> float:
        """Take in a current; returns `raised`.

        Parameters
        ----------
        time : float
            Seconds, growing.
        feed : float
            Of the wire as it is set, m/s: what slips is not seen.
        current : float
            Measured, A.
        """
        settings = self.settings
        free_end = settings.law.stick_out(feed, max(current, 1.0))
        self._latest.append(free_end)
        self._begun = time if self._begun is None else self._begun
        if time - self._begun < settings.reference:
            self._usual.append(free_end)
            self._last = time, 0.0
            return 0.0
        # The free end goes as 1/I²: means would follow a single current near none.
        off = float(np.median(self._latest) - np.median(self._usual))
        period, before = min(time - self._last[0], LONGEST_PERIOD), self._last[1]
        self._last = time, off
        rate = (off - before) / period if period > 0 else 0.0
        most = settings.most
        self._sum = float(np.clip(self._sum + settings.integral * off * period, -most, most))
        asked = -(settings.proportional * off + self._sum + settings.derivative * rate)
        self.at_bound |= abs(asked) >= most
        furthest = FASTEST_HEIGHT_CHANGE * period
        way = float(np.clip(asked, -most, most)) - self.raised
        self.raised += float(np.clip(way, -furthest, furthest))
        return self.raised
