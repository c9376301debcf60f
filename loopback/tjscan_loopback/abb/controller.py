"""An ABB controller without its network: its messages, and what it makes of answers."""

from __future__ import annotations

import numpy as np

from tjscan_loopback.abb.wire import double_field, message_field, read_fields, varint_field
from tjscan_loopback.cyclic.controller import LAG_CYCLES, Answer, CyclicController

MSGTYPE_DATA, MSGTYPE_CORRECTION = 2, 3
MOTORS_ON, MOTORS_OFF = 1, 2
MCI_STOPPED, MCI_RUNNING = 2, 3
RAPID_STOPPED, RAPID_RUNNING = 1, 2


def parse_answer(data: bytes) -> Answer | None:
    """Parse an EgmSensor; None if it is none that this controller takes."""
    try:
        sensor = dict(read_fields(data))
        header = dict(read_fields(_bytes(sensor[1])))
        planned = dict(read_fields(_bytes(sensor[2])))
        joints = [value for number, value in read_fields(_bytes(planned[1])) if number == 1]
        q = np.radians(np.array(joints, dtype=float))
    except (KeyError, ValueError, TypeError):
        return None
    fits = q.shape == (6,) and bool(np.isfinite(q).all())
    if not fits or header.get(3) != MSGTYPE_CORRECTION:
        return None
    return Answer(int(header.get(1, 0)), q)


def _bytes(value: int | float | bytes) -> bytes:
    if not isinstance(value, bytes):
        raise ValueError("no message")
    return value


class EgmController(CyclicController):
    """A simulated ABB controller; `patience` is its CommTimeout in cycles.

    Where an answer is missing, it holds the arm where it was sent last.
    """

    def _first_stamp(self) -> int:
        return 0

    @property
    def clock_ms(self) -> int:
        """Milliseconds on its clock."""
        return (self.program * 100_000 + self.stamp * self.cycle_ms) % 2**32

    def packet(self) -> bytes:
        """The EgmRobot of this cycle."""
        q = np.degrees(self.q)
        place = 1e3 * self.kinematics.forward(self.q)[:3, 3]
        joints = message_field(1, *(double_field(1, float(angle)) for angle in q))
        pose = message_field(1, *(double_field(i + 1, float(place[i])) for i in range(3)))
        runs = self.program_runs and not self.standing
        states = {
            4: MOTORS_OFF if self.standing else MOTORS_ON,
            5: MCI_RUNNING if runs else MCI_STOPPED,
            8: RAPID_RUNNING if self.program_runs else RAPID_STOPPED,
        }
        header = (
            varint_field(1, self.stamp % 2**32),
            varint_field(2, self.clock_ms),
            varint_field(3, MSGTYPE_DATA),
        )
        return b"".join(
            (
                message_field(1, *header),
                message_field(2, joints, message_field(2, pose)),
                message_field(3, joints),
                *(
                    message_field(number, varint_field(1, state))
                    for number, state in states.items()
                ),
                varint_field(6, 0),
                double_field(10, 20.0),
            )
        )

    def parse(self, data: bytes) -> Answer | None:
        """Parse an answer; None if it is none that this controller takes."""
        return parse_answer(data)

    def _miss_answer(self) -> None:
        if self.missing < self._patience:
            return
        if self._still > LAG_CYCLES and not self.standing and self.program_runs:
            self.report_line("ended")  # at rest: a person starts the program again
            self.start()
        else:
            self.stop(f"no answer came for {self.missing} cycles")
