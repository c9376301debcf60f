"""Writing a recording: what is written together reaches the file at once, whole or not at all."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Self

from mcap.writer import CompressionType, Writer

from tjscan.core.errors import RecordingError
from tjscan.core.files import bring_stream_to_disk
from tjscan.core.signals import hold_ctrl_c
from tjscan.recording.header import PROGRAM_NAME, JobSnapshot, RecordingHeader
from tjscan.recording.parts import neighbouring_parts
from tjscan.recording.reader import count_messages
from tjscan.recording.topic import Topic

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
    """

    def __init__(
        self,
        file: Path,
        topics: Iterable[Topic[Any]],
        origin: JobSnapshot | None = None,
        attachments: Mapping[str, bytes] = NO_ATTACHMENTS,
    ) -> None:
        self._file, self._topics = file, tuple(topics)
        self._origin, self._attachments = origin, attachments

    @hold_ctrl_c()
    def __enter__(self) -> Self:
        try:
            self._stream = self._file.open("xb")
            self._write_head()
        except OSError as error:
            raise self._write_error(error) from error
        return self

    @hold_ctrl_c()
    def __exit__(self, *error: object) -> None:
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

    @hold_ctrl_c()
    def write_timed(self, messages: Iterable[tuple[int, Topic[Any], Any]]) -> None:
        """Write messages of several times in one chunk; each with its time, as `write` has it."""
        for time, topic, message in messages:
            self._writer.add_message(
                self._channels[topic.name],
                log_time=time,
                publish_time=time,
                sequence=self._count,
                data=topic.encode(message),
            )
            self._count += 1
        try:
            self._writer.flush()
        except OSError as error:
            raise self._write_error(error) from error

    def sync_to_disk(self) -> None:
        """Bring everything written so far to the disk."""
        try:
            bring_stream_to_disk(self._stream)
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
