"""Which poses of a stream may be believed to be poses, and when they were measured."""

from __future__ import annotations

from math import inf
from typing import Final

from tjscan.vehicle.mqtt.wire import CLOCK_DRIFT, MOST_DELAY, BadMessage, WireMessage

TAKEN_OVER: Final = 0.5
"""Seconds of silence after which another sender may take over."""

CLOCK_JUMP: Final = 2.0
"""Seconds: what comes later, or earlier, than this after the quickest has another clock."""

CLOCK_LEARNED: Final = 10
"""Messages in a row that must agree on another clock before it is believed."""


class PoseGate:
    """What lets the poses of one topic through, and dates them on the receiver's clock.

    The clocks of sender and receiver need not agree: the quickest message so far took no time, and
    how late another is counts from that. Unlike a command, a late pose is worth something, as long
    as it is known how old it is. A delay that all of them have is not seen.
    """

    def __init__(self) -> None:
        self._session, self._number = "", -1
        self._offset, self._heard, self._given = inf, -inf, -inf
        self._doubted: tuple[float, int] = (inf, 0)

    def measured(self, message: WireMessage, now: float) -> float:
        """When it was measured, seconds on the receiver's clock.

        Parameters
        ----------
        message : WireMessage
            What came.
        now : float
            When, seconds on the receiver's clock.

        Raises
        ------
        BadMessage
            If it is of another sender, came out of order, or its clock can't be right.
        """
        if message.session != self._session:
            if now - self._heard < TAKEN_OVER:
                raise BadMessage("it is of another session")
            self._session, self._number, self._offset = message.session, -1, inf
        if message.number <= self._number:
            raise BadMessage(f"number {message.number} came after {self._number}")
        self._number = message.number
        offset = now - message.time
        known = self._offset + CLOCK_DRIFT * (now - self._heard)
        self._heard = now
        if self._offset < inf and abs(offset - known) > CLOCK_JUMP and not self._agreed(offset):
            raise BadMessage(f"its clock is {known - offset:+.2f} s off, or it came late")
        self._offset = offset if abs(offset - known) > CLOCK_JUMP else min(offset, known)
        self._doubted = (inf, 0)
        measured = message.time + self._offset
        if measured <= self._given:
            raise BadMessage("it was measured before the last one")
        self._given = measured
        return measured

    def _agreed(self, offset: float) -> bool:
        """Whether enough messages in a row have this other clock."""
        before, times = self._doubted
        self._doubted = (offset, times + 1 if abs(offset - before) < MOST_DELAY else 1)
        return self._doubted[1] >= CLOCK_LEARNED
