"""The records of an MCAP file, one after another, as far as they are whole."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import BytesIO
from typing import BinaryIO, Final
from zlib import crc32

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, Footer, McapRecord
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

_RECORD_HEAD: Final = struct.Struct("<BQ")  # opcode, and length of what follows
_CHUNK_HEAD: Final = struct.Struct("<QQQIIQ")  # times, size, CRC, length of compression, size
_END_OF_FILE: Final = _RECORD_HEAD.pack(Opcode.FOOTER, 20) + bytes(20) + MCAP0_MAGIC
_DATA_END_LENGTH: Final = 4

_CHUNK_START: Final = re.compile(
    rb"\x06(?=.{3}\x00{5}.{16}.{3}\x00{5}.{4}\x00{4}.{3}\x00{5})", re.DOTALL
)
"""An uncompressed chunk of less than 16 MB."""

MAX_FILE_BYTES: Final = 2_000_000_000
"""A larger file is no recording: an hour of scanning takes a tenth of it."""

MAX_RECORD_BYTES: Final = 16_000_000
"""Bytes of the largest record that is read; a profile of 640 points takes some 20 000."""

_BLOCK_BYTES: Final = 1 << 20

_KINDS_READ: Final = frozenset(
    (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA)
)
"""Kinds of records that are read."""

_KINDS_SKIPPED: Final = frozenset((Opcode.ATTACHMENT, Opcode.MESSAGE_INDEX))
"""Kinds of records for viewers. Nothing else is in a file before the end of its data."""


class _CutOff(Exception):
    """The file ends within a record."""


_RECORD_ERRORS: Final = (_CutOff, struct.error, ValueError, OverflowError, McapError)
"""Errors of a record that is cut off or damaged."""


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
            whole = _next_chunk(stream, place + 1, size)
            if not (isinstance(error, _CutOff) and whole is None and not finished):
                reason = "the file ends in it" if isinstance(error, _CutOff) else error
                report_damage(f"the record at byte {place} is damaged: {reason}")
            if whole is None:
                return
            place = whole
            continue
        if records is None:
            return
        yield from records
        place += _RECORD_HEAD.size + length


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
    head = stream.read(_RECORD_HEAD.size)
    if len(head) < _RECORD_HEAD.size:
        raise _CutOff
    opcode, length = _RECORD_HEAD.unpack(head)
    if opcode == 0 and _only_zeros(head, stream):
        raise _CutOff  # what a machine that lost its power leaves behind the last whole record
    if opcode == Opcode.DATA_END and length == _DATA_END_LENGTH:
        return length, None
    if opcode not in _KINDS_READ | _KINDS_SKIPPED:
        raise ValueError(f"its kind is {opcode}, which does not belong there")
    if length > size - place - _RECORD_HEAD.size:
        _check_cut_chunk(opcode, length, stream)
        raise _CutOff
    if opcode in _KINDS_SKIPPED:
        return length, []
    if length > MAX_RECORD_BYTES:
        raise ValueError(f"it has {length} bytes: none is so long")
    return length, _parse_record(head + stream.read(length))


def _check_cut_chunk(opcode: int, length: int, stream: BinaryIO) -> None:
    """Refuse the beginning of a chunk that states two lengths."""
    head = stream.read(_CHUNK_HEAD.size)
    if opcode != Opcode.CHUNK or len(head) < _CHUNK_HEAD.size:
        return
    *_, size, _, compressed, stored = _CHUNK_HEAD.unpack(head)
    if compressed or not size == stored == length - _CHUNK_HEAD.size:
        raise ValueError("it states lengths that contradict each other")


def _parse_record(record: bytes) -> list[McapRecord]:
    """The record, or the records in it if it is a chunk; a footer behind it ends the reading."""
    found: list[McapRecord] = []
    stream = BytesIO(record + _END_OF_FILE)
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


def _next_chunk(stream: BinaryIO, place: int, size: int) -> int | None:
    """Place of the next whole chunk; None if there is none."""
    while place < size:
        stream.seek(place)
        block = stream.read(_BLOCK_BYTES + _RECORD_HEAD.size + _CHUNK_HEAD.size)
        for match in _CHUNK_START.finditer(block):
            start = place + match.start()
            with suppress(*_RECORD_ERRORS):
                _read_record(stream, start, size)
                return start
        place += _BLOCK_BYTES
    return None


def _only_zeros(head: bytes, stream: BinaryIO) -> bool:
    """Whether the rest of a file is zeros, the nine bytes just read included."""
    blocks = iter(lambda: stream.read(1 << 16), b"")
    return not any(head) and not any(any(block) for block in blocks)
