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
from types import MappingProxyType
from typing import Any, Final, Protocol, Self

from foxglove_schemas_protobuf.Log_pb2 import Log
from mcap.writer import CompressionType, Writer

from tjscan.core.errors import RecordingError
from tjscan.core.files import sync_stream_to_disk
from tjscan.core.signals import delay_ctrl_c
from tjscan.recording.foxglove import event_log_message
from tjscan.recording.header import PROGRAM_NAME, JobSnapshot, RecordingHeader
from tjscan.recording.parts import neighbouring_parts
from tjscan.recording.reader import RecordedMessage, count_messages
from tjscan.recording.topic import Topic

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


NO_ATTACHMENTS: Final[Mapping[str, bytes]] = MappingProxyType({})


class RecordingWriter:
    """Writes one file of a recording; a context manager.

    Parameters
    ----------
    file : Path
        Must not exist yet.
    topics : iterable of Topic
        What will be written.
    origin : JobSnapshot, optional
        What it is made with.
    attachments : mapping of str to bytes, optional
        Files that a viewer needs beside the messages, by name: the arm's URDF.
    errors : container of str
        Names of the events that are errors to a viewer; the others are information.

    Raises
    ------
    RecordingError
        On entering or writing, if the file can't be written; on entering, if the part before it
        can't be read.

    Notes
    -----
    The file is chunked, as viewers demand, and each chunk is one call of `write`: a reader finds
    the messages that were written together all there, or none of them. A chunk has a checksum,
    and messages are numbered through all parts of a recording, so that none can be missing or
    changed without being noticed.

    A message that waits for `flush` has the time of day at which the run began, and what went by on
    the clock of the device since its first reading: a real arm's clock began when it was switched
    on.
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
        self._file, self._topics = file, tuple(topics)
        self._origin, self._attachments, self._errors = origin, attachments, errors
        self._began = self.now = time.time_ns()
        self._first_reading: float | None = None
        self.waiting: list[tuple[int, Topic[Any], Any]] = []

    @delay_ctrl_c()
    def __enter__(self) -> Self:
        try:
            self._stream = self._file.open("xb")
            self._write_head()
        except OSError as error:
            raise self._write_error(error) from error
        return self

    @delay_ctrl_c()
    def __exit__(self, *error: object) -> None:
        try:
            if self.waiting:
                self.flush()
        finally:
            try:
                self._writer.finish()
                self.sync_to_disk()
                self._stream.close()
            except OSError as full:
                if not any(error):
                    raise self._write_error(full) from full

    def write(self, time: int, *messages: tuple[Topic[Any], Any]) -> None:
        """Write messages that belong together, in one chunk.

        Parameters
        ----------
        time : int
            When they were taken, nanoseconds since 1970.
        *messages : (Topic, object)
            Each message and its topic.
        """
        self.write_timed((time, topic, message) for topic, message in messages)

    @delay_ctrl_c()
    def write_timed(self, messages: Iterable[tuple[int, Topic[Any], Any]]) -> None:
        """Write messages of several times in one chunk; each with its time, as `write` has it."""
        for at, topic, message in messages:
            channel, data = self._channels[topic.name], topic.encode(message)
            self._writer.add_message(channel, at, data, publish_time=at, sequence=self._count)
            self._count += 1
        try:
            self._writer.flush()
        except OSError as error:
            raise self._write_error(error) from error

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

    @delay_ctrl_c()
    def flush(self) -> None:
        """Write what waits, in one chunk."""
        waiting, self.waiting = self.waiting, []
        self.write_timed(waiting)

    def sync_to_disk(self) -> None:
        """Bring everything written so far to the disk."""
        try:
            sync_stream_to_disk(self._stream)
        except OSError as error:
            raise self._write_error(error) from error

    def _write_head(self) -> None:
        """Write everything before the first message."""
        self._writer = Writer(self._stream, compression=CompressionType.NONE, enable_data_crcs=True)
        before, _ = neighbouring_parts(self._file)
        self._count = 0 if before is None else count_messages(before)
        head = RecordingHeader(messages_before=self._count)
        self._writer.start(profile=PROGRAM_NAME, library=f"{PROGRAM_NAME} {head.version}")
        self._writer.add_metadata(head.record_name, head.metadata)
        if self._origin is not None:
            self._writer.add_metadata(self._origin.record_name, self._origin.metadata)
        for name, data in self._attachments.items():
            self._writer.add_attachment(0, 0, name, "application/octet-stream", data)
        self._channels: dict[str, int] = {}
        for topic in self._topics:
            name, encoding = topic.name, topic.message_encoding
            language = "jsonschema" if encoding == "json" else encoding
            schema = self._writer.register_schema(topic.schema_name, language, topic.schema_bytes)
            self._channels[name] = self._writer.register_channel(name, encoding, schema)
        self._writer.flush()

    def _write_error(self, error: OSError) -> RecordingError:
        return RecordingError(
            f"{self._file}: can't be written: {error.strerror}. What was written before is whole."
        )
