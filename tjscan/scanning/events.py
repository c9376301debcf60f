"""What happens out of the ordinary in a scan, by stable names, and how often."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum


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

    def with_one_more(self, name: str) -> RetryCounts:
        """With one more event of that name; the same for events that are no retry."""
        field = _COUNTED.get(name)
        return self if field is None else replace(self, **{field: getattr(self, field) + 1})


_COUNTED: dict[str, str] = {
    ScanEvent.TAKEN_AGAIN: "taken_again",
    ScanEvent.MERGED: "merged",
    ScanEvent.NUDGE: "nudges",
    ScanEvent.HALF_STEP: "half_steps",
    ScanEvent.RETREAT: "retreats",
}
