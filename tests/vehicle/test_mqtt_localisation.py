"""Poses through a real broker."""

import threading
import time
from collections.abc import Callable, Iterator
from itertools import count
from typing import Self

import pytest

from tjscan.core.errors import VehicleLinkLost
from tjscan_loopback.broker import MosquittoProcess, find_mosquitto

pytest.importorskip("paho.mqtt", reason="paho-mqtt is not installed")
pytestmark = pytest.mark.skipif(find_mosquitto() is None, reason="mosquitto is not installed")

from tjscan.vehicle.localisation import VehiclePose  # noqa: E402
from tjscan.vehicle.mqtt.link import BrokerLink  # noqa: E402
from tjscan.vehicle.mqtt.localisation import MqttLocalisation  # noqa: E402
from tjscan.vehicle.mqtt.settings import BrokerSettings, MqttLocalisationSettings  # noqa: E402
from tjscan.vehicle.mqtt.wire import PasserByMessage, PoseMessage, PresenceMessage  # noqa: E402

LONGEST = 10.0
"""Seconds that a message may take on a busy machine."""


class Tracker:
    """Sends the poses of two vehicles all the time, from a clock that is an hour behind."""

    def __init__(self, broker: MosquittoProcess) -> None:
        self.x = 1.0
        """Of both vehicles."""
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._send, daemon=True)
        self.link = BrokerLink(
            BrokerSettings(port=broker.port, prefix="yard"),
            presence_topic="tracker",
            presence=PresenceMessage(session="tracker", number=0, time=0.0, alive=True),
            topics=(),
            receive=lambda received: None,
            changed=lambda up: None,
        )

    def __enter__(self) -> Self:
        self.link.connect(LONGEST)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._done.set()
        self._thread.join()
        self.link.close()

    def _send(self) -> None:
        for number in count():
            if self._done.wait(0.02):
                return
            pose = PoseMessage(
                session="tracker",
                number=number,
                time=time.monotonic() - 3600,
                x=self.x,
                y=2.0,
                heading=0.3,
            )
            for vehicle in (1, 2):
                self.link.publish(f"{vehicle}/pose", pose.to_json())


@pytest.fixture
def broker() -> Iterator[MosquittoProcess]:
    with MosquittoProcess() as process:
        yield process


def localisation(broker: MosquittoProcess, limit: float = LONGEST) -> MqttLocalisation:
    settings = MqttLocalisationSettings(port=broker.port, prefix="yard", connect_limit=limit)
    return MqttLocalisation(settings, 2)


def read_until(eyes: MqttLocalisation, true: Callable[[VehiclePose | None], bool]) -> None:
    """Read until that is true of the first vehicle's pose."""
    until = time.monotonic() + LONGEST
    while not true(eyes.read()[0]):
        assert time.monotonic() < until
        time.sleep(0.01)


def test_poses_come_dated_on_the_readers_clock(broker: MosquittoProcess) -> None:
    with Tracker(broker) as tracker, localisation(broker) as eyes:
        first, second = eyes.read()
        assert first is not None
        assert second is not None
        assert first.time == pytest.approx(time.monotonic(), abs=1.0)
        assert (first.x, first.y, first.heading) == (1.0, 2.0, 0.3)
        tracker.link.publish("1/pose", b'{"session":"tracker","number":10000,"x":NaN}')
        disc = PasserByMessage(
            session="tracker", number=1, time=1.0, x=3.0, y=1.0, radius=0.2, vx=0.1, vy=0.0
        )
        tracker.link.publish("passer-by/1", disc.to_json())
        tracker.x = 5.0
        read_until(eyes, lambda pose: pose is not None and pose.x == 5.0)
        assert eyes.dropped == 1
        assert [seen.radius for seen in eyes.read_passers_by()] == [0.2]


def test_a_broker_that_dies_is_reported_and_poses_come_again(broker: MosquittoProcess) -> None:
    events: list[str] = []
    eyes = localisation(broker)
    eyes.report_events_to(lambda name, sentence: events.append(name))
    with Tracker(broker), eyes:
        broker.kill()
        read_until(eyes, lambda pose: "link-lost" in events)
        read_until(eyes, lambda pose: pose is None)
        broker.start()
        read_until(eyes, lambda pose: "link-restored" in events and pose is not None)
    assert [name for name in events if name.startswith("link")] == ["link-lost", "link-restored"]


def test_a_vehicle_that_nobody_sees_is_named(broker: MosquittoProcess) -> None:
    with pytest.raises(VehicleLinkLost, match="no pose of vehicle 1, 2"):
        localisation(broker, 0.3).__enter__()
