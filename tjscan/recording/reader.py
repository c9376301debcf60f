"""Reading a recording, whole or cut off."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import takewhile
from pathlib import Path
from typing import Any

from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.records import Header as McapHeader

from tjscan.core.errors import ConfigurationError, RecordingError
from tjscan.core.files import check_file_size
from tjscan.recording.header import FORMAT_VERSION, PROGRAM_NAME, JobSnapshot, RecordingHeader
from tjscan.recording.mcap_records import MAX_FILE_BYTES, read_mcap_records
from tjscan.recording.parts import SCAN_RECORDING, neighbouring_parts, recording_files
from tjscan.recording.topic import Topic


@dataclass(frozen=True, slots=True)
class RecordingDamage:
    """A damage of a recording that took messages with it.

    Parameters
    ----------
    file : Path
        The file.
    reason : str
        Where it is, and what is wrong there.
    is_at_end : bool
        Whether nothing was read behind it in this file.
    """

    file: Path
    reason: str
    is_at_end: bool

    def __str__(self) -> str:
        return f"{self.file}: is no recording, or is damaged: {self.reason}"


ReportDamage = Callable[[RecordingDamage], object]
"""Is called with each damage; what it raises ends the reading, else it goes on behind it."""


def refuse_damage(damage: RecordingDamage) -> None:
    """Raise the `RecordingError` of a damage."""
    raise RecordingError(str(damage))


class MessageCount:
    """Notices messages that are missing between those that are read, by their numbers.

    A damage of something else, such as a viewer's index, is none: no message is missing.

    Parameters
    ----------
    file : Path
        The file that is read.
    report : callable
        Is called with each damage.
    """

    def __init__(self, file: Path, report: ReportDamage) -> None:
        self._file, self._report = file, report
        self.expected = 0
        """Number of the next message."""
        self.noticed: list[str] = []
        """Damages since the last message, whose loss the next one shows."""

    def count(self, number: int, *, is_at_end: bool = False) -> None:
        """Take the number of a message that was read, or of the first one in the next file."""
        missing = number - self.expected
        if missing:
            what = f"{missing} messages are missing" if missing > 0 else "messages come twice"
            self.noticed.append(f"{what} before message {number} of the recording")
            self._report_noticed(is_at_end=is_at_end)
        self.expected = number + 1
        self.noticed.clear()

    def end(self, following: RecordingHeader | None) -> None:
        """Take the head of the part that follows this file; None if none does."""
        if following is not None:
            self.count(following.messages_before, is_at_end=True)
        elif self.noticed:
            self._report_noticed(is_at_end=True)

    def _report_noticed(self, *, is_at_end: bool) -> None:
        self._report(RecordingDamage(self._file, "; ".join(self.noticed), is_at_end))


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    """A message read from a recording, with its topic and time.

    Parameters
    ----------
    topic : Topic
        The one that it was written to.
    time : int
        When it was written, nanoseconds since 1970.
    message : object
        What the topic's `decode` made of it.
    """

    topic: Topic[Any]
    time: int
    message: Any

    @property
    def when(self) -> datetime:
        """The same time, UTC."""
        return datetime.fromtimestamp(1e-9 * self.time, UTC)


def read_messages(
    file: Path, topics: Iterable[Topic[Any]], report_damage: ReportDamage = refuse_damage
) -> Iterator[RecordedMessage]:
    """Yield every whole message of the topics asked for, in the order they were written.

    Parameters
    ----------
    file : Path
        The recording; one that was cut off ends where it was cut.
    topics : iterable of Topic
        What to read; others are passed over.
    report_damage : callable
        Is called with each damage that took messages with it; if it returns, the messages behind
        the damage are read. Without it the first damage is refused.

    Raises
    ------
    ConfigurationError
        If there is no such file, or it is too large.
    RecordingError
        If it is no recording of this program, or of a newer version, or is damaged.
    """
    asked = {topic.name: topic for topic in topics}
    schemas: dict[int, str] = {}
    channels: dict[int, Topic[Any] | None] = {}
    count = MessageCount(file, report_damage)
    for record in _read_records(file, count.noticed.append):
        if isinstance(record, RecordingHeader):
            count.expected = record.messages_before
        elif isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            topic = asked.get(record.topic)
            found = (schemas.get(record.schema_id), record.message_encoding)
            if topic is not None and found != (topic.schema_name, topic.message_encoding):
                raise _damage_error(
                    file,
                    f"{topic.name} holds {found[0]} in {found[1]}, not {topic.schema_name} in "
                    f"{topic.message_encoding}",
                )
            channels[record.id] = topic
        elif isinstance(record, Message):
            if record.channel_id not in channels:
                raise _damage_error(
                    file, f"a message on channel {record.channel_id}, which is unknown"
                )
            count.count(record.sequence)
            topic = channels[record.channel_id]
            if topic is not None:
                yield RecordedMessage(
                    topic, record.log_time, _decode_message(file, topic, record.data)
                )
    _, following = neighbouring_parts(file)
    count.end(None if following is None else read_header(following))


def count_messages(file: Path) -> int:
    """How many messages a recording holds in a file and in the parts before it.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does; damages are passed over.
    """
    count = 0
    for record in _read_records(file, lambda _: None):
        if isinstance(record, RecordingHeader):
            count = record.messages_before
        elif isinstance(record, Message):
            count = record.sequence + 1
    return count


def read_header(file: Path) -> RecordingHeader | None:
    """Read the header of a recording; None if the file was cut off before it.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does.
    """
    return next((r for r in _records_before_messages(file) if isinstance(r, RecordingHeader)), None)


def read_job_snapshot(directory: Path, kind: str = SCAN_RECORDING) -> JobSnapshot | None:
    """Read the job snapshot that a run was last recorded with; None if there is none.

    Parameters
    ----------
    directory : Path
        The run directory.
    kind : str
        Of the recording, as `recording_files` has it.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does.
    """
    found = [
        record
        for file in recording_files(directory, kind)
        for record in _records_before_messages(file)
        if isinstance(record, JobSnapshot)
    ]
    return found[-1] if found else None


def _decode_message(file: Path, topic: Topic[Any], data: bytes) -> Any:
    try:
        return topic.decode(data)
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise _damage_error(file, f"a message on {topic.name} can't be read: {error!r}") from error


def _records_before_messages(
    file: Path,
) -> Iterator[McapRecord | RecordingHeader | JobSnapshot]:
    def refuse(reason: str) -> None:
        raise _damage_error(file, reason)

    return takewhile(lambda record: not isinstance(record, Message), _read_records(file, refuse))


def _read_records(
    file: Path, report_damage: Callable[[str], object]
) -> Iterator[McapRecord | RecordingHeader | JobSnapshot]:
    """The records of a recording of this program, its header before all but MCAP's own."""
    try:
        check_file_size(file, MAX_FILE_BYTES, "a recording")
        with file.open("rb") as stream:
            header = None
            for record in read_mcap_records(stream, report_damage):
                if isinstance(record, McapHeader):
                    _check_program(file, record)
                elif header is None:
                    name = record.name if isinstance(record, Metadata) else ""
                    if name != RecordingHeader.record_name:
                        raise ValueError("its head is missing")
                    header = RecordingHeader.from_metadata(record.metadata)
                    _check_format(file, header)
                    yield header
                elif isinstance(record, Metadata):
                    if record.name != JobSnapshot.record_name:
                        raise ValueError(f"its head holds {record.name!r}, which no version writes")
                    yield JobSnapshot.from_metadata(record.metadata)
                yield record
    except FileNotFoundError:
        raise ConfigurationError(
            "there is no recording; name a run directory that holds one, or its file", file=file
        ) from None
    except OSError as error:
        raise RecordingError(f"{file}: can't be read: {error.strerror}") from error
    except ValueError as error:
        raise _damage_error(file, error) from error


def _check_program(file: Path, header: McapHeader) -> None:
    if header.profile != PROGRAM_NAME:
        made = header.library or "an unnamed program"
        raise RecordingError(
            f"{file}: was recorded by another program: {made}, profile {header.profile!r}. "
            f"Only recordings of {PROGRAM_NAME} can be read"
        )


def _check_format(file: Path, head: RecordingHeader) -> None:
    if head.format < 1:
        raise _damage_error(file, f"its format is {head.format}")
    if head.format > FORMAT_VERSION:
        raise RecordingError(
            f"{file}: was recorded by {PROGRAM_NAME} {head.version} in format {head.format}; this "
            f"version reads format {FORMAT_VERSION} only. Install {PROGRAM_NAME} {head.version} "
            "or newer"
        )


def _damage_error(file: Path, why: object) -> RecordingError:
    return RecordingError(str(RecordingDamage(file, str(why), is_at_end=False)))
