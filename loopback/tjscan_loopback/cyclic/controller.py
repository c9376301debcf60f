"""A controller without its network: its cycles, its arm, and what it makes of answers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.robot.kinematics import Kinematics

LAG_CYCLES: Final = 3
"""Cycles by which the arm is behind what it is sent."""

TURN_ROUNDING: Final = 1e-7
"""Radians by which a joint may seem to turn further in a cycle: digits of an answer."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What the other computer answers.

    Parameters
    ----------
    stamp : int
        The stamp that it repeats.
    q : ndarray, shape (6,)
        Joint angles, or their correction, radians.
    stop : bool
        Whether to end the motion.
    """

    stamp: int
    q: Array
    stop: bool = False


class CyclicController(ABC):
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
        Answers that may be late or missing before it stops.
    report_line : callable
        Receives a line when it stops or ends.

    Attributes
    ----------
    q, commanded : ndarray, shape (6,)
        Joint angles as they are, and as commanded last, radians.
    stamp : int
        Number or time stamp of the packet of this cycle.
    standing, program_runs : bool
        Whether the arm is held, and whether the program runs.
    runs, answered : bool
        Whether it sends packets, and whether one was answered since it does.
    program : int
        How often the program was started.
    missing : int
        Answers that are missing in a row.
    moved : int
        Cycles in which what it is sent changed, since it began.
    fastest : float
        Largest speed of a joint, as a share of its limit.
    cycles, turned : int
        Cycles since it began, and when the arm turned last.
    misread : int
        Answers with a stamp that was never sent, but for jumps.
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
        self.kinematics, self._home, self.report_line = kinematics, q, report_line
        self.cycle_ms, self._patience = cycle_ms, patience
        self.stamp, self.moved, self.misread, self.fastest = 0, 0, 0, 0.0
        self.program = self.cycles = self.turned = 0
        self.q = q
        self.start()

    def start(self, *, home: bool = False) -> None:
        """Start the program, as a person does once the other computer listens."""
        self.standing, self.program_runs, self.runs, self.answered = False, True, True, False
        self.q = self._home if home else self.q
        self._set_point = self.commanded = self.q
        self._behind = deque([self.q] * LAG_CYCLES)
        self._late, self._still, self.missing = 0, LAG_CYCLES, 0
        self.program += 1
        self._first = self.stamp = self._first_stamp()

    @property
    def step(self) -> int:
        """By how much the stamp rises in a cycle."""
        return 1

    @abstractmethod
    def _first_stamp(self) -> int:
        """The stamp of a program's first packet."""

    @abstractmethod
    def packet(self) -> bytes:
        """The packet of this cycle."""

    @abstractmethod
    def parse(self, data: bytes) -> Answer | None:
        """Parse an answer; None if it is none that this controller takes."""

    def _target(self, answer: Answer) -> Array:
        """Joint angles that an answer asks for, radians."""
        return answer.q

    def _miss_answer(self) -> None:
        """What the controller does in a cycle without an answer."""
        if self._late >= self._patience:
            self.stop(f"{self._late} answers were late or missing")

    def end_cycle(self, answer: Answer | None) -> None:
        """End a cycle with the answer to its packet, or without any."""
        if answer is None:
            self._late += self.answered
            self.missing += self.answered
            self._miss_answer()
        elif answer.stop:
            self.report_line("ended")
            self.start()
            return
        else:
            self.answered, self.missing = True, 0
            self._follow(self._target(answer))
        self._behind.append(self.commanded)
        arrived = self._behind.popleft()
        self.cycles += 1
        if not self.standing and np.any(arrived != self.q):
            self.q, self.turned = arrived, self.cycles
        self.stamp += self.step if self.answered else 0

    def note_other_answer(self, answer: Answer) -> None:
        """Note an answer that is not to the packet of this cycle: one to an earlier one is late."""
        self.misread += not self._first <= answer.stamp < self.stamp

    def stop(self, reason: str) -> None:
        """Send nothing any more, and hold the arm."""
        self.runs = False
        self.report_line(f"stopped: {reason}")

    def _follow(self, q: Array) -> None:
        turn = np.abs(q - self.commanded) - TURN_ROUNDING
        speeds = turn / (1e-3 * self.cycle_ms * self.kinematics.velocity)
        self.fastest = max(self.fastest, float(speeds.max()))
        moves = bool(turn.max() > 0)
        self.moved += moves
        self._still = 0 if moves else self._still + 1
        if self._still == LAG_CYCLES:
            self.report_line("at rest")
        if speeds.max() > 1:
            self.stop(f"A{speeds.argmax() + 1} is commanded too fast")
        elif self.kinematics.joint_limit_excess(q).max() > TURN_ROUNDING:
            self.stop("what it is sent leads beyond a joint's limit")
        else:
            self.commanded = q
