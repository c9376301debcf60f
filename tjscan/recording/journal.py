"""What a run reports while it goes on: one journal for every task, and the one that records it.

Messages are dataclasses of the task: a profile, a section, a cycle, or a `RunEvent`. A listener,
such as a progress bar or the live page, takes what it knows by its type and passes over the rest.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, Protocol

from foxglove_schemas_protobuf.Log_pb2 import Log

from tjscan.core.signals import hold_ctrl_c
from tjscan.recording.foxglove import event_log_message
from tjscan.recording.header import JobSnapshot
from tjscan.recording.reader import RecordedMessage
from tjscan.recording.topic import Topic
from tjscan.recording.writer import NO_ATTACHMENTS, RecordingWriter

LOG_TOPIC: Final = Topic.of("/log", Log)

REPLAY_EVENT: Final = "replay"
"""Name of the event that begins a recording whose estimates or plans were made by a replay."""


@dataclass(frozen=True, slots=True)
class RunEvent:
    """Something that happened in a run.

    Parameters
    ----------
    name : str
        In a word or two, always the same for the same.
    detail : str
        In a sentence, with numbers.
    time : datetime
        When, UTC; of a recorded event as its message has it.
    """

    name: str
    detail: str
    time: datetime = field(default_factory=lambda: datetime.now(UTC), compare=False)

    @classmethod
    def of_log(cls, entry: RecordedMessage) -> RunEvent:
        """The event in a recorded message on `LOG_TOPIC`."""
        return cls(entry.message.name, entry.message.message, entry.when)


class Journal(Protocol):
    """Receives everything of a run at once, in the order it happens."""

    def record(self, message: object) -> None:
        """Take note of a message; one of an unknown type is passed over."""


def event_recorder(journal: Journal) -> Callable[[str, str], None]:
    """Function that records an event by its name and detail, for devices that know no journal."""
    return lambda name, detail: journal.record(RunEvent(name, detail))


class CombinedJournal:
    """Passes everything on to several journals, in their order; without any it drops everything.

    Parameters
    ----------
    *journals : Journal
        The one that writes to disk comes first.
    """

    def __init__(self, *journals: Journal) -> None:
        self._journals = journals

    def record(self, message: object) -> None:
        """Pass a message on."""
        for journal in self._journals:
            journal.record(message)


class RecordingJournal(RecordingWriter):
    """Base of the journals that write a recording; a context manager.

    Parameters
    ----------
    file, topics, origin, attachments
        As of `RecordingWriter`.
    errors : container of str
        Names of the events that are errors to a viewer; the others are information.

    Notes
    -----
    A message has the time of day at which the run began, and what went by on the clock of the
    device since its first reading: a real arm's clock began when it was switched on.
    """

    def __init__(
        self,
        file: Path,
        topics: Iterable[Topic[Any]],
        origin: JobSnapshot | None = None,
        attachments: Mapping[str, bytes] = NO_ATTACHMENTS,
        *,
        errors: Container[str] = (),
    ) -> None:
        super().__init__(file, topics, origin, attachments)
        self._errors = errors
        self._began = self.now = time.time_ns()
        self._first_reading: float | None = None
        self.waiting: list[tuple[int, Topic[Any], Any]] = []

    def __exit__(self, *error: object) -> None:
        try:
            self.flush()
        finally:
            super().__exit__(*error)

    def set_time(self, seconds: float) -> None:
        """Date what follows by a reading of the device's clock, seconds."""
        if self._first_reading is None:
            self._first_reading = seconds
        self.now = self._began + round(1e9 * (seconds - self._first_reading))

    def add(self, topic: Topic[Any], message: Any) -> None:
        """Let a message of now wait for the next `flush`."""
        self.waiting.append((self.now, topic, message))

    def add_event(self, event: RunEvent) -> None:
        """Let an event wait for the next `flush`."""
        level = Log.Level.ERROR if event.name in self._errors else Log.Level.INFO
        self.add(LOG_TOPIC, event_log_message(self.now, level, event.name, event.detail))

    @hold_ctrl_c()
    def flush(self) -> None:
        """Write what waits, in one chunk."""
        waiting, self.waiting = self.waiting, []
        self.write_timed(waiting)
