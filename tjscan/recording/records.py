"""The records of an MCAP file, one after another, as far as they are whole."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from io import BytesIO
from typing import BinaryIO, Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Metadata

MAGIC: Final = b"\x89MCAP0\r\n"
_HEAD: Final = struct.Struct("<BQ")  # opcode, and length of what follows

MOST_BYTES: Final = 2_000_000_000
"""A larger file is no recording: an hour of scanning takes a tenth of it."""

MOST_RECORD: Final = 16_000_000
"""Bytes of the largest record that is read; a profile of 640 points takes some 30 000."""


def read_records(stream: BinaryIO) -> Iterator[Channel | Message | Metadata]:
    """Yield the whole records of a file; where it was cut off, it ends.

    A length is believed only as far as the file goes, so no record takes more memory than it
    takes of the file.

    Parameters
    ----------
    stream : file
        Open for reading, at its beginning.

    Raises
    ------
    ValueError
        If it is no such file, or is damaged elsewhere than at its end.
    """
    size = os.fstat(stream.fileno()).st_size
    magic = stream.read(len(MAGIC))
    if not MAGIC.startswith(magic):
        raise ValueError("it does not begin as an MCAP file does")
    while len(head := stream.read(_HEAD.size)) == _HEAD.size:
        opcode, length = _HEAD.unpack(head)
        place = stream.tell()
        if opcode == 0 and _only_zeros(head, stream):
            return  # what a machine that lost its power leaves behind the last whole record
        if length > size - place or opcode == Opcode.DATA_END:
            return
        if opcode == Opcode.CHUNK:
            raise ValueError("its messages are in chunks; a scan records none")
        kind = _KINDS.get(opcode)
        if kind is None:
            stream.seek(length, os.SEEK_CUR)
            continue
        if length > MOST_RECORD:
            raise ValueError(f"at byte {place} is a record of {length} bytes: no scan records it")
        try:
            yield kind(stream.read(length))
        except (struct.error, ValueError, McapError) as error:
            raise ValueError(f"the record at byte {place} is damaged: {error}") from error


def _channel(data: bytes) -> Channel:
    return Channel.read(ReadDataStream(BytesIO(data)))


def _message(data: bytes) -> Message:
    return Message.read(ReadDataStream(BytesIO(data)), len(data))


def _metadata(data: bytes) -> Metadata:
    return Metadata.read(ReadDataStream(BytesIO(data)))


_KINDS: Final = {
    Opcode.CHANNEL.value: _channel,
    Opcode.MESSAGE.value: _message,
    Opcode.METADATA.value: _metadata,
}
"""What is read; the rest is passed over."""


def _only_zeros(head: bytes, stream: BinaryIO) -> bool:
    """Whether the rest of a file is zeros, the nine bytes just read included."""
    blocks = iter(lambda: stream.read(1 << 16), b"")
    return not any(head) and not any(any(block) for block in blocks)
