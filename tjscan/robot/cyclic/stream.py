"""What each packet of a controller is answered: joint angles, a row a cycle.

A path is run through by packets, not by the clock. After a fault the arm brakes along its path, and
moves no more.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter, deque
from dataclasses import dataclass
from typing import ClassVar, Final, Generic, TypeVar

import numpy as np

from tjscan.core import errors
from tjscan.core.frames import Array

MOST_LOST: Final = 5
"""Packets that may be lost lately; see `FORGIVEN_SHARE`."""

SHORTEST_PAUSE: Final = 3
"""Unanswered packets in a row after which the arm stands, and its path begins slowly again."""

FORGIVEN_SHARE: Final = 0.01
"""Share of a lost, late or waiting packet that each good one makes up for."""

STANDING_TURN: Final = np.radians(0.01)
"""Radians that no joint of a standing arm turns from where it came to stand: encoders are noisy."""

UNHEARD_DISTANCE: Final = np.radians(0.02)
"""Radians that a joint is away from where it was sent, if the controller heard nothing of it."""

STANDING_LIMIT: Final = 0.3
"""Seconds for which an arm that was sent on may stand: longer than any arm lags."""

CLOCK_TOLERANCE: Final = 0.1
"""Seconds by which the controller's clock may have differed from its cycles lately."""

SETTLING_TIME: Final = 0.2
"""Seconds after a path until the motion may be ended: an arm lags behind what it is sent."""

REMEMBERED_ANSWERS: Final = 4096
"""Answers that may prove not to have been taken."""

CABLE_ADVICE: Final = "See that the arm is at rest and its network cable sits, then start again."
PENDANT_ADVICE: Final = "Read its pendant's messages, clear the way, then start again."


class PacketRefused(Exception):
    """A packet is none that the controller sends; the message states why."""


@dataclass(frozen=True, slots=True, eq=False)
class CyclePacket:
    """State of a controller in one cycle.

    Parameters
    ----------
    stamp : int
        Its number, or its time stamp.
    time : float
        Seconds on the controller's clock.
    q, set_point : ndarray, shape (6,)
        Joint angles as measured, and those that the first answer goes on from, radians.
    tool_b : ndarray, shape (3,)
        Position of the active tool, metres.
    late : int
        How many answers came late or never since the session began, if the controller counts them.
    """

    stamp: int
    time: float
    q: Array
    set_point: Array
    tool_b: Array
    late: int


@dataclass(frozen=True, slots=True, eq=False)
class StreamState:
    """State of the arm and of the joint angles that are sent to it.

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


P = TypeVar("P", bound=CyclePacket)


class CyclicStream(ABC, Generic[P]):
    """Stream of joint angles to one controller.

    Parameters
    ----------
    host : str
        Its IP address; packets of others are ignored.
    cycle : float
        Seconds between two packets.

    Attributes
    ----------
    fault : ArmFault or None
        The first fault: no move is begun after it.
    ended : bool
        Whether the controller was told to end the motion, or is answered no more.
    """

    session: ClassVar[str]
    """What the controller ends when it is not answered."""

    stamp_name: ClassVar[str]
    """What it calls the stamps of its packets."""

    stamps: ClassVar[int] = 2**32
    """Number of stamps, after which they begin again."""

    holds_when_unanswered: ClassVar[bool] = True
    """Whether a controller without an answer holds the arm; else it moves on as it did."""

    standing_causes: ClassVar[str] = ""
    """Behind a colon, why an arm that is sent on may stand, where that is not reported."""

    standing_distance: ClassVar[float] = np.radians(0.5)
    """Radians that a joint is away from where it was sent, if the arm is held."""

    def __init__(self, host: str, cycle: float, *, period: int = 1, smoothed: int = 1) -> None:
        self._host, self._cycle, self._period = host, cycle, period
        self.fault: errors.ArmFault | None = None
        self.ended = self._leaving = False
        self._packet: P | None = None
        self._port, self._time = 0, 0.0
        self.ignored: Counter[str] = Counter()
        self._lost = self._late = self._waited = self._clock_error = 0.0
        self._unheard = self._stood = self._rested = self._paused = 0
        self._stood_at = np.full(6, np.inf)
        self._recent: deque[Array] = deque(maxlen=smoothed)
        self._base = np.zeros(6)
        self._follow(self._base[None], cycle)

    @abstractmethod
    def _parse(self, data: bytes) -> P:
        """Parse a packet; raises PacketRefused if it is none."""

    @abstractmethod
    def _format(self, command: Array, packet: P, *, stop: bool) -> bytes:
        """Answer to a packet: joint angles, and whether the motion is to end."""

    def _unready_reason(self, packet: P) -> str | None:
        """Why a packet is not answered before the first that is; None if it is that."""
        return None

    def _first_fault(self, packet: P) -> errors.ArmFault | None:
        """What is wrong with the first packet that is answered."""
        return None

    def _reported_fault(self, packet: P) -> errors.ArmFault | None:
        """What a packet reports of the controller's own state."""
        return None

    def _standing_fault(self) -> errors.ArmFault:
        """Why an arm that is sent on stands."""
        return errors.ProtectiveStop(
            f"the arm stands while it is sent on{self.standing_causes}. {PENDANT_ADVICE}"
        )

    @property
    def _standing_limit(self) -> float:
        """Seconds for which an arm that was sent on may stand: longer than it lags."""
        return STANDING_LIMIT

    def _answers_are_lost(self) -> bool:
        """Whether several answers did not reach the controller in time lately."""
        return self._late > 1

    def greetings(self) -> list[bytes]:
        """What makes the controller send, as long as it does not."""
        return []

    def farewells(self) -> list[bytes]:
        """What ends the session after the last answer."""
        return []

    def is_from_controller(self, sender: tuple[str, int]) -> bool:
        """Whether an address is the controller's."""
        return sender[0] == self._host and self._port in (0, sender[1])

    def answer(self, data: bytes, sender: tuple[str, int]) -> bytes | None:
        """Answer to a packet; None if it is not answered."""
        if not self.is_from_controller(sender):
            self.ignored["from another address"] += 1
            return None
        try:
            packet = self._parse(data)
        except PacketRefused as refused:
            self.fail(
                errors.ArmConnectionLost(
                    f"a packet of the arm's controller is refused: {refused}. {CABLE_ADVICE}"
                )
            )
            return None
        lost = 0
        if self._packet is None:
            if (reason := self._unready_reason(packet)) is not None:
                self.ignored[reason] += 1
                return None
            self._begin(packet, sender[1])
        else:
            ahead = (packet.stamp - self._packet.stamp + self.stamps // 2) % self.stamps
            ahead -= self.stamps // 2
            if ahead <= 0:
                which = "a repeated" if ahead == 0 else "an older"
                self.ignored[f"with {which} {self.stamp_name}"] += 1
                return None
            lost = self._note_gap(self._packet, packet, ahead)
            self._check_arm_follows(packet)
        self._packet = packet
        if self.ended:
            return None
        for _ in range(1 if self.holds_when_unanswered else 1 + min(lost, MOST_LOST)):
            self._advance()
        self._rested = 0 if self.moving else self._rested + 1
        self.ended = self._leaving and self._rested * self._cycle > SETTLING_TIME
        command = np.mean(self._recent, axis=0) if len(self._recent) > 1 else self._command
        return self._format(command, packet, stop=self.ended)

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
        return StreamState(
            self._time, now.q, self._command, now.tool_b, self.moving, dict(self.ignored)
        )

    @property
    def connected(self) -> bool:
        """Whether a packet of the controller was answered."""
        return self._packet is not None

    @property
    def moving(self) -> bool:
        """Whether a path is run through, or the mean of what was sent lately still changes."""
        held = self._braking and self._rate == 0
        if not held and self._sent[-1] < len(self._rows) - 1:
            return True
        return any((row != self._command).any() for row in self._recent)

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
        """Come to rest for a fault; `silent` answers no more: the controller then ends it."""
        if self.fault is None:
            self.fault = fault
        self.ended = self.ended or silent
        self.brake()

    def note_waiting(self, count: int) -> None:
        """Note how many packets waited for this program at once, of which one is in time."""
        self._waited = max(self._waited - FORGIVEN_SHARE * count, count - 1)

    def fail_for_silence(self, seconds: float) -> None:
        """Fail because no new packet came for some seconds, by which side fell silent first.

        Nothing is answered any more: a program that is started again goes on from where the arm is.
        """
        if self._answers_are_lost():
            self.fail(self._lost_answers_fault())
        self.fail(
            errors.ArmNotResponding(
                f"nothing new came from the arm's controller for {seconds:g} s: {self.session} has "
                f"ended, or it is silent{self._told_ignored()}. Read its pendant's messages, then "
                "start again."
            ),
            silent=True,
        )

    def _lost_answers_fault(self) -> errors.ArmFault:
        if self._waited >= 1:
            return errors.MoveSupervisionLost(
                f"this computer was held up ({self._waited + 1:.0f} packets of the arm's "
                f"controller waited for an answer), and the controller has ended {self.session}. "
                "See that nothing else keeps this computer busy, then start again."
            )
        return errors.ArmConnectionLost(
            f"answers did not reach the arm's controller in time, and it has ended {self.session}: "
            f"the network, or this computer, is too slow{self._told_ignored()}. {CABLE_ADVICE}"
        )

    def _told_ignored(self) -> str:
        return "".join(
            f"; {count} packets {what} were ignored" for what, count in self.ignored.items()
        )

    def _follow(self, q: Array, ramp: float) -> None:
        self._rows, self._drop = q, self._cycle / max(ramp, self._cycle)
        self._sent: deque[float] = deque([0.0], maxlen=REMEMBERED_ANSWERS)
        self._rate, self._braking = 1.0, False
        self._command = q[0]

    def _begin(self, packet: P, port: int) -> None:
        self._port, self._base, self._time = port, packet.set_point, packet.time
        self._follow(self._base[None], self._cycle)
        self._recent.extend([self._base] * (self._recent.maxlen or 1))
        if (fault := self._first_fault(packet)) is not None:
            self.fail(fault, silent=True)

    def _note_gap(self, before: P, packet: P, ahead: int) -> int:
        """Go back to what the controller has taken, if it holds that; returns packets lost."""
        lost = ahead // self._period - 1
        late = max(packet.late - before.late, 0)
        if lost > 0:
            self.ignored["that never came"] += lost
        self._lost = max(self._lost - FORGIVEN_SHARE, 0.0) + max(lost, 0)
        self._late = max(self._late - FORGIVEN_SHARE, 0.0) + late
        passed = packet.time - before.time
        if passed < 0:  # its clock began again
            passed = (lost + 1) * self._cycle
        self._time += passed
        self._clock_error *= 1 - FORGIVEN_SHARE
        self._clock_error += passed - (lost + 1) * self._cycle
        out_of_step = ahead % self._period > 0 or abs(self._clock_error) > CLOCK_TOLERANCE
        if out_of_step or self._lost > MOST_LOST:
            self.fail(
                errors.ArmConnectionLost(
                    f"the {self.stamp_name} of the arm's controller jumped from {before.stamp} to "
                    f"{packet.stamp} in {1e3 * passed:.0f} ms, where cycle_ms = "
                    f"{1e3 * self._cycle:g}. See that this is its cycle and the network loses "
                    f"nothing. {CABLE_ADVICE}"
                ),
                # Long enough for a program that was started again, whatever its stamps are.
                silent=lost > MOST_LOST or passed > (lost + 1 + MOST_LOST) * self._cycle,
            )
        self._paused = self._paused + max(late, lost) if max(late, lost) > 0 else 0
        if self.holds_when_unanswered:
            if self._paused >= SHORTEST_PAUSE:
                self._rate = 0.0
            for _ in range(min(late - lost, len(self._sent) - 1)):
                self._sent.pop()
        return lost

    def _check_arm_follows(self, packet: P) -> None:
        if (fault := self._reported_fault(packet)) is not None:
            self.fail(fault, silent=True)
        moved = np.abs(packet.q - self._stood_at).max() > STANDING_TURN
        apart = np.abs(packet.q - self._command).max()
        self._unheard = 0 if moved or apart < UNHEARD_DISTANCE else self._unheard + 1
        self._stood = 0 if moved or apart < self.standing_distance else self._stood + 1
        self._stood_at = packet.q if moved else self._stood_at
        if self._stood * self._cycle > self._standing_limit:
            self.fail(self._standing_fault(), silent=True)

    def _advance(self) -> None:
        by = -self._drop if self._braking else self._drop
        self._rate = min(max(self._rate + by, 0.0), 1.0)
        place = min(self._sent[-1] + self._rate, len(self._rows) - 1.0)
        self._sent.append(place)
        i = int(place)
        following = self._rows[min(i + 1, len(self._rows) - 1)]
        self._command = self._rows[i] + (place - i) * (following - self._rows[i])
        self._recent.append(self._command)
