"""The longest silence within the last seconds: the evidence for why a program stopped."""

from __future__ import annotations

from typing import Final

REMEMBERED: Final = 10.0
"""Seconds for which a silence is remembered: longer than its consequences take to be seen."""


class LongestSilence:
    """Longest time between two signs of life, of those that ended lately or last until now.

    Parameters
    ----------
    moment : float
        When it begins, in seconds on a clock that never jumps.
    """

    def __init__(self, moment: float) -> None:
        self._last = moment
        self._ended: list[tuple[float, float]] = []  # when, and how long: ever shorter ones

    def note_sign_of_life(self, moment: float) -> None:
        """Note that there was a sign of life at this moment."""
        length, self._last = moment - self._last, moment
        self._ended = [
            (end, gap) for end, gap in self._ended if moment - end < REMEMBERED and gap > length
        ] + [(moment, length)]

    def longest(self, moment: float) -> float:
        """Longest silence of the last seconds until this moment, in seconds."""
        lately = [gap for end, gap in self._ended if moment - end < REMEMBERED]
        return max([moment - self._last, *lately])
