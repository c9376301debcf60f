"""A torch as a broker sees it: where it goes, and when its arc goes out."""

from __future__ import annotations

from math import inf
from typing import Final

from tjscan.vehicle.mqtt.link import ReceivedMessage
from tjscan.vehicle.mqtt.wire import (
    TORCH_COMMANDER_TOPIC,
    TORCH_STATE_TOPIC,
    TORCH_TOPIC,
    BadMessage,
    MessageGate,
    PresenceMessage,
    TorchMessage,
    TorchStateMessage,
)
from tjscan.vehicle.vehicle import DEAD_MAN_TIME

AXIS_SPEED: Final = 0.1
"""Of the torch's axes, m/s."""


class LoopbackTorch:
    """A torch that obeys messages, and whose arc goes out by itself.

    Parameters
    ----------
    session : str
        Of its messages.
    """

    def __init__(self, session: str) -> None:
        self._session = session
        self._gate = MessageGate()
        self._y = self._z = 0.0
        self._order: TorchMessage | None = None
        self._until = -inf
        self._sent = 0
        self.arc = False
        """Whether the arc burns."""

    def receive(self, received: ReceivedMessage) -> None:
        """Obey a message.

        Raises
        ------
        BadMessage
            If it is to be dropped.
        """
        if received.topic == TORCH_COMMANDER_TOPIC:
            message = PresenceMessage.from_json(received.payload)
            if message.alive:
                self._gate.restart_session(message.session)
            elif message.session == self._gate.session:
                self._order = None
        elif received.topic == TORCH_TOPIC:
            if received.retained:
                raise BadMessage("the broker kept it from before")
            order = TorchMessage.from_json(received.payload)
            reason = self._gate.reason_to_drop(order, received.time)
            if reason:
                raise BadMessage(reason)
            self._order, self._until = order, received.time + min(order.hold, DEAD_MAN_TIME)

    def advance(self, now: float, period: float) -> tuple[str, bytes]:
        """Go on by a period in seconds; returns topic and payload of what is to be sent."""
        if now >= self._until:
            self._order = None
        order = self._order
        self.arc = order is not None and order.arc
        if order is not None:
            step = AXIS_SPEED * period
            self._y += min(max(order.y - self._y, -step), step)
            self._z = order.z
        self._sent += 1
        state = TorchStateMessage(
            session=self._session,
            number=self._sent,
            time=now,
            y=self._y,
            z=self._z,
            arc=self.arc,
        )
        return TORCH_STATE_TOPIC, state.to_json()
