"""The controller without its network: its clock, its arm, and what it makes of answers."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree

import numpy as np

from tjscan.core.frames import Array, pose_to_euler_zyx
from tjscan.robot.kinematics import Kinematics

AXIS_NAMES: Final = ("A1", "A2", "A3", "A4", "A5", "A6")

SENT_DECIMALS: Final = 4
"""Decimal places of what it sends: the parameter Precision of its RSI object Ethernet."""

SEN_TYPE: Final = "tjscan"
"""What the other computer has to call itself."""

LAG_CYCLES: Final = 3
"""Cycles by which the arm is behind its corrections."""

PAUSE_BETWEEN_PROGRAMS: Final = 10_000
"""Milliseconds on its clock until a person starts the program again."""

TURN_ROUNDING: Final = 1e-7
"""Radians by which a joint may seem to turn further in a cycle: digits of an answer."""

INTERPRETER_STATES: Final = {True: 3, False: 4}
"""Of a program that runs, and of one that is stopped."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What the other computer answers.

    Parameters
    ----------
    ipoc : int
        The time stamp that it repeats.
    correction : ndarray, shape (6,)
        Of the joint angles, radians.
    stop : bool
        Whether to end the sensor-guided motion.
    """

    ipoc: int
    correction: Array
    stop: bool


def parse_answer(data: bytes) -> Answer | None:
    """Parse an answer; None if it is none that this controller takes."""
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


class LoopbackController:
    """A simulated controller: one cycle after another, each with an answer or without.

    Parameters
    ----------
    kinematics : Kinematics
        Which arm it drives.
    q : ndarray, shape (6,)
        Joint angles it starts with, radians.
    cycle_ms : int
        Milliseconds between two packets.
    patience : int
        Answers that may be late or missing before it stops: the parameter Timeout of its RSI object
        Ethernet.
    report_line : callable
        Receives a line when it stops or ends.

    Attributes
    ----------
    q, commanded : ndarray, shape (6,)
        Joint angles as they are, and as commanded last, radians.
    standing, program_runs : bool
        Whether the arm is held, and whether the program runs.
    runs, answered : bool
        Whether it sends packets, and whether one was answered since it does.
    program : int
        How often the program was started.
    moved : int
        Cycles in which the corrections changed, since it began.
    fastest : float
        Largest speed of a joint, as a share of its limit.
    misread : int
        Answers with a time stamp that was never sent, but for jumps.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        q: Array,
        *,
        cycle_ms: int,
        patience: int,
        report_line: Callable[[str], None],
    ) -> None:
        self._kinematics, self._home, self.report_line = kinematics, q, report_line
        self.cycle_ms, self._patience = cycle_ms, patience
        self.ipoc, self.moved, self.misread, self.fastest = 0, 0, 0, 0.0
        self.program = 0
        self.q = q
        self.start()

    def start(self, *, home: bool = False) -> None:
        """Start the program, as a person does once the other computer listens."""
        self.standing, self.program_runs, self.runs, self.answered = False, True, True, False
        self.q = self._home if home else self.q
        self._set_point = self.commanded = self.q
        self._behind = deque([self.q] * LAG_CYCLES)
        self._late, self._still = 0, LAG_CYCLES
        self.program += 1
        self.ipoc += PAUSE_BETWEEN_PROGRAMS
        self._first = self.ipoc

    def packet(self) -> bytes:
        """The packet of this cycle."""
        root = ElementTree.Element("Rob", Type="KUKA")
        for tag, q in (("RIst", self.q), ("RSol", self._set_point)):
            position, angles = pose_to_euler_zyx(self._kinematics.forward(q))
            numbers = (*1e3 * position, *np.degrees(angles))
            ElementTree.SubElement(root, tag, _attributes(("X", "Y", "Z", "A", "B", "C"), numbers))
        for tag, q in (("AIPos", self.q), ("ASPos", self._set_point)):
            ElementTree.SubElement(root, tag, _attributes(AXIS_NAMES, np.degrees(q)))
        ElementTree.SubElement(root, "Delay", D=str(self._late))
        ElementTree.SubElement(root, "Status", R=str(INTERPRETER_STATES[self.program_runs]))
        ElementTree.SubElement(root, "IPOC").text = str(self.ipoc)
        return ElementTree.tostring(root)

    def end_cycle(self, answer: Answer | None) -> None:
        """End a cycle with the answer to its packet, or without any."""
        if answer is None:
            self._late += self.answered
            if self._late >= self._patience:
                self.stop(f"{self._late} answers were late or missing")
        elif answer.stop:
            self.report_line("ended")
            self.start()
            return
        else:
            self.answered = True
            self._follow(self._set_point + answer.correction)
        self._behind.append(self.commanded)
        arrived = self._behind.popleft()
        self.q = self.q if self.standing else arrived
        self.ipoc += self.cycle_ms if self.answered else 0

    def note_other_answer(self, answer: Answer) -> None:
        """Note an answer that is not to the packet of this cycle: one to an earlier one is late."""
        self.misread += not self._first <= answer.ipoc < self.ipoc

    def stop(self, reason: str) -> None:
        """End RSI, and hold the arm."""
        self.runs = False
        self.report_line(f"stopped: {reason}")

    def _follow(self, q: Array) -> None:
        turn = np.abs(q - self.commanded) - TURN_ROUNDING
        speeds = turn / (1e-3 * self.cycle_ms * self._kinematics.velocity)
        self.fastest = max(self.fastest, float(speeds.max()))
        moves = bool(turn.max() > 0)
        self.moved += moves
        self._still = 0 if moves else self._still + 1
        if self._still == LAG_CYCLES:
            self.report_line("at rest")
        if speeds.max() > 1:
            self.stop(f"{AXIS_NAMES[int(speeds.argmax())]} is commanded too fast")
        elif self._kinematics.joint_limit_excess(q).max() > TURN_ROUNDING:
            self.stop("a correction leads beyond a joint's limit")
        else:
            self.commanded = q


def _attributes(names: tuple[str, ...], values: Array | tuple[float, ...]) -> dict[str, str]:
    return {name: f"{value:.{SENT_DECIMALS}f}" for name, value in zip(names, values, strict=True)}
