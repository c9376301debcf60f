"""What a calibration measured, each entry on the disk before the next move."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Self

from tjscan.calibration.posed_profile import PosedProfile
from tjscan.calibration.topics import (
    MEASURED,
    TOPICS,
    Begun,
    Entry,
    Line,
    Passed,
    Touch,
    messages_of,
    read_entries,
)
from tjscan.recording.writer import Recording, next_part


@dataclass(frozen=True, slots=True)
class Measured:
    """All that was measured so far. What comes next follows from it alone.

    Parameters
    ----------
    begun : datetime
        When the first of it.
    touches : dict of int to Touch
        The last one of each place.
    shots : tuple of PosedProfile
        The lines.
    passed : tuple of Passed
        Poses that are not worth another try.
    blind : int
        Poses passed over since the last line, or since somebody went on.
    fresh : PosedProfile or None
        The line that verifies.
    """

    begun: datetime
    touches: dict[int, Touch]
    shots: tuple[PosedProfile, ...] = ()
    passed: tuple[Passed, ...] = ()
    blind: int = 0
    fresh: PosedProfile | None = None

    def after(self, entry: Entry) -> Measured:
        """The same with one entry more."""
        match entry:
            case Begun():
                return replace(self, blind=0)
            case Touch():
                return replace(self, touches={**self.touches, entry.place: entry})
            case Line(shot, fresh=True):
                return replace(self, fresh=shot)
            case Line(shot):
                return replace(self, shots=(*self.shots, shot), blind=0)
            case Passed():
                return replace(self, passed=(*self.passed, entry), blind=self.blind + 1)


class Logbook:
    """The recording of a calibration; a context manager.

    Parameters
    ----------
    directory : Path
        Where it is. What it holds already is where one goes on, in a part of its own; an entry
        that was cut off in the middle is dropped.

    Raises
    ------
    RecordingError
        On entering or writing, if it can't be read or written, or is damaged.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def __enter__(self) -> Self:
        begun = Begun(datetime.now(UTC).replace(microsecond=0))
        entries = list(read_entries(self._directory))
        first = next((entry for entry in entries if isinstance(entry, Begun)), begun)
        self.measured = Measured(first.date, {})
        for entry in entries:
            self.measured = self.measured.after(entry)
        with ExitStack() as stack:
            recording = Recording(next_part(self._directory, MEASURED), TOPICS)
            self._recording = stack.enter_context(recording)
            self.add(begun)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def add(self, entry: Entry) -> None:
        """Bring an entry to the disk; only then does it count as measured."""
        now = time.time_ns()
        self._recording.write(now, *messages_of(now, entry))
        self._recording.sync()
        self.measured = self.measured.after(entry)
