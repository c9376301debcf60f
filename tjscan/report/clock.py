"""When the events of a run happened: on the clock of its device, since the recording began."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final, Self

from tjscan.recording.journal import RunEvent
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import when_recording_began
from tjscan.runs.tasks import recorded_tasks

MOST_LISTED_EVENTS: Final = 200
"""Events that a page lists; a run with more has other troubles."""


@dataclass(frozen=True, slots=True)
class EventClock:
    """Events of one recording, and when it began.

    Parameters
    ----------
    began : datetime
        UTC.
    events : sequence of RunEvent
    station : str
        Where it was recorded, if there are several.
    """

    began: datetime
    events: Sequence[RunEvent]
    station: str = ""

    @classmethod
    def of_run(cls, directory: Path, events: Sequence[RunEvent], station: str = "") -> Self:
        """Read when the recording of a run began; without one its first event does."""
        files = [
            file
            for one in recorded_tasks(directory)
            for file in recording_files(directory, one.recording)
        ]
        starts = [start for file in files if (start := when_recording_began(file)) is not None]
        return cls(
            min((*starts, *(event.time for event in events)), default=datetime.min), events, station
        )

    @property
    def words(self) -> str:
        """What the times are counted from."""
        of = f"station {self.station}: " if self.station else ""
        return (
            f"{of}0 s is {self.began:%Y-%m-%d %H:%M:%S} UTC, when the recording began; from there "
            "on it is the clock of the arm or the vehicle."
        )

    @property
    def rows(self) -> Iterator[tuple[str, str, str]]:
        """Seconds, name and detail of each event, as far as they are listed."""
        for event in self.events[:MOST_LISTED_EVENTS]:
            since = (event.time - self.began).total_seconds()
            yield f"{since:.1f}", event.name, event.detail
