"""Whether what a vehicle's wheels do is what its program ordered."""

from __future__ import annotations

from dataclasses import astuple
from typing import Final

import numpy as np

from tjscan.vehicle.mqtt.wire import LONGEST_MESSAGE_DELAY
from tjscan.vehicle.vehicle import Twist

LAG_TIME: Final = 0.4
"""Seconds in which a vehicle follows an order that it has: motors' lag and braking together."""

RESPONSE_TIME: Final = LAG_TIME + 2 * LONGEST_MESSAGE_DELAY
"""Seconds in which its states show that: both messages may be as late as any that is taken."""

SPEED_TOLERANCE: Final = np.array((0.01, 0.03, 0.01))
"""By how much wheels may turn faster than ordered: m/s along, rad/s, m/s sideways. An assumption
that leaves room for a drive's overshoot."""

OVERSHOOT_SHARE: Final = 0.1
"""The same, as a share of what is ordered."""


class OrderedMotion:
    """What was ordered of late, and whether a motion can come from it.

    A vehicle on its way from one order to the next moves with something between the two: all
    orders of the last `RESPONSE_TIME`, and rest, bound it. Slower than ordered is no contradiction,
    for a vehicle may stop by itself.
    """

    def __init__(self) -> None:
        # Replaced as a whole: one thread orders, another one asks.
        self._orders: tuple[tuple[float, Twist], ...] = ()
        self._first = np.inf

    def order(self, twist: Twist, now: float) -> None:
        """Take note of an order, at seconds on the caller's clock."""
        self._first = min(self._first, now)
        since = [n for n, (time, _) in enumerate(self._orders) if time < now - RESPONSE_TIME]
        self._orders = (*self._orders[since[-1] if since else 0 :], (now, twist))

    def contradicts(self, motion: Twist, now: float) -> bool:
        """Whether a motion that the encoders show can't come from what was ordered."""
        if now < self._first + LAG_TIME:
            return False
        ordered = np.array([(0.0, 0.0, 0.0), *(astuple(twist) for _, twist in self._orders)])
        spare = SPEED_TOLERANCE + OVERSHOOT_SHARE * np.abs(ordered).max(axis=0)
        shown = np.array(astuple(motion))
        return bool(
            np.any((shown < ordered.min(axis=0) - spare) | (shown > ordered.max(axis=0) + spare))
        )
