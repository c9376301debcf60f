"""A KUKA controller without its network: its packets, and what it makes of answers."""

from __future__ import annotations

from typing import Final
from xml.etree import ElementTree

import numpy as np

from tjscan.core.frames import Array, pose_to_euler_zyx
from tjscan_loopback.cyclic.controller import Answer, CyclicController

AXIS_NAMES: Final = ("A1", "A2", "A3", "A4", "A5", "A6")

SENT_DECIMALS: Final = 4
"""Decimal places of what it sends: the parameter Precision of its RSI object Ethernet."""

SEN_TYPE: Final = "tjscan"
"""What the other computer has to call itself."""

PAUSE_BETWEEN_PROGRAMS: Final = 10_000
"""Milliseconds on its clock until a person starts the program again."""

INTERPRETER_STATES: Final = {True: 3, False: 4}
"""Of a program that runs, and of one that is stopped."""


def parse_answer(data: bytes) -> Answer | None:
    """Parse an answer, whose joint angles are corrections; None if this controller refuses it."""
    try:
        root = ElementTree.fromstring(data)
        axes = next(root.iter("AK"))
        correction = np.radians([float(axes.attrib[axis]) for axis in AXIS_NAMES])
        ipoc, stop = int(root.findtext("IPOC", "")), bool(int(root.findtext("Stop", "0")))
    except (ElementTree.ParseError, StopIteration, KeyError, ValueError):
        return None
    if (root.tag, root.get("Type")) != ("Sen", SEN_TYPE) or not np.isfinite(correction).all():
        return None
    return Answer(ipoc, correction, stop)


class RsiController(CyclicController):
    """A simulated KUKA controller; `patience` is the parameter Timeout of its object Ethernet."""

    @property
    def step(self) -> int:
        """By how much the IPOC rises in a cycle, milliseconds."""
        return self.cycle_ms

    def _first_stamp(self) -> int:
        return self.stamp + PAUSE_BETWEEN_PROGRAMS

    def parse(self, data: bytes) -> Answer | None:
        """Parse an answer; None if it is none that this controller takes."""
        return parse_answer(data)

    def _target(self, answer: Answer) -> Array:
        return self._set_point + answer.q

    def packet(self) -> bytes:
        """The packet of this cycle."""
        root = ElementTree.Element("Rob", Type="KUKA")
        for tag, q in (("RIst", self.q), ("RSol", self._set_point)):
            position, angles = pose_to_euler_zyx(self.kinematics.forward(q))
            numbers = (*1e3 * position, *np.degrees(angles))
            ElementTree.SubElement(root, tag, _attributes(("X", "Y", "Z", "A", "B", "C"), numbers))
        for tag, q in (("AIPos", self.q), ("ASPos", self._set_point)):
            ElementTree.SubElement(root, tag, _attributes(AXIS_NAMES, np.degrees(q)))
        ElementTree.SubElement(root, "Delay", D=str(self._late))
        ElementTree.SubElement(root, "Status", R=str(INTERPRETER_STATES[self.program_runs]))
        ElementTree.SubElement(root, "IPOC").text = str(self.stamp)
        return ElementTree.tostring(root)


def _attributes(names: tuple[str, ...], values: Array | tuple[float, ...]) -> dict[str, str]:
    return {name: f"{value:.{SENT_DECIMALS}f}" for name, value in zip(names, values, strict=True)}
