"""Packets of Stream Motion: what a controller sends in a cycle, and what it is sent.

They are of version 3, big-endian, with angles in degrees and lengths in millimetres.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.robot.cyclic.stream import CyclePacket, PacketRefused

STREAM_VERSION: Final = 3

START_PACKET: Final = struct.pack(">II", 200, STREAM_VERSION)
STOP_PACKET: Final = struct.pack(">II", 2, STREAM_VERSION)

CAPABILITY_FORMAT: Final = struct.Struct(">7I")
"""Type, version, id, cycle in ms, buffered commands, newest version, whether a tool's pose."""

READ_CAPABILITY: Final = 7
CAPABILITY_REQUEST: Final = CAPABILITY_FORMAT.pack(READ_CAPABILITY, STREAM_VERSION, 1, 0, 0, 0, 0)

STATUS_FORMAT: Final = struct.Struct(">IIIBBBxI9f9f9ff")
"""Type, version, number, three states, time; pose, joints, currents, scale of speed."""

STATUS_SIZES: Final = {202: 388, 204: 416}
"""Bytes of a status packet by its type: without and with forces."""

COMMAND_FORMAT: Final = struct.Struct(">IIIBBH9d256x")
"""Type, version, number, last command, motion, data style, joint angles; no outputs."""

COMMAND_TYPE: Final = 201
JOINT_ANGLES: Final = 0xFFFF
"""Data style of a command whose numbers are joint angles: anything else is a pose."""

TAKES_COMMANDS, COMMAND_CAME = 1, 2  # bits of the status
IN_ERROR, EMERGENCY_STOP = 1, 4  # bits of the robot status


@dataclass(frozen=True, slots=True, eq=False)
class StatusPacket(CyclePacket):
    """State of the controller in one cycle; its stamp is the packet's number.

    Parameters
    ----------
    status, robot_status : int
        Bits of the stream and of the robot.
    """

    status: int
    robot_status: int


def parse_status(data: bytes, cycle: float) -> StatusPacket:
    """Parse a status packet of a controller that sends one every so many seconds.

    Raises
    ------
    PacketRefused
        If it is none.
    """
    kind = int.from_bytes(data[:4], "big")
    if STATUS_SIZES.get(kind) != len(data):
        raise PacketRefused(f"it is of type {kind} with {len(data)} bytes, no status packet")
    _, _, number, status, robot, _, _, *numbers = STATUS_FORMAT.unpack_from(data)
    values = np.array(numbers[:15])
    if not np.isfinite(values).all():
        raise PacketRefused("its pose or a joint angle is no number")
    q = np.radians(values[9:])
    return StatusPacket(number, number * cycle, q, q, 1e-3 * values[:3], 0, status, robot)


def format_command(q: Array, number: int, *, last: bool) -> bytes:
    """Command: joint angles, shape (6,), radians, for the status packet of a number."""
    angles = (*np.degrees(q).tolist(), 0.0, 0.0, 0.0)
    return COMMAND_FORMAT.pack(COMMAND_TYPE, STREAM_VERSION, number, last, 1, JOINT_ANGLES, *angles)
