"""What each packet of the controller is answered: corrections of the joint angles, a row a cycle.

A path is run through by packets, not by the clock: wherever packets or answers are lost, the arm
rests for a cycle and goes on from there. After a fault it brakes along its path, and moves no more.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core import errors
from tjscan.core.frames import Array
from tjscan.robot.kuka import packets
from tjscan.robot.kuka.packets import RobPacket

MOST_LOST: Final = 5
"""Packets that may be lost lately; see `FORGIVEN_SHARE`."""

SHORTEST_PAUSE: Final = 3
"""Unanswered packets in a row after which the arm stands, and its path begins slowly again."""

FORGIVEN_SHARE: Final = 0.01
"""Share of a lost, late or waiting packet that each good one makes up for."""

START_TOLERANCE: Final = np.radians(0.1)
"""Radians between measured joint angles and the set-point, where nothing was corrected yet."""

STANDING_DISTANCE: Final = np.radians(0.5)
"""Radians that a joint is away from where it was sent, if the arm is held."""

STANDING_TURN: Final = np.radians(0.01)
"""Radians that no joint of a standing arm turns from where it came to stand: encoders are noisy."""

STANDING_LIMIT: Final = 0.3
"""Seconds for which an arm that was sent on may stand: longer than any arm lags."""

SETTLING_TIME: Final = 0.2
"""Seconds after a path until the motion may be ended: an arm lags behind its corrections."""

REMEMBERED_ANSWERS: Final = 4096
"""Answers that may prove not to have been taken."""

CABLE_ADVICE: Final = "See that the arm is at rest and its network cable sits, then start again."


@dataclass(frozen=True, slots=True, eq=False)
class StreamState:
    """State of the arm and of the corrections that are sent to it.

    Parameters
    ----------
    time : float
        Seconds on the controller's clock.
    q, command : ndarray, shape (6,)
        Joint angles as measured, and as commanded last, radians.
    tool_b : ndarray, shape (3,)
        Position of the active tool, metres.
    moving : bool
        Whether a path is run through.
    ignored : dict of str to int
        How many packets were not answered, or not there, by what was wrong with them.
    """

    time: float
    q: Array
    command: Array
    tool_b: Array
    moving: bool
    ignored: dict[str, int]


class CorrectionStream:
    """Stream of corrections to one controller.

    Parameters
    ----------
    host : str
        Its IP address; packets of others are ignored.
    sen_type : str
        What its configuration calls this program.
    cycle : float
        Seconds between two packets.

    Attributes
    ----------
    fault : ArmFault or None
        The first fault: no move is begun after it.
    ended : bool
        Whether the controller was told to end the motion, or is answered no more.
    """

    def __init__(self, host: str, sen_type: str, cycle: float) -> None:
        self._host, self._sen_type, self._cycle = host, sen_type, cycle
        self.fault: errors.ArmFault | None = None
        self.ended = self._leaving = False
        self._packet: RobPacket | None = None
        self._port = 0
        self._ignored: Counter[str] = Counter()
        self._lost = self._late = self._waited = 0.0
        self._stood = self._rested = self._paused = 0
        self._stood_at = np.full(6, np.inf)
        self._base = np.zeros(6)
        self._follow(self._base[None], cycle)

    def answer(self, data: bytes, sender: tuple[str, int]) -> bytes | None:
        """Answer to a packet; None if it is not answered."""
        if sender[0] != self._host or self._port not in (0, sender[1]):
            self._ignored["from another address"] += 1
            return None
        try:
            packet = packets.parse_packet(data)
        except packets.PacketRefused as refused:
            self.fail(
                errors.ArmConnectionLost(
                    f"a packet of the arm's controller is refused: {refused}. {CABLE_ADVICE}"
                )
            )
            return None
        if self._packet is None:
            self._begin(packet, sender[1])
        elif packet.ipoc <= self._packet.ipoc:
            repeated = packet.ipoc == self._packet.ipoc
            self._ignored["with a repeated IPOC" if repeated else "with an older IPOC"] += 1
            return None
        else:
            self._rewind(self._packet, packet)
            self._check_arm_follows(packet)
        self._packet = packet
        if self.ended:
            return None
        self._advance()
        self._rested = 0 if self.moving else self._rested + 1
        self.ended = self._leaving and self._rested * self._cycle > SETTLING_TIME
        correction = self._command - self._base
        return packets.format_answer(self._sen_type, correction, packet.ipoc, stop=self.ended)

    def state(self) -> StreamState | None:
        """State at the last packet; None before the first.

        Raises
        ------
        ArmFault
            If there is one.
        """
        if self.fault is not None:
            raise self.fault
        if (now := self._packet) is None:
            return None
        time, ignored = 1e-3 * now.ipoc, dict(self._ignored)
        return StreamState(time, now.q, self._command, now.tool_b, self.moving, ignored)

    @property
    def connected(self) -> bool:
        """Whether a packet of the controller came."""
        return self._packet is not None

    @property
    def moving(self) -> bool:
        """Whether a path is run through."""
        held = self._braking and self._rate == 0
        return not held and self._sent[-1] < len(self._rows) - 1

    def begin_move(self, q: Array, ramp: float) -> None:
        """Begin to run through a path.

        Parameters
        ----------
        q : ndarray, shape (m, 6)
            Joint angles in each cycle, from those commanded last on, radians.
        ramp : float
            Seconds in which it brakes from full speed.

        Raises
        ------
        ArmFault
            If there was a fault, or another path is run through.
        """
        if self.fault is not None or self.moving:
            raise self.fault or errors.ArmFault("the arm still moves: wait until it rests")
        self._follow(q, ramp)

    def brake(self) -> None:
        """Come to rest along the path."""
        self._braking = True

    def leave(self) -> None:
        """Come to rest, and tell the controller to end the motion."""
        self._leaving = True
        self.brake()

    def fail(self, fault: errors.ArmFault, *, silent: bool = False) -> None:
        """Come to rest for a fault; `silent` answers no more: the controller then ends RSI."""
        if self.fault is None:
            self.fault = fault
        self.ended = self.ended or silent
        self.brake()

    def note_waiting(self, count: int) -> None:
        """Note how many packets waited for this program at once, of which one is in time."""
        self._waited = max(self._waited - FORGIVEN_SHARE * count, count - 1)

    def fail_for_silence(self, seconds: float) -> None:
        """Fail because no new packet came for some seconds, by which side fell silent first.

        Nothing is answered any more: a program that is started again counts from where the arm is.
        """
        ignored = "".join(
            f"; {count} packets {what} were ignored" for what, count in self._ignored.items()
        )
        if self._late > 1 and self._waited >= 1:
            self.fail(
                errors.MoveSupervisionLost(
                    f"this computer was held up ({self._waited + 1:.0f} packets of the arm's "
                    "controller waited for an answer), and the controller has ended RSI. See that "
                    "nothing else keeps this computer busy, then start again."
                )
            )
        elif self._late > 1:
            self.fail(
                errors.ArmConnectionLost(
                    f"answers did not reach the arm's controller in time ({self._late:.0f} of the "
                    "last), and it has ended RSI: the network, or this computer, is too slow"
                    f"{ignored}. {CABLE_ADVICE}"
                )
            )
        self.fail(
            errors.ArmNotResponding(
                f"nothing new came from the arm's controller for {seconds:g} s: RSI has ended, or "
                f"it is silent{ignored}. Read its pendant's messages, then start again."
            ),
            silent=True,
        )

    def _follow(self, q: Array, ramp: float) -> None:
        self._rows, self._drop = q, self._cycle / max(ramp, self._cycle)
        self._sent: deque[float] = deque([0.0], maxlen=REMEMBERED_ANSWERS)
        self._rate, self._braking = 1.0, False
        self._command = q[0]

    def _begin(self, packet: RobPacket, port: int) -> None:
        self._port, self._base = port, packet.set_point
        self._follow(self._base[None], self._cycle)
        if packet.late or np.abs(packet.q - packet.set_point).max() > START_TOLERANCE:
            self.fail(
                errors.ArmNotConnected(
                    "RSI ran on the arm's controller before this program listened, and may have "
                    "corrected the arm already. End the program on its pendant, and start it once "
                    "this program waits for it."
                ),
                silent=True,
            )

    def _rewind(self, before: RobPacket, packet: RobPacket) -> None:
        """Go back to what the controller has taken: it holds that while answers are late."""
        period = round(1e3 * self._cycle)
        lost = (packet.ipoc - before.ipoc) // period - 1
        late = max(packet.late - before.late, 0)
        if lost > 0:
            self._ignored["that never came"] += lost
        self._lost = max(self._lost - FORGIVEN_SHARE, 0.0) + max(lost, 0)
        self._late = max(self._late - FORGIVEN_SHARE, 0.0) + late
        if (packet.ipoc - before.ipoc) % period or self._lost > MOST_LOST:
            self.fail(
                errors.ArmConnectionLost(
                    f"the IPOC of the arm's controller jumped from {before.ipoc} to {packet.ipoc}, "
                    f"where cycle_ms = {period}. See that this is its cycle and the network loses "
                    f"nothing. {CABLE_ADVICE}"
                ),
                silent=lost > MOST_LOST,  # long enough for a program that was started again
            )
        self._paused = self._paused + max(late, lost) if max(late, lost) > 0 else 0
        if self._paused >= SHORTEST_PAUSE:
            self._rate = 0.0
        for _ in range(min(late - lost, len(self._sent) - 1)):
            self._sent.pop()

    def _check_arm_follows(self, packet: RobPacket) -> None:
        if packet.program not in (None, packets.PROGRAM_ACTIVE):
            self.fail(
                errors.ProgramStopped(
                    "the program on the arm's controller is stopped (its interpreter's state is "
                    f"{packet.program}). Read its pendant's messages, then start again."
                ),
                silent=True,
            )
        moved = np.abs(packet.q - self._stood_at).max() > STANDING_TURN
        away = np.abs(packet.q - self._command).max() > STANDING_DISTANCE
        self._stood = 0 if moved or not away else self._stood + 1
        self._stood_at = packet.q if moved else self._stood_at
        if self._stood * self._cycle > STANDING_LIMIT:
            self.fail(
                errors.ProtectiveStop(
                    "the arm stands while it is sent on: an emergency or protective stop, its "
                    "drives are off, or a limit of its RSI context holds it. Read its pendant's "
                    "messages, clear the way, then start again."
                ),
                silent=True,
            )

    def _advance(self) -> None:
        by = -self._drop if self._braking else self._drop
        self._rate = min(max(self._rate + by, 0.0), 1.0)
        place = min(self._sent[-1] + self._rate, len(self._rows) - 1.0)
        self._sent.append(place)
        i = int(place)
        following = self._rows[min(i + 1, len(self._rows) - 1)]
        self._command = self._rows[i] + (place - i) * (following - self._rows[i])
