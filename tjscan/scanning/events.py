"""What happens out of the ordinary in a scan, by stable names, and how often."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Self


class ScanEvent(StrEnum):
    """Names of the events of a scan, in journals and recordings."""

    TAKEN_AGAIN = "taken again"
    MERGED = "merged"
    NUDGE = "nudge"
    HALF_STEP = "half step"
    RETREAT = "retreat"
    STEP_OVER = "step over"
    STRAIGHT = "straight"
    TACK = "tack"
    RESUMED = "resumed"
    DAMAGED = "damaged"
    PAUSED = "paused"
    STOP_REQUESTED = "stop requested"
    STOP = "stop"
    COMPLETE = "complete"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class RetryCounts:
    """How often each kind of retry was made.

    Parameters
    ----------
    taken_again : int
        Profiles taken again at the same place.
    merged : int
        Profiles made of what several of the same place agree on.
    nudges : int
        Views from a little beside the set-point.
    half_steps : int
        Steps tried again at half their length.
    retreats : int
        Returns to the last section.
    """

    taken_again: int = 0
    merged: int = 0
    nudges: int = 0
    half_steps: int = 0
    retreats: int = 0

    @classmethod
    def of_events(cls, names: Iterable[str]) -> Self:
        """Count the retries among events, by their names."""
        count = Counter(names)
        return cls(
            taken_again=count[ScanEvent.TAKEN_AGAIN],
            merged=count[ScanEvent.MERGED],
            nudges=count[ScanEvent.NUDGE],
            half_steps=count[ScanEvent.HALF_STEP],
            retreats=count[ScanEvent.RETREAT],
        )
