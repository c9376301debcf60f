"""Poses of vehicles, as a tracker or the vehicles themselves send them over an MQTT broker."""

from __future__ import annotations

import time
from collections import defaultdict
from typing import Final

from tjscan.core.devices import DeviceIdentity
from tjscan.core.errors import VehicleLinkLost
from tjscan.vehicle.localisation import TrackedDisc, VehiclePose
from tjscan.vehicle.mqtt import wire
from tjscan.vehicle.mqtt.link import BrokerClient, ReceivedMessage
from tjscan.vehicle.mqtt.settings import MqttLocalisationSettings

POSE_READER_TOPIC: Final = "reader"
"""Topic on which a reader of the poses announces itself."""

LOOK_PERIOD: Final = 0.01
"""Seconds between two looks for the first poses."""


class MqttLocalisation(BrokerClient):
    """Poses that come over an MQTT broker, behind the `Localisation` protocol.

    Its clock is `time.monotonic`. A link that breaks comes back by itself; meanwhile no poses come.

    Parameters
    ----------
    settings : MqttLocalisationSettings
    vehicles : int
        How many.
    """

    def __init__(self, settings: MqttLocalisationSettings, vehicles: int) -> None:
        self.settings, self._vehicles = settings, vehicles
        poses = (f"{number}/{wire.POSE_TOPIC}" for number in range(1, vehicles + 1))
        super().__init__(settings, POSE_READER_TOPIC, (*poses, f"{wire.PASSER_BY_TOPIC}/+"))

    def _reset_before_connecting(self) -> None:
        # Single assignments to a place of each vehicle's own are all that the threads share.
        self._newest: list[VehiclePose | None] = [None] * self._vehicles
        self._given: list[VehiclePose | None] = [None] * self._vehicles
        self._passers_by: dict[str, TrackedDisc] = {}
        self._gates: defaultdict[str, wire.PoseGate] = defaultdict(wire.PoseGate)
        super()._reset_before_connecting()

    def _wait_until_ready(self) -> None:
        """Wait until every vehicle was seen."""
        s = self.settings
        until = time.monotonic() + s.connect_limit
        while None in self._newest:
            if time.monotonic() > until:
                missing = ", ".join(str(i + 1) for i, p in enumerate(self._newest) if p is None)
                raise VehicleLinkLost(
                    f"no pose of vehicle {missing} came from the broker at {s.host}:{s.port} on "
                    f"{s.prefix}/N/{wire.POSE_TOPIC}. See that the localisation runs and sees it."
                )
            time.sleep(LOOK_PERIOD)

    @property
    def identity(self) -> DeviceIdentity:
        """Broker and topics that the poses come from."""
        s = self.settings
        return DeviceIdentity("poses over MQTT", f"{s.host}:{s.port}/{s.prefix}")

    def read(self) -> tuple[VehiclePose | None, ...]:
        """Give the newest poses. See `Localisation.read`."""
        self._deliver_events()
        before, self._given = self._given, list(self._newest)
        return tuple(
            new if new is not old else None for new, old in zip(self._given, before, strict=True)
        )

    def read_passers_by(self) -> tuple[TrackedDisc, ...]:
        """Give what moves through the area. See `Localisation.read_passers_by`."""
        passers_by = dict(self._passers_by)
        return tuple(passers_by[name] for name in sorted(passers_by))

    def _handle_message(self, received: ReceivedMessage) -> None:
        if received.retained:
            raise wire.BadMessage("the broker kept it from before")
        gate = self._gates[received.topic]
        first, _, second = received.topic.partition("/")
        if first == wire.PASSER_BY_TOPIC:
            disc = wire.PasserByMessage.from_json(received.payload)
            measured = gate.measuring_time(disc, received.time)
            self._passers_by[second] = TrackedDisc(
                measured, disc.x, disc.y, disc.radius, disc.vx, disc.vy
            )
        else:
            pose = wire.PoseMessage.from_json(received.payload)
            measured = gate.measuring_time(pose, received.time)
            self._newest[int(first) - 1] = VehiclePose(measured, pose.x, pose.y, pose.heading)

    def _link_changed(self, up: bool) -> None:
        if self._connected:
            name, state = ("restored", "is up again") if up else ("lost", "broke: no poses come")
            self._events.put((f"link-{name}", f"the link to the broker {state}"))
