"""The torch of a vehicle behind an MQTT broker."""

from __future__ import annotations

import threading
import time

from tjscan.core.errors import DriveFault, VehicleLinkLost
from tjscan.vehicle.mqtt import wire
from tjscan.vehicle.mqtt.link import BrokerClient, ReceivedMessage
from tjscan.vehicle.mqtt.settings import MqttSettings


class MqttTorch(BrokerClient):
    """Torch axes and an arc over the link of the vehicle that carries them.

    Every call of `move` sends the place where the torch has to be, and for how long the arc may
    burn without a further one; so it goes out if this program hangs, and by its last will if it is
    gone.

    Parameters
    ----------
    settings : MqttSettings
        Of the vehicle.
    reach : float
        To either side of the vehicle's middle, metres.
    """

    def __init__(self, settings: MqttSettings, reach: float) -> None:
        self._settings, self._reach = settings, reach
        self._y = self._z = 0.0
        super().__init__(settings, wire.TORCH_COMMANDER_TOPIC, (wire.TORCH_STATE_TOPIC,))

    def _reset_before_connecting(self) -> None:
        self._arc = False
        self._state: wire.TorchStateMessage | None = None
        self._heard, self._first = time.monotonic(), threading.Event()
        self._gate = wire.MessageGate()
        super()._reset_before_connecting()

    def _wait_until_ready(self) -> None:
        """Wait for the torch's first state."""
        if not self._first.wait(self._settings.connect_limit):
            raise VehicleLinkLost(
                f"no torch answers on {self._settings.prefix}/{wire.TORCH_STATE_TOPIC}. Is it "
                'switched on? A vehicle without one takes torch.driver = "none".'
            )

    def _leave_at_rest(self) -> None:
        """Put the arc out."""
        if self._state is not None:
            self.set_arc(burning=False)

    @property
    def arc(self) -> bool:
        """Whether the arc burns, as the torch reports."""
        return self._state is not None and self._state.arc

    def move(self, y: float, z: float, period: float) -> float:
        """Send the torch to a place; returns where it is. See `TorchAxes.move`.

        Raises
        ------
        VehicleLinkLost
            If nothing was heard of it for too long.
        DriveFault
            If it reports a fault.
        """
        self._note_call()
        self._y, self._z = min(max(y, -self._reach), self._reach), z
        self._send_command()
        state = self._state
        limit = self._settings.silence_limit
        if state is None or time.monotonic() - self._heard > limit:
            raise VehicleLinkLost(
                self._held_up(limit)
                or f"the torch of {self._settings.prefix} has been silent for "
                f"{time.monotonic() - self._heard:.1f} s"
            )
        if state.fault:
            raise DriveFault(f"the torch reports: {state.fault}. Mend it, then start again.")
        return state.y

    def set_arc(self, *, burning: bool) -> None:
        """Strike the arc, or end it."""
        self._arc = burning
        self._send_command()

    def _send_command(self) -> None:
        place = {"y": self._y, "z": self._z, "arc": self._arc, "hold": self._settings.dead_man}
        self._publish(wire.TORCH_TOPIC, wire.TorchMessage, time.monotonic(), **place)

    def _handle_message(self, received: ReceivedMessage) -> None:
        """Take in a state; what is none is dropped, and silence shows it."""
        if received.retained:
            return
        message = wire.TorchStateMessage.from_json(received.payload)
        if not self._gate.reason_to_drop(message, received.time):
            self._state, self._heard = message, received.time
            self._first.set()
