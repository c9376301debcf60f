"""A FANUC controller without its network: its packets, and what it makes of commands."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan_loopback.cyclic.controller import LAG_CYCLES, Answer, CyclicController

STREAM_VERSION: Final = 3
STATUS_TYPE, COMMAND_TYPE, CAPABILITY_TYPE = 202, 201, 7
JOINT_STYLE: Final = 0xFFFF

TAKES_COMMANDS, COMMAND_CAME, SYSTEM_READY, IN_MOTION = 1, 2, 4, 8
IN_ERROR, EMERGENCY_STOP = 1, 4

ACCELERATION_SHARE, JERK_SHARE = 2.0, 8.0
"""Largest acceleration, 1/s, and jerk, 1/s², of a joint by its largest speed: an assumption."""

UNCHECKED_CYCLES: Final = 4
"""Cycles after a missing command in which acceleration and jerk are not checked."""


def parse_command(data: bytes) -> Answer | None:
    """Parse a motion command; None if it is none that this controller takes."""
    if len(data) != 344:
        return None
    kind, version, number, last, motion, style = struct.unpack(">IIIBBH", data[:16])
    angles = np.radians(np.frombuffer(data[16:88], ">f8")[:6])
    if (kind, version, motion, style) != (COMMAND_TYPE, STREAM_VERSION, 1, JOINT_STYLE):
        return None
    return Answer(number, angles, bool(last)) if np.isfinite(angles).all() else None


class StreamController(CyclicController):
    """A simulated FANUC controller: without a command it goes on as before, `patience` cycles.

    Attributes
    ----------
    j3_from_horizontal : bool
        Whether its J3 counts from the horizontal; else from the upper arm.
    """

    j3_from_horizontal = False

    def start(self, *, home: bool = False) -> None:
        """Start the program, as a person does once the other computer listens."""
        super().start(home=home)
        self._steps = np.zeros((3, 6))
        self._alarmed, self._unchecked = False, 0

    def _first_stamp(self) -> int:
        return 1

    def packet(self) -> bytes:
        """The status packet of this cycle."""
        T = self.kinematics.forward(self.q)
        w, r = np.arctan2(T[2, 1], T[2, 2]), np.arctan2(T[1, 0], T[0, 0])
        p = np.arctan2(-T[2, 0], np.hypot(T[0, 0], T[1, 0]))
        pose = (*1e3 * T[:3, 3], *np.degrees([w, p, r]), 0.0, 0.0, 0.0)
        joints = (*np.degrees(self._own_angles(self.q)), 0.0, 0.0, 0.0)
        ready = self.program_runs and not (self.standing or self._alarmed)
        status = (TAKES_COMMANDS | SYSTEM_READY) * ready
        status |= IN_MOTION * (self._still < LAG_CYCLES)
        status |= COMMAND_CAME * (self.answered and self.missing == 0)
        robot = IN_ERROR * (self._alarmed or self.standing) | EMERGENCY_STOP * self.standing
        head = struct.pack(
            ">IIIBBBxI",
            *(STATUS_TYPE, STREAM_VERSION, self.stamp % 2**32, status, robot, 0),
            self.stamp * self.cycle_ms % 2**32,
        )
        return head + struct.pack(">28f", *pose, *joints, *[0.0] * 9, 1.0) + bytes(256)

    def end_session(self) -> None:
        """End the session for a stop packet; a person starts the next, unless it was stopped."""
        if self._alarmed or self.standing or not self.program_runs:
            self.stop("the session has ended")
            return
        if self.answered:
            self.report_line("ended")
        self.start()

    def parse(self, data: bytes) -> Answer | None:
        """Parse a command; None if it is none that this controller takes."""
        return parse_command(data)

    def _own_angles(self, q: Array) -> Array:
        return np.asarray(q - self.j3_from_horizontal * q[1] * np.eye(6)[2])

    def _target(self, answer: Answer) -> Array:
        return np.asarray(answer.q + self.j3_from_horizontal * answer.q[1] * np.eye(6)[2])

    def _miss_answer(self) -> None:
        if not self.answered or self._alarmed:
            return
        if self.missing > self._patience:
            self._raise_alarm(f"no command came for {self.missing} cycles")
            return
        self._unchecked = UNCHECKED_CYCLES
        self._follow(self.commanded + self._steps[0])

    def _raise_alarm(self, reason: str) -> None:
        self._alarmed = True
        self._steps[:] = 0.0
        self.report_line(f"stopped: {reason}")

    def _follow(self, q: Array) -> None:
        if self._alarmed or self.standing or not self.program_runs:
            return
        before = self.commanded
        super()._follow(q)
        self._steps = np.roll(self._steps, 1, axis=0)
        self._steps[0] = self.commanded - before
        if self._unchecked:
            self._unchecked -= 1
            return
        per_cycle, speeds = 1e-3 * self.cycle_ms, self.kinematics.velocity
        turns = np.abs(self._steps[0] - self._steps[1]) / per_cycle**2
        jerks = np.abs(self._steps[0] - 2 * self._steps[1] + self._steps[2]) / per_cycle**3
        for what, values, share in (
            ("acceleration", turns, ACCELERATION_SHARE),
            ("jerk", jerks, JERK_SHARE),
        ):
            if (values > share * speeds).any():
                joint = int((values / speeds).argmax()) + 1
                self._raise_alarm(f"J{joint} is commanded with too much {what}")
