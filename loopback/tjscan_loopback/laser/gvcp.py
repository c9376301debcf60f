"""GVCP, GigE Vision's control protocol, on the wire: commands, acknowledgements, status codes.

All numbers are big-endian. A command is 0x42, flags, its kind, the length of what follows, and a
number that the acknowledgement repeats. The layout follows open implementations (aravis,
Wireshark's dissector): the standard itself is licensed.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import Final

GVCP_PORT: Final = 3956

COMMAND_HEADER: Final = Struct(">BBHHH")
REPLY_HEADER: Final = Struct(">HHHH")

COMMAND_KEY: Final = 0x42
ASK_ACKNOWLEDGEMENT: Final = 0x01

MOST_MEMORY: Final = 536
"""Bytes that one READMEM or WRITEMEM carries."""


class Command(IntEnum):
    """Kind of a command; the kind of its acknowledgement is greater by one."""

    DISCOVERY = 0x0002
    PACKETRESEND = 0x0040
    READREG = 0x0080
    WRITEREG = 0x0082
    READMEM = 0x0084
    WRITEMEM = 0x0086


class Status(IntEnum):
    """What an acknowledgement states about its command, and a packet of the stream about itself."""

    SUCCESS = 0x0000
    NOT_IMPLEMENTED = 0x8001
    INVALID_PARAMETER = 0x8002
    INVALID_ADDRESS = 0x8003
    WRITE_PROTECTED = 0x8004
    ACCESS_DENIED = 0x8006
    PACKET_UNAVAILABLE = 0x800C


@dataclass(frozen=True, slots=True)
class GvcpCommand:
    """A command that arrived.

    Parameters
    ----------
    kind : int
        One of `Command`, or another number.
    number : int
        What its acknowledgement repeats.
    payload : bytes
        What follows the header.
    acknowledged : bool
        Whether the client wants an acknowledgement.
    """

    kind: int
    number: int
    payload: bytes
    acknowledged: bool


def parse_command(datagram: bytes) -> GvcpCommand | None:
    """Parse a datagram; None if it is no command."""
    if len(datagram) < COMMAND_HEADER.size:
        return None
    key, flags, kind, length, number = COMMAND_HEADER.unpack_from(datagram)
    payload = datagram[COMMAND_HEADER.size :]
    if key != COMMAND_KEY or length != len(payload):
        return None
    return GvcpCommand(kind, number, payload, bool(flags & ASK_ACKNOWLEDGEMENT))


def acknowledge(
    command: GvcpCommand, payload: bytes = b"", status: Status = Status.SUCCESS
) -> bytes:
    """Bytes of the acknowledgement of a command."""
    header = REPLY_HEADER.pack(status, command.kind + 1, len(payload), command.number)
    return header + payload
