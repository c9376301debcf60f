"""A vehicle as a broker sees it: what it obeys, when it stops, and what it sends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import Final

from tjscan.vehicle.mqtt.link import ReceivedMessage
from tjscan.vehicle.mqtt.wire import (
    COMMAND_TOPIC,
    COMMANDER_TOPIC,
    POSE_TOPIC,
    REPORTED_DROP_COUNTS,
    STATE_TOPIC,
    STOP_TOPIC,
    BadMessage,
    CommandMessage,
    MessageGate,
    PoseMessage,
    PresenceMessage,
    StateMessage,
)
from tjscan.vehicle.vehicle import DEAD_MAN_TIME, Twist, VehicleState
from tjscan_loopback.vehicle.bodies import LoopbackBody
from tjscan_loopback.vehicle.faults import VehicleFaultOrder
from tjscan_loopback.vehicle.torch import LoopbackTorch

DRIVE_FAULT: Final = "left drive: over temperature"


class LoopbackVehicle:
    """A vehicle that obeys messages, and stops by itself.

    It takes the commands of one program, the last that announced itself, unless another one
    commands it. It stops when the dead-man time is over without a command, or the time for which
    the last one may be held; it brakes when its program goes, when its link breaks, and at a drive
    fault.

    Parameters
    ----------
    number : int
        Of the vehicle.
    body : LoopbackBody
        What moves.
    session : str
        Of its messages.
    report_line : callable
        Receives a line when the vehicle begins to move or comes to rest, and with what it drops.
    """

    def __init__(
        self, number: int, body: LoopbackBody, session: str, report_line: Callable[[str], None]
    ) -> None:
        self.number, self.body, self.session = number, body, session
        self.faults: set[VehicleFaultOrder] = set()
        self.link_is_up = True
        """Whether the broker is connected; without, the vehicle brakes."""
        self.dropped = 0
        """Commands that were dropped."""
        self._report_line = report_line
        self._gate, self._stop_gate = MessageGate(), MessageGate()
        self._twist: Twist | None = None
        self._until = self._heard = self._held_until = self._stop_sent = -inf
        self._sent = 0
        self._moving = False
        self._last_state = VehicleState(body.time, Twist(0.0, 0.0))
        self.torch = LoopbackTorch(session)

    def order_fault(self, fault: VehicleFaultOrder) -> None:
        """Bring a fault, or clear them all."""
        if fault is VehicleFaultOrder.CLEAR:
            self.faults.clear()
            self._twist = None
        elif fault is VehicleFaultOrder.PUSH:
            self.body.push()
        else:
            self.faults.add(fault)
        self.body.take_faults(frozenset(self.faults))

    def receive(self, received: ReceivedMessage) -> None:
        """Obey a message, or drop it and report why."""
        if VehicleFaultOrder.FREEZE in self.faults:
            return
        try:
            if received.topic == COMMANDER_TOPIC:
                self._receive_presence(PresenceMessage.from_json(received.payload), received.time)
            elif received.topic == STOP_TOPIC:
                self._receive_stop(received)
            elif received.topic == COMMAND_TOPIC:
                if received.retained:
                    raise BadMessage("the broker kept it from before")
                self._receive_command(CommandMessage.from_json(received.payload), received.time)
            else:
                self.torch.receive(received)
        except BadMessage as error:
            self.dropped += 1
            if self.dropped in REPORTED_DROP_COUNTS:
                self._report_line(f"dropped {self.number} number {self.dropped}: {error}")

    def advance(self, now: float, period: float) -> list[tuple[str, bytes]]:
        """Go on by a period in seconds; returns topic and payload of what is to be sent."""
        frozen = VehicleFaultOrder.FREEZE in self.faults
        if now >= self._until or VehicleFaultOrder.DRIVE_FAULT in self.faults:
            self._twist = None
        if not self.link_is_up:
            self._twist = None
        of_torch = self.torch.advance(now, period)
        self.body.arc_burning = self.torch.arc or VehicleFaultOrder.ARC in self.faults
        state = self.body.advance(self._twist, period)
        if VehicleFaultOrder.DRIVE_FAULT in self.faults:
            state = replace(state, fault=DRIVE_FAULT)
        self._tell_motion(now)
        if frozen:
            return []
        if VehicleFaultOrder.STALE in self.faults:
            state = self._last_state
        else:
            self._sent += 1
        self._last_state = state
        message = StateMessage.of_state(
            state,
            session=self.session,
            number=self._sent,
            time=now,
            commander=self._gate.session,
        )
        payload = message.to_json()
        if VehicleFaultOrder.NAN in self.faults:
            payload = payload.replace(b'"speed":', b'"speed":NaN,"was":')
        sent = [of_torch, (STATE_TOPIC, payload)]
        if self.body.own_pose is not None:
            x, y, heading = self.body.own_pose.tolist()
            at = PoseMessage(
                session=self.session, number=self._sent, time=now, x=x, y=y, heading=heading
            )
            sent.insert(0, (POSE_TOPIC, at.to_json()))  # known to who reads the state
        return sent

    def _receive_presence(self, message: PresenceMessage, now: float) -> None:
        if message.session == self._gate.session:
            if not message.alive:
                self._restart_session("")
        elif message.alive:
            if self._gate.session and now - self._heard < DEAD_MAN_TIME:
                raise BadMessage("another program commands this vehicle")
            self._restart_session(message.session)

    def _restart_session(self, session: str) -> None:
        self._gate.restart_session(session)
        self._stop_gate.restart_session(session)
        self._twist, self._stop_sent = None, -inf

    def _receive_stop(self, received: ReceivedMessage) -> None:
        """Stop, whoever sends it and whatever it holds; commands sent before it are overtaken."""
        self._twist = None
        try:
            message = CommandMessage.from_json(received.payload)
            if reason := self._stop_gate.reason_to_drop(message, received.time):
                raise BadMessage(reason)
        except BadMessage:
            self._held_until = received.time + DEAD_MAN_TIME
            raise
        self._stop_sent = message.time

    def _receive_command(self, message: CommandMessage, now: float) -> None:
        if message.order == "stop":  # whoever sends it, and whatever its number
            self._twist = None
        if not self._gate.session:
            raise BadMessage("its program has not announced itself")
        reason = self._gate.reason_to_drop(message, now)
        if reason:
            if message.order == "stop":
                self._held_until = now + DEAD_MAN_TIME
            raise BadMessage(reason)
        self._heard = now
        if now < self._held_until:
            raise BadMessage("another client of the broker ordered a stop")
        if message.time <= self._stop_sent:
            raise BadMessage("it was sent before a stop")
        on_tracks = message.sideways and not self.body.drives_sideways
        if message.order == "stop" or on_tracks:
            self._twist = None
            if on_tracks:
                raise BadMessage("a vehicle on tracks can't drive sideways")
        else:
            self._twist = message.twist
            self._until = now + min(message.hold, DEAD_MAN_TIME) - self.body.braking_time

    def _tell_motion(self, now: float) -> None:
        if self._moving == self.body.at_rest:
            self._moving = not self._moving
            self._report_line(f"{'moving' if self._moving else 'at rest'} {self.number} {now:.4f}")
