"""Reading a recording, whole or cut off: the records of its MCAP files, then its messages."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from io import BytesIO
from itertools import chain, takewhile
from pathlib import Path
from typing import Any, BinaryIO, Final
from zlib import crc32

from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata, Schema, Statistics
from mcap.records import Header as McapHeader
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from tjscan.core.errors import ConfigurationError, RecordingError
from tjscan.core.files import check_file_size
from tjscan.recording.header import FORMAT_VERSION, PROGRAM_NAME, JobSnapshot, RecordingHeader
from tjscan.recording.parts import SCAN_RECORDING_KIND, neighbouring_parts, recording_files
from tjscan.recording.topic import Topic

_RECORD_LAYOUT: Final = struct.Struct("<BQ")  # opcode, and length of what follows
_CHUNK_LAYOUT: Final = struct.Struct("<QQQIIQ")  # times, size, CRC, length of compression, size
_FILE_FOOTER_BYTES: Final = _RECORD_LAYOUT.pack(Opcode.FOOTER, 20) + bytes(20) + MCAP0_MAGIC
_DATA_END_LENGTH: Final = 4
_CHECKSUM_BYTES: Final = 4

_CHUNK_START_PATTERN: Final = re.compile(
    rb"\x06(?=.{3}\x00{5}.{16}.{3}\x00{5}.{4}\x00{4}.{3}\x00{5})", re.DOTALL
)
"""An uncompressed chunk of less than 16 MB."""

OLD_RECORDING_ADVICE: Final = (
    "Recordings of versions before 0.1.0 can't be read: use the results beside it, or record again"
)
"""Formats 1, 2 and 3 of those versions were never released: the first has no head, all state
version 0.1.0, and none has the schemas that are named after dataclasses."""

MAX_FILE_BYTES: Final = 2_000_000_000
"""A larger file is no recording: an hour of scanning takes a tenth of it."""

MAX_RECORD_BYTES: Final = 16_000_000
"""Bytes of the largest record that is read; a profile of 640 points takes some 20 000."""

_SEARCH_BLOCK_BYTES: Final = 1 << 20

_RECORD_KINDS_READ: Final = frozenset(
    (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA)
)
"""Kinds of records that are read."""

_RECORD_KINDS_SKIPPED: Final = frozenset((Opcode.ATTACHMENT, Opcode.MESSAGE_INDEX))
"""Kinds of records for viewers. Nothing else is in a file before the end of its data."""


class _CutOffError(Exception):
    """The file ends within a record."""


_RECORD_ERRORS: Final = (_CutOffError, struct.error, ValueError, OverflowError, McapError)
"""Errors of a record that is cut off or damaged."""

_MESSAGE_ERRORS: Final = (
    KeyError,
    ValueError,
    TypeError,
    OverflowError,
    RecursionError,
    DecodeError,
)
"""Errors of bytes that are no message of a topic."""


def read_mcap_records(
    stream: BinaryIO, report_damage: Callable[[str], object]
) -> Iterator[McapRecord]:
    """Yield the whole records of a file, those inside its chunks too, as far as it was not cut.

    Parameters
    ----------
    stream : file
        Open for reading, at its beginning.
    report_damage : callable
        Is called with the place and the kind of each damage; what it raises ends the reading,
        else the next whole chunk behind the damage is read next.

    Raises
    ------
    ValueError
        If it is no such file.

    Notes
    -----
    `mcap.stream_reader` parses the records, but one at a time: over a whole file it would yield
    the last message of a file that was cut as if it were complete, would trust every length that
    it reads, and pass over a chunk whose kind was changed by a flipped bit. Here a length is
    trusted only as far as the file goes, so no record takes more memory than it takes of the
    file; and a file counts as cut off only if no whole chunk follows and its end is missing.
    """
    size = os.fstat(stream.fileno()).st_size
    magic = stream.read(len(MCAP0_MAGIC))
    if not MCAP0_MAGIC.startswith(magic):
        raise ValueError("it does not begin as an MCAP file does")
    place = len(MCAP0_MAGIC)
    stream.seek(max(place, size - place))
    finished = stream.read() == bytes(MCAP0_MAGIC)  # as a closed file ends
    while True:
        try:
            length, records = _read_record(stream, place, size)
        except _RECORD_ERRORS as error:
            whole = _find_chunk(stream, place + 1, size)
            if not (isinstance(error, _CutOffError) and whole is None and not finished):
                reason = "the file ends in it" if isinstance(error, _CutOffError) else error
                report_damage(f"the record at byte {place} is damaged: {reason}")
            if whole is None:
                return
            place = whole
            continue
        if records is None:
            yield from _read_statistics(stream, place + _RECORD_LAYOUT.size + length)
            return
        yield from records
        place += _RECORD_LAYOUT.size + length


def _read_record(stream: BinaryIO, place: int, size: int) -> tuple[int, list[McapRecord] | None]:
    """Length of the record at a place, and the records in it; None at the end of the data.

    Raises
    ------
    _CutOff
        If the file ends in the record, and what there is of it is as it should be.
    struct.error, ValueError, OverflowError, McapError
        If it is damaged.
    """
    stream.seek(place)
    head = stream.read(_RECORD_LAYOUT.size)
    if len(head) < _RECORD_LAYOUT.size:
        raise _CutOffError
    opcode, length = _RECORD_LAYOUT.unpack(head)
    if opcode == 0 and _is_rest_zeros(head, stream):
        raise _CutOffError  # what a machine that lost its power leaves behind the last whole record
    if opcode == Opcode.DATA_END and length == _DATA_END_LENGTH:
        return length, None
    if opcode not in _RECORD_KINDS_READ | _RECORD_KINDS_SKIPPED:
        raise ValueError(f"its kind is {opcode}, which does not belong there")
    if length > size - place - _RECORD_LAYOUT.size:
        _check_cut_chunk(opcode, length, stream)
        raise _CutOffError
    if opcode in _RECORD_KINDS_SKIPPED:
        return length, []
    if length > MAX_RECORD_BYTES:
        raise ValueError(f"it has {length} bytes: none is so long")
    return length, _parse_record(head + stream.read(length))


def _read_statistics(stream: BinaryIO, place: int) -> Iterator[Statistics]:
    """What a finished file states of itself behind its data, if that is whole."""
    stream.seek(place)
    summary = stream.read(MAX_RECORD_BYTES)
    stated = summary[-len(MCAP0_MAGIC) - _CHECKSUM_BYTES : -len(MCAP0_MAGIC)]
    if crc32(summary[: -len(MCAP0_MAGIC) - _CHECKSUM_BYTES]) != int.from_bytes(stated, "little"):
        return  # or no summary, or one too long
    with suppress(*_RECORD_ERRORS):
        for record in StreamReader(BytesIO(summary), skip_magic=True).records:
            if isinstance(record, Statistics):
                yield record


def _check_cut_chunk(opcode: int, length: int, stream: BinaryIO) -> None:
    """Refuse the beginning of a chunk that states two lengths."""
    head = stream.read(_CHUNK_LAYOUT.size)
    if opcode != Opcode.CHUNK or len(head) < _CHUNK_LAYOUT.size:
        return
    *_, size, _, compressed, stored = _CHUNK_LAYOUT.unpack(head)
    if compressed or not size == stored == length - _CHUNK_LAYOUT.size:
        raise ValueError("it states lengths that contradict each other")


def _parse_record(record: bytes) -> list[McapRecord]:
    """The record, or the records in it if it is a chunk; a footer behind it ends the reading."""
    found: list[McapRecord] = []
    stream = BytesIO(record + _FILE_FOOTER_BYTES)
    for one in StreamReader(stream, skip_magic=True, emit_chunks=True).records:
        if isinstance(one, Chunk):
            found += _records_of_chunk(one)
        elif not isinstance(one, Footer):
            found.append(one)
    return found


def _records_of_chunk(chunk: Chunk) -> list[McapRecord]:
    if chunk.compression:
        raise ValueError(
            f"it is compressed by {chunk.compression}; `mcap decompress` makes a file of it that "
            "can be read"
        )
    if chunk.uncompressed_size != len(chunk.data):
        raise ValueError("it states lengths that contradict each other")
    if crc32(chunk.data) != chunk.uncompressed_crc:
        raise ValueError("its checksum is another")
    return list(breakup_chunk(chunk))


def _find_chunk(stream: BinaryIO, place: int, size: int) -> int | None:
    """Place of the next whole chunk; None if there is none."""
    while place < size:
        stream.seek(place)
        block = stream.read(_SEARCH_BLOCK_BYTES + _RECORD_LAYOUT.size + _CHUNK_LAYOUT.size)
        for match in _CHUNK_START_PATTERN.finditer(block):
            start = place + match.start()
            with suppress(*_RECORD_ERRORS):
                _read_record(stream, start, size)
                return start
        place += _SEARCH_BLOCK_BYTES
    return None


def _is_rest_zeros(head: bytes, stream: BinaryIO) -> bool:
    """Whether the rest of a file is zeros, the nine bytes just read included."""
    blocks = iter(lambda: stream.read(1 << 16), b"")
    return not any(head) and not any(any(block) for block in blocks)


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


def raise_damage_error(damage: RecordingDamage) -> None:
    """Raise the `RecordingError` of a damage."""
    raise RecordingError(str(damage))


class MissingMessages:
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
        self.stated = 0
        """Number behind the last message, as a finished file states it; a part that follows goes
        on behind what was left when it began, as after any damage of an end."""
        self.noticed: list[str] = []
        """Damages since the last message, whose loss the next one shows."""

    def count_message(self, number: int, *, is_at_end: bool = False) -> None:
        """Take the number of a message that was read, or of the first one in the next file."""
        missing = number - self.expected
        if missing:
            what = f"{missing} messages are missing" if missing > 0 else "messages come twice"
            self.noticed.append(f"{what} before message {number} of the recording")
            self._report_noticed(is_at_end=is_at_end)
        self.expected = number + 1
        self.noticed.clear()

    def end_file(self, following: RecordingHeader | None) -> None:
        """Take the head of the part that follows this file; None if none does."""
        if following is not None:
            self.count_message(following.messages_before, is_at_end=True)
            return
        if (missing := self.stated - self.expected) > 0:
            self.noticed.append(f"{missing} messages are missing at its end")
        if self.noticed:
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
    file: Path, topics: Iterable[Topic[Any]], report_damage: ReportDamage = raise_damage_error
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
    count, before = MissingMessages(file, report_damage), 0
    for record in _read_records(file, count.noticed.append):
        if isinstance(record, RecordingHeader):
            count.expected = before = record.messages_before
        elif isinstance(record, Statistics):
            count.stated = before + record.message_count
        elif isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            topic = asked.get(record.topic)
            found = (schemas.get(record.schema_id), record.message_encoding)
            if topic is not None and found != (topic.schema_name, topic.message_encoding):
                raise _damage_error(
                    file,
                    f"{topic.name} holds {found[0]} in {found[1]}, not {topic.schema_name} in "
                    f"{topic.message_encoding}. {OLD_RECORDING_ADVICE}",
                )
            channels[record.id] = topic
        elif isinstance(record, Message):
            if record.channel_id not in channels:
                why = f"a message on channel {record.channel_id}, which is unknown"
                raise _damage_error(file, why)
            count.count_message(record.sequence)
            topic = channels[record.channel_id]
            if topic is not None:
                content = _decode_message(file, topic, record.data)
                yield RecordedMessage(topic, record.log_time, content)
    _, following = neighbouring_parts(file)
    count.end_file(None if following is None else read_header(following))


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


def when_recording_began(file: Path) -> datetime | None:
    """When the first message of a recording was taken, UTC; None if there is none to read."""
    with file.open("rb") as stream, suppress(ValueError):
        for record in read_mcap_records(stream, lambda _: None):
            if isinstance(record, Message):
                return datetime.fromtimestamp(1e-9 * record.log_time, UTC)
    return None


def read_header(file: Path) -> RecordingHeader | None:
    """Read the header of a recording; None if the file was cut off before it.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does.
    """
    return next((r for r in _records_before_messages(file) if isinstance(r, RecordingHeader)), None)


def read_job_snapshot(directory: Path, kind: str = SCAN_RECORDING_KIND) -> JobSnapshot | None:
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
    heads = map(_records_before_messages, recording_files(directory, kind))
    records = chain.from_iterable(heads)
    found = [record for record in records if isinstance(record, JobSnapshot)]
    return found[-1] if found else None


def _decode_message(file: Path, topic: Topic[Any], data: bytes) -> Any:
    try:
        return topic.decode(data)
    except _MESSAGE_ERRORS as error:
        raise _damage_error(file, f"a message on {topic.name} can't be read: {error!r}") from error


def _records_before_messages(file: Path) -> Iterator[McapRecord | RecordingHeader | JobSnapshot]:
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
                        raise ValueError(f"its head is missing. {OLD_RECORDING_ADVICE}")
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
    if head.format != FORMAT_VERSION:
        newer = f"Install {PROGRAM_NAME} {head.version} or newer"
        advice = OLD_RECORDING_ADVICE if head.version == "0.1.0" else newer
        raise RecordingError(
            f"{file}: was recorded by {PROGRAM_NAME} {head.version} in format {head.format}; this "
            f"version reads format {FORMAT_VERSION} only. {advice}"
        )


def _damage_error(file: Path, why: object) -> RecordingError:
    return RecordingError(str(RecordingDamage(file, str(why), is_at_end=False)))
