"""Packets of RobotSensorInterface: what a controller sends in a cycle, and what it is answered.

It sends ``<Rob Type="KUKA">`` and waits for ``<Sen Type="...">`` with the same IPOC, its time stamp
in milliseconds. Angles are in degrees there, lengths in millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Final
from xml.etree import ElementTree

import numpy as np

from tjscan.core.frames import Array
from tjscan.robot.cyclic.stream import CyclePacket, PacketRefused

AXIS_NAMES: Final = ("A1", "A2", "A3", "A4", "A5", "A6")

LARGEST_PACKET: Final = 4096
"""Bytes of a packet at most: more is none of a controller that is set up as docs/kuka.md states."""

LONGEST_TIME_STAMP: Final = 15
"""Digits of an IPOC at most: thirty thousand years."""

PROGRAM_ACTIVE: Final = 3
"""State of the robot interpreter while its program runs, as the RSI object Status reports it."""


@dataclass(frozen=True, slots=True, eq=False)
class RobPacket(CyclePacket):
    """State of the controller in one cycle.

    Its stamp is the IPOC in milliseconds, its `q` AIPos, its `set_point` ASPos, its `tool_b` RIst
    and its `late` Delay.

    Parameters
    ----------
    program : int or None
        State of the robot interpreter (Status R); None if it is not sent.
    """

    program: int | None


def parse_packet(data: bytes) -> RobPacket:
    """Parse a packet of the controller.

    Raises
    ------
    PacketRefused
        If it is none.
    """
    if len(data) > LARGEST_PACKET:
        raise PacketRefused(f"it is longer than {LARGEST_PACKET} bytes")
    if b"<!" in data:
        raise PacketRefused("it declares a document type")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise PacketRefused(f"it is no XML ({error})") from None
    if (root.tag, root.get("Type")) != ("Rob", "KUKA"):
        found = f"a <{root.tag}> of Type {root.get('Type')!r}"
        raise PacketRefused(f"it is {found}, not a <Rob> of Type 'KUKA'")
    ipoc = _time_stamp(root.findtext("IPOC", ""))
    return RobPacket(
        stamp=ipoc,
        time=1e-3 * ipoc,
        q=np.radians(_numbers(root, "AIPos", AXIS_NAMES)),
        set_point=np.radians(_numbers(root, "ASPos", AXIS_NAMES)),
        tool_b=1e-3 * _numbers(root, "RIst", ("X", "Y", "Z")),
        late=int(_numbers(root, "Delay", ("D",))[0]),
        program=None if root.find("Status") is None else int(_numbers(root, "Status", ("R",))[0]),
    )


def format_answer(sen_type: str, correction: Array, ipoc: int, *, stop: bool) -> bytes:
    """Answer to a packet.

    Parameters
    ----------
    sen_type : str
        What the controller's configuration calls this program.
    correction : ndarray, shape (6,)
        Of the joint angles from the set-point at which RSI began, radians.
    ipoc : int
        That of the packet.
    stop : bool
        Whether the sensor-guided motion is to end.
    """
    angles = zip(AXIS_NAMES, np.degrees(correction).tolist(), strict=True)
    axes = " ".join(f'{axis}="{angle:.6f}"' for axis, angle in angles)
    return (
        f'<Sen Type="{sen_type}"><Stop>{stop:d}</Stop><AK {axes}/><IPOC>{ipoc}</IPOC></Sen>'
    ).encode("ascii")


def _numbers(root: ElementTree.Element, tag: str, names: tuple[str, ...]) -> Array:
    if (element := root.find(tag)) is None:
        raise PacketRefused(f"it has no <{tag}>")
    try:
        numbers = [float(element.get(name, "")) for name in names]
    except ValueError:
        numbers = []
    if not numbers or not all(map(isfinite, numbers)):
        raise PacketRefused(f"its <{tag}> has not a number for each of {', '.join(names)}")
    return np.array(numbers)


def _time_stamp(text: str) -> int:
    if not text.isascii() or not text.isdigit() or len(text) > LONGEST_TIME_STAMP:
        raise PacketRefused("its <IPOC> is no time stamp")
    return int(text)
