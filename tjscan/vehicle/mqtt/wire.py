"""Messages between a program and a vehicle, as JSON: what is none is refused, and never steers."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import cache
from math import inf, isfinite
from time import monotonic
from typing import Annotated, Any, ClassVar, Final, Literal, Self

from annotated_types import Ge, Le, Len
from pydantic import TypeAdapter, ValidationError

from tjscan.core.units import STRICT_TABLE
from tjscan.core.version import PROGRAM_VERSION
from tjscan.vehicle.vehicle import PROXIMITY_CORNERS, Twist, VehicleState

COMMAND_TOPIC: Final = "command"
STOP_TOPIC: Final = "stop"
"""Beside ``command``, and heard over a connection of its own: nothing waits before a stop there."""

COMMANDER_TOPIC: Final = "commander"
STATE_TOPIC: Final = "state"
PRESENCE_TOPIC: Final = "vehicle"
POSE_TOPIC: Final = "pose"
PASSER_BY_TOPIC: Final = "passer-by"

MOST_MESSAGE_BYTES: Final = 4096
"""No message is longer."""

LONGEST_MESSAGE_DELAY: Final = 0.25
"""Seconds by which a message may come later than the quickest one did: half the dead-man time."""

MOST_MESSAGES_LOST: Final = 1000
"""Messages on a topic by which a number may leap; and as many for each second of silence."""

LEAST_CLOCK_JUMP: Final = 2.0
"""Seconds: what comes later, or earlier, than this after the quickest has another clock."""

LARGEST_CLOCK_RATE_ERROR: Final = 1e-3
"""By how much two clocks may differ in rate."""

REPORTED_DROP_COUNTS: Final = frozenset(10**n for n in range(10))
"""The first message that is dropped is reported, then the tenth, the hundredth, and so on."""

Session = Annotated[str, Len(4, 64)]
Number = Annotated[int, Ge(0), Le(2**53)]
Seconds = Annotated[float, Ge(-1e12), Le(1e12)]
Metres = Annotated[float, Ge(-1e6), Le(1e6)]
Speed = Annotated[float, Ge(-10), Le(10)]
TurnRate = Annotated[float, Ge(-100), Le(100)]
Angle = Annotated[float, Ge(-10), Le(10)]
Torque = Annotated[float, Ge(-1e6), Le(1e6)]
Force = Annotated[float, Ge(-1e6), Le(1e6)]
Distance = Annotated[float, Ge(0), Le(100)]


class BadMessage(ValueError):
    """What came is no message of the kind that its topic carries."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WireMessage:
    """What every message holds.

    Parameters
    ----------
    session : str
        Drawn by each sender when it starts.
    number : int
        Grows with every message of the session on one topic.
    time : float
        Seconds on the sender's clock, which never goes back.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT_TABLE

    session: Session
    number: Number
    time: Seconds

    @classmethod
    def from_json(cls, payload: bytes) -> Self:
        """Read a message.

        Raises
        ------
        BadMessage
            If it is not JSON, lacks a key, has one too many, or a value of the wrong type or out
            of its range; NaN is out of every range.
        """
        if len(payload) > MOST_MESSAGE_BYTES:
            raise BadMessage(f"it is {len(payload)} bytes long")
        try:
            message: Self = _type_adapter(cls).validate_json(payload)  # type: ignore[arg-type]
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise BadMessage(f"{where}: {first['msg']}" if where else first["msg"]) from None
        return message

    def to_json(self) -> bytes:
        """Write it.

        Raises
        ------
        ValueError
            If it holds NaN.
        """
        return json.dumps(asdict(self), allow_nan=False, separators=(",", ":")).encode()


@cache
def _type_adapter(kind: type[WireMessage]) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandMessage(WireMessage):
    """On ``command``: drive with a twist, or stop.

    Parameters
    ----------
    order : str
        ``drive`` or ``stop``.
    speed, turn_rate, sideways : float
        The twist, m/s and rad/s.
    hold : float
        Seconds from its sending for which it may be held: what is left of the dead-man time.
    """

    order: Literal["drive", "stop"]
    speed: Speed = 0.0
    turn_rate: TurnRate = 0.0
    sideways: Speed = 0.0
    hold: Annotated[float, Ge(0), Le(10)] = 0.0

    @property
    def twist(self) -> Twist:
        """What to drive."""
        return Twist(self.speed, self.turn_rate, self.sideways)


@dataclass(frozen=True, slots=True, kw_only=True)
class StateMessage(WireMessage):
    """On ``state``: what the vehicle reports of itself; see `VehicleState`.

    Parameters
    ----------
    clock : float
        When the state was taken, seconds on the clock of the vehicle's motion.
    speed, turn_rate, sideways : float
        The twist that the encoders show, m/s and rad/s.
    torques : tuple of float
        Of the motors, N m; empty if not known.
    proximity : tuple of float or None
        At each of `PROXIMITY_CORNERS`, metres; null if nothing is in reach, empty without a sample.
    fault : str
        Of the drives; empty if they are well.
    commander : str
        Session of the program whose commands it takes; empty if there is none.
    gyro, down, push : tuple of float
        Turn rate by a gyro, rad/s, direction of down by an inclinometer, radians, and the wheels'
        push, newton and N m; empty without a sample, or left out.
    """

    clock: Seconds
    speed: Speed
    turn_rate: TurnRate
    sideways: Speed
    torques: Annotated[tuple[Torque, ...], Len(0, 16)] = ()
    proximity: Annotated[tuple[Distance | None, ...], Len(0, len(PROXIMITY_CORNERS))] = ()
    fault: Annotated[str, Len(0, 500)] = ""
    commander: Annotated[str, Len(0, 64)] = ""
    gyro: Annotated[tuple[TurnRate, ...], Len(0, 1)] = ()
    down: Annotated[tuple[Angle, ...], Len(0, 1)] = ()
    push: Annotated[tuple[Force, ...], Len(0, 3)] = ()

    def __post_init__(self) -> None:
        if len(self.proximity) not in (0, len(PROXIMITY_CORNERS)):
            raise ValueError(f"proximity holds {len(PROXIMITY_CORNERS)} distances or none")
        if len(self.push) not in (0, 3):
            raise ValueError("push holds two forces and a moment or nothing")

    @classmethod
    def of_state(
        cls, state: VehicleState, *, session: str, number: int, time: float, commander: str = ""
    ) -> Self:
        """State as a message."""
        return cls(
            session=session,
            number=number,
            time=time,
            clock=state.time,
            **asdict(state.odometry),
            torques=state.torques,
            proximity=tuple(d if isfinite(d) else None for d in state.proximity),
            fault=state.fault,
            commander=commander,
            gyro=state.gyro,
            down=state.down,
            push=state.push,
        )

    @property
    def state(self) -> VehicleState:
        """The state that it holds; inf if a sensor sees nothing."""
        return VehicleState(
            self.clock,
            Twist(self.speed, self.turn_rate, self.sideways),
            self.torques,
            tuple(inf if d is None else d for d in self.proximity),
            self.fault,
            self.gyro,
            self.down,
            self.push,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PresenceMessage(WireMessage):
    """On ``vehicle`` and ``commander``, retained: who is there, or by the last will, who is gone.

    Parameters
    ----------
    alive : bool
        Whether the sender is there.
    model, serial, software : str
        Which vehicle, or program, it is.
    """

    alive: bool
    model: Annotated[str, Len(0, 200)] = ""
    serial: Annotated[str, Len(0, 200)] = ""
    software: Annotated[str, Len(0, 200)] = ""

    @classmethod
    def at_start(cls, session: str, model: str = "tjscan", serial: str = "") -> Self:
        """The first message of a sender of this software."""
        return cls(
            session=session,
            number=0,
            time=monotonic(),
            alive=True,
            model=model,
            serial=serial,
            software=PROGRAM_VERSION,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseMessage(WireMessage):
    """On ``pose``: where the vehicle is in frame w, as a stand-in or a tracker knows it.

    Parameters
    ----------
    x, y : float
        Of the vehicle's origin, metres.
    heading : float
        From x towards y, radians.
    """

    x: Metres
    y: Metres
    heading: Annotated[float, Ge(-1e6), Le(1e6)]


@dataclass(frozen=True, slots=True, kw_only=True)
class PasserByMessage(WireMessage):
    """On ``passer-by/1`` and so on, below the team's prefix: what moves through the area.

    Parameters
    ----------
    x, y, radius : float
        Of a disc that covers it, metres, in frame w.
    vx, vy : float
        Its speed, m/s.
    """

    x: Metres
    y: Metres
    radius: Annotated[float, Ge(0), Le(100)]
    vx: Speed
    vy: Speed


class MessageGate:
    """Lets the messages of one session on one topic through, in order and in time.

    The clocks of sender and receiver need not agree. How late a message is counts from the
    quickest one so far.
    """

    def __init__(self) -> None:
        self.session = ""
        """Whose messages come through; of the first that comes if it is empty."""
        self._last: tuple[int, float] | None = None
        self._offset, self._heard = inf, 0.0

    def restart_session(self, session: str = "") -> None:
        """Begin again, with the messages of a session, or of the first that comes."""
        self.session, self._last, self._offset = session, None, inf

    def reason_to_drop(self, message: WireMessage, now: float) -> str:
        """Why a message must be dropped, in a sentence; empty if it is let through.

        Parameters
        ----------
        message : WireMessage
            What came.
        now : float
            When, in seconds on the receiver's clock.
        """
        if self.session and message.session != self.session:
            return "it is of another session"
        if self._last is not None:
            number, time = self._last
            if message.number <= number:
                return f"number {message.number} came after {number}"
            if message.number > number + MOST_MESSAGES_LOST * (1.0 + now - self._heard):
                return f"number {message.number} leaps ahead of {number}"
            if not time < message.time < now - self._offset + LEAST_CLOCK_JUMP:
                return f"its clock went from {time:.3f} s to {message.time:.3f} s"
        offset = now - message.time
        quickest = min(offset, self._offset + LARGEST_CLOCK_RATE_ERROR * (now - self._heard))
        self.session, self._last = message.session, (message.number, message.time)
        self._offset, self._heard = quickest, now
        if offset - quickest > LONGEST_MESSAGE_DELAY:
            return f"it came {offset - quickest:.2f} s late"
        return ""


TORCH_TOPIC: Final = "torch"
TORCH_COMMANDER_TOPIC: Final = "torch-commander"
TORCH_STATE_TOPIC: Final = "torch-state"

Place = Annotated[float, Ge(-10), Le(10)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TorchMessage(WireMessage):
    """On ``torch``: where the torch has to be, and whether its arc burns.

    Parameters
    ----------
    y, z : float
        To the right of the vehicle's middle, and out of the hull, metres.
    arc : bool
        Whether the arc burns.
    hold : float
        Seconds from its sending after which the arc has to go out without a further message.
    """

    y: Place
    z: Place
    arc: bool
    hold: Annotated[float, Ge(0), Le(10)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TorchStateMessage(WireMessage):
    """On ``torch-state``: where the torch is, some 100 times a second.

    Parameters
    ----------
    y, z : float
        To the right of the vehicle's middle, and out of the hull, metres.
    arc : bool
        Whether the arc burns.
    fault : str
        Of its axes or its power source; empty if they are well.
    """

    y: Place
    z: Place
    arc: bool
    fault: Annotated[str, Len(0, 500)] = ""


TAKEOVER_SILENCE: Final = 0.5
"""Seconds of silence after which another sender may take over."""

OTHER_CLOCK_CONFIRMATIONS: Final = 10
"""Messages in a row that must agree on another clock before it counts."""


class PoseGate:
    """Lets the poses of one topic through, and dates them on the receiver's clock.

    The clocks of sender and receiver need not agree: the quickest message so far took no time, and
    how late another is counts from that. Unlike a command, a late pose is worth something, as long
    as it is known how old it is. A delay that all of them have is not seen.
    """

    def __init__(self) -> None:
        self._session, self._number = "", -1
        self._offset, self._heard, self._given = inf, -inf, -inf
        self._doubted: tuple[float, int] = (inf, 0)

    def measuring_time(self, message: WireMessage, now: float) -> float:
        """When it was measured, seconds on the receiver's clock.

        Parameters
        ----------
        message : WireMessage
            What came.
        now : float
            When, seconds on the receiver's clock.

        Raises
        ------
        BadMessage
            If it is of another sender, came out of order, or its clock can't be right.
        """
        if message.session != self._session:
            if now - self._heard < TAKEOVER_SILENCE:
                raise BadMessage("it is of another session")
            self._session, self._number, self._offset = message.session, -1, inf
        if message.number <= self._number:
            raise BadMessage(f"number {message.number} came after {self._number}")
        self._number = message.number
        offset = now - message.time
        known = self._offset + LARGEST_CLOCK_RATE_ERROR * (now - self._heard)
        self._heard = now
        if (
            self._offset < inf
            and abs(offset - known) > LEAST_CLOCK_JUMP
            and not self._confirm_other_clock(offset)
        ):
            raise BadMessage(f"its clock is {known - offset:+.2f} s off, or it came late")
        self._offset = offset if abs(offset - known) > LEAST_CLOCK_JUMP else min(offset, known)
        self._doubted = (inf, 0)
        measured = message.time + self._offset
        if measured <= self._given:
            raise BadMessage("it was measured before the last one")
        self._given = measured
        return measured

    def _confirm_other_clock(self, offset: float) -> bool:
        """Whether enough messages in a row have this other clock."""
        before, times = self._doubted
        self._doubted = (offset, times + 1 if abs(offset - before) < LONGEST_MESSAGE_DELAY else 1)
        return self._doubted[1] >= OTHER_CLOCK_CONFIRMATIONS
