"""Messages of ``egm.proto`` as bytes: the few rules of protobuf that they need."""

from __future__ import annotations

import struct
from collections.abc import Iterator

WIRE_VARINT, WIRE_DOUBLE, WIRE_MESSAGE = 0, 1, 2  # types of a field on the wire


def varint_field(number: int, value: int) -> bytes:
    """A field that holds a whole number."""
    return _varint(number << 3 | WIRE_VARINT) + _varint(value)


def double_field(number: int, value: float) -> bytes:
    """A field that holds a number."""
    return _varint(number << 3 | WIRE_DOUBLE) + struct.pack("<d", value)


def message_field(number: int, *fields: bytes) -> bytes:
    """A field that holds a message."""
    content = b"".join(fields)
    return _varint(number << 3 | WIRE_MESSAGE) + _varint(len(content)) + content


def read_fields(data: bytes) -> Iterator[tuple[int, int | float | bytes]]:
    """Fields of a message: number and value.

    Raises
    ------
    ValueError
        If it is no message, or has fields of other types.
    """
    at = 0
    while at < len(data):
        key, at = _read_varint(data, at)
        if key & 7 == WIRE_VARINT:
            value, at = _read_varint(data, at)
            yield key >> 3, value
            continue
        length = 8
        if key & 7 == WIRE_MESSAGE:
            length, at = _read_varint(data, at)
        elif key & 7 != WIRE_DOUBLE:
            raise ValueError(f"a field of type {key & 7}")
        if at + length > len(data):
            raise ValueError("it is cut off")
        content, at = data[at : at + length], at + length
        yield key >> 3, content if key & 7 == WIRE_MESSAGE else struct.unpack("<d", content)[0]


def _varint(value: int) -> bytes:
    septets = []
    while value > 127:
        septets.append(value & 127 | 128)
        value >>= 7
    return bytes([*septets, value])


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    value, shift = 0, 0
    while at < len(data) and shift < 70:
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 128:
            return value, at
    raise ValueError("a number is cut off")
