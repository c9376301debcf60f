"""Poses of vehicles, as a tracker or the vehicles themselves send them over an MQTT broker."""

from __future__ import annotations

import time
from queue import Empty, SimpleQueue
from typing import Final, Self
from uuid import uuid4

from tjscan.core.devices import DeviceIdentity, EventListener
from tjscan.core.errors import VehicleLinkLost
from tjscan.vehicle.localisation import TrackedDisc, VehiclePose
from tjscan.vehicle.mqtt.link import BrokerLink, ReceivedMessage
from tjscan.vehicle.mqtt.pose_gate import PoseGate
from tjscan.vehicle.mqtt.settings import MqttLocalisationSettings
from tjscan.vehicle.mqtt.wire import (
    PASSER_BY_TOPIC,
    POSE_TOPIC,
    REPORTED_COUNTS,
    BadMessage,
    PasserByMessage,
    PoseMessage,
    PresenceMessage,
)

READER_TOPIC: Final = "reader"
"""Topic on which a reader of the poses announces itself."""

LOOK_PERIOD: Final = 0.01
"""Seconds between two looks for the first poses."""


class MqttLocalisation:
    """Poses that come over an MQTT broker, behind the `Localisation` protocol.

    Its clock is `time.monotonic`. A link that breaks comes back by itself; meanwhile no poses come.

    Parameters
    ----------
    settings : MqttLocalisationSettings
    vehicles : int
        How many.
    """

    def __init__(self, settings: MqttLocalisationSettings, vehicles: int) -> None:
        self.settings = settings
        self.dropped = 0
        """Messages that were dropped since connecting."""
        self._vehicles = vehicles
        self._listener: EventListener = lambda name, sentence: None
        self._begin()

    def _begin(self) -> None:
        # Single assignments to a place of each vehicle's own are all that the threads share.
        self._newest: list[VehiclePose | None] = [None] * self._vehicles
        self._given: list[VehiclePose | None] = [None] * self._vehicles
        self._passers_by: dict[str, TrackedDisc] = {}
        self._gates: dict[str, PoseGate] = {}
        self._events: SimpleQueue[tuple[str, str]] = SimpleQueue()
        self._connected, self.dropped = False, 0
        s, pose = self.settings, POSE_TOPIC
        self._link = BrokerLink(
            s.host,
            s.port,
            prefix=s.prefix,
            presence_topic=READER_TOPIC,
            presence=PresenceMessage.at_start(uuid4().hex),
            topics=(
                *(f"{number}/{pose}" for number in range(1, self._vehicles + 1)),
                f"{PASSER_BY_TOPIC}/+",
            ),
            receive=self._receive,
            changed=self._link_changed,
        )

    def __enter__(self) -> Self:
        """Connect, and wait until every vehicle was seen.

        Raises
        ------
        VehicleLinkLost
            If there is no broker, or the pose of a vehicle is not sent.
        """
        self._begin()
        s = self.settings
        self._link.connect(s.connect_limit)
        self._connected = True
        until = time.monotonic() + s.connect_limit
        while None in self._newest:
            if time.monotonic() > until:
                self.__exit__()
                missing = ", ".join(str(i + 1) for i, p in enumerate(self._newest) if p is None)
                raise VehicleLinkLost(
                    f"no pose of vehicle {missing} came from the broker at {s.host}:{s.port} on "
                    f"{s.prefix}/N/{POSE_TOPIC}. See that the localisation runs and sees it."
                )
            time.sleep(LOOK_PERIOD)
        return self

    def __exit__(self, *error: object) -> None:
        """Disconnect."""
        if self._connected:
            self._connected = False
            self._link.close()

    @property
    def identity(self) -> DeviceIdentity:
        """Where the poses come from."""
        s = self.settings
        return DeviceIdentity("poses over MQTT", f"{s.host}:{s.port}/{s.prefix}")

    def report_events_to(self, listener: EventListener) -> None:
        """Report dropped poses and lost links. See `Localisation.report_events_to`."""
        self._listener = listener

    def read(self) -> tuple[VehiclePose | None, ...]:
        """Give the newest poses. See `Localisation.read`."""
        self._deliver_events()
        newest = list(self._newest)
        fresh = tuple(
            pose if pose is not before else None
            for pose, before in zip(newest, self._given, strict=True)
        )
        self._given = newest
        return fresh

    def read_passers_by(self) -> tuple[TrackedDisc, ...]:
        """Give what moves through the area. See `Localisation.read_passers_by`."""
        passers_by = dict(self._passers_by)
        return tuple(passers_by[name] for name in sorted(passers_by))

    # What the link's thread does

    def _receive(self, received: ReceivedMessage) -> None:
        try:
            if received.retained:
                raise BadMessage("the broker kept it from before")
            gate = self._gates.setdefault(received.topic, PoseGate())
            first, _, second = received.topic.partition("/")
            if first == PASSER_BY_TOPIC:
                disc = PasserByMessage.from_json(received.payload)
                measured = gate.measured(disc, received.time)
                self._passers_by[second] = TrackedDisc(
                    measured, disc.x, disc.y, disc.radius, disc.vx, disc.vy
                )
            else:
                pose = PoseMessage.from_json(received.payload)
                measured = gate.measured(pose, received.time)
                self._newest[int(first) - 1] = VehiclePose(measured, pose.x, pose.y, pose.heading)
        except BadMessage as error:
            self.dropped += 1
            if self.dropped in REPORTED_COUNTS:
                self._events.put(
                    ("message-dropped", f"on {received.topic}, number {self.dropped}: {error}")
                )

    def _link_changed(self, up: bool) -> None:
        if self._connected:
            said = "stands again" if up else "broke: no poses come"
            self._events.put(
                ("link-restored" if up else "link-lost", f"the link to the broker {said}")
            )

    def _deliver_events(self) -> None:
        while True:
            try:
                self._listener(*self._events.get_nowait())
            except Empty:
                return
