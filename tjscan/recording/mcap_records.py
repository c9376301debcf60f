"""The records of an MCAP file, one after another, as far as they are whole."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from io import BytesIO
from typing import BinaryIO, Final

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, Footer, McapRecord
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

_HEAD: Final = struct.Struct("<BQ")  # opcode, and length of what follows
_FOOTER: Final = _HEAD.pack(Opcode.FOOTER, 20) + bytes(20) + MCAP0_MAGIC

MAX_FILE_BYTES: Final = 2_000_000_000
"""A larger file is no recording: an hour of scanning takes a tenth of it."""

MAX_RECORD_BYTES: Final = 16_000_000
"""Bytes of the largest record that is read; a profile of 640 points takes some 20 000."""

_READ: Final = frozenset(
    (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA)
)
"""What is read; the rest is passed over."""


def read_mcap_records(stream: BinaryIO) -> Iterator[McapRecord]:
    """Yield the whole records of a file, those inside its chunks too; where it was cut, it ends.

    Parameters
    ----------
    stream : file
        Open for reading, at its beginning.

    Raises
    ------
    ValueError
        If it is no such file, or is damaged elsewhere than at its end.

    Notes
    -----
    `mcap.stream_reader` parses the records, but one at a time: over a whole file it would yield
    the last message of a file that was cut as if it were complete, and would believe every
    length that it reads. Here a length is believed only as far as the file goes, so no record
    takes more memory than it takes of the file.
    """
    size = os.fstat(stream.fileno()).st_size
    magic = stream.read(len(MCAP0_MAGIC))
    if not MCAP0_MAGIC.startswith(magic):
        raise ValueError("it does not begin as an MCAP file does")
    while len(head := stream.read(_HEAD.size)) == _HEAD.size:
        opcode, length = _HEAD.unpack(head)
        place = stream.tell()
        if opcode == 0 and _only_zeros(head, stream):
            return  # what a machine that lost its power leaves behind the last whole record
        if length > size - place or opcode == Opcode.DATA_END:
            return
        if opcode not in _READ:
            stream.seek(length, os.SEEK_CUR)
            continue
        if length > MAX_RECORD_BYTES:
            raise ValueError(f"at byte {place} is a record of {length} bytes: none is so long")
        try:
            yield from _parse(head + stream.read(length))
        except (struct.error, ValueError, OverflowError, McapError) as error:
            raise ValueError(f"the record at byte {place} is damaged: {error}") from error


def _parse(record: bytes) -> Iterator[McapRecord]:
    """The record, or those in it where it is a chunk; a footer behind it ends the reading."""
    stream = BytesIO(record + _FOOTER)
    for one in StreamReader(stream, skip_magic=True, emit_chunks=True).records:
        if isinstance(one, Chunk):
            if one.compression:
                raise ValueError(
                    f"it is compressed by {one.compression}; `mcap decompress` makes a file of it "
                    "that can be read"
                )
            yield from breakup_chunk(one, validate_crc=True)
        elif not isinstance(one, Footer):
            yield one


def _only_zeros(head: bytes, stream: BinaryIO) -> bool:
    """Whether the rest of a file is zeros, the nine bytes just read included."""
    blocks = iter(lambda: stream.read(1 << 16), b"")
    return not any(head) and not any(any(block) for block in blocks)
