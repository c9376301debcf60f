"""GVSP, GigE Vision's stream: a block of data as a leader, payload packets and a trailer.

All numbers of the protocol are big-endian; what the payload holds is the sensor's affair.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from struct import Struct
from typing import Final

from tjscan_loopback.laser.gvcp import Status

PACKET_HEADER: Final = Struct(">HHI")
"""Status, number of the block, and in one number the kind of packet and its number."""

LEADER_FIELDS: Final = Struct(">HHQIIIIIHH")
TRAILER_FIELDS: Final = Struct(">HHI")
CHUNK_FIELDS: Final = Struct(">II")

LEADER_PACKET, TRAILER_PACKET, DATA_PACKET = 1, 2, 3

IMAGE_CHUNK: Final = 1
"""Number of the chunk that holds the points."""

IMAGE_PAYLOAD: Final = 0x0001
IMAGE_WITH_CHUNKS: Final = 0x4001

HEADER_BYTES: Final = 20 + 8 + PACKET_HEADER.size
"""Bytes of a packet's size that are headers: IP, UDP and the packet's own."""


@dataclass(frozen=True, slots=True)
class StreamBlock:
    """One block: what a trigger brings.

    Parameters
    ----------
    number : int
        From 1 to 65535, then from 1 again.
    time : int
        Device time of the exposure, in ticks.
    pixel_format : int
        Its code.
    width, height : int
        Points in a row, and rows.
    data : bytes
        The points.
    chunks : sequence of (int, bytes)
        Number and content, not empty, of each chunk behind the points; none without chunk mode.
    """

    number: int
    time: int
    pixel_format: int
    width: int
    height: int
    data: bytes
    chunks: Sequence[tuple[int, bytes]] = ()


def pack_block(block: StreamBlock, packet_size: int) -> list[bytes]:
    """Pack a block into datagrams: leader, payload, trailer.

    Parameters
    ----------
    block : StreamBlock
    packet_size : int
        Largest IP packet in bytes, headers included.
    """
    payload_type = IMAGE_WITH_CHUNKS if block.chunks else IMAGE_PAYLOAD
    leader = LEADER_FIELDS.pack(
        0,
        payload_type,
        block.time,
        block.pixel_format,
        block.width,
        block.height,
        *(0, 0),
        *(0, 0),
    )
    data = block.data
    if block.chunks:
        # Read from the end: behind its content are the number and length of each chunk.
        for number, content in ((IMAGE_CHUNK, b""), *block.chunks):
            data += content + CHUNK_FIELDS.pack(number, len(content or block.data))
    room = max(packet_size - HEADER_BYTES, 1)
    pieces = [data[i : i + room] for i in range(0, len(data), room)]
    trailer = TRAILER_FIELDS.pack(0, payload_type, block.height)
    kinds = [LEADER_PACKET, *[DATA_PACKET] * len(pieces), TRAILER_PACKET]
    contents = [leader, *pieces, trailer]
    return [
        PACKET_HEADER.pack(Status.SUCCESS, block.number, kind << 24 | i) + content
        for i, (kind, content) in enumerate(zip(kinds, contents, strict=True))
    ]


def unavailable_packet(block: int, packet: int) -> bytes:
    """Packet in the place of one that is asked for again, and no longer there."""
    return PACKET_HEADER.pack(Status.PACKET_UNAVAILABLE, block, DATA_PACKET << 24 | packet)


def kind_of_packet(packet: bytes) -> int:
    """Whether it is a leader, a trailer or data; 0 if it is none of these."""
    return packet[4] if len(packet) >= PACKET_HEADER.size else 0
