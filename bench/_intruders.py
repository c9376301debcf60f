"""Clients of a broker that have no business with a vehicle there, and what they do to it."""

from __future__ import annotations

import json
import multiprocessing
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import StrEnum
from itertools import count
from typing import Any, Final, Self

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

from tjscan.core.errors import VehicleFault
from tjscan.vehicle.mqtt.settings import MqttSettings
from tjscan.vehicle.mqtt.vehicle import MqttVehicle
from tjscan.vehicle.vehicle import Twist
from tjscan_loopback.broker import MosquittoProcess
from tjscan_loopback.process import VehicleLoopbackProcess

PREFIX: Final = "tjscan/vehicle/1"
ORDERED: Final = Twist(0.05, 0.0)
INTRUDER_SPEED: Final = 0.3
"""m/s."""

WATCHED: Final = 2.0
"""Seconds after which motion that nobody noticed counts as that."""


class Intrusion(StrEnum):
    """What a client does, told apart by what is false of its messages."""

    FOREIGN = "foreign"
    REPLAYED = "replayed"
    FUTURE = "future-numbered"
    FLOODING = "flooding"


class Intruder:
    """A process that sends commands to vehicle 1 from beside its program, while it is let loose.

    Parameters
    ----------
    port : int
        Of the broker.
    kind : Intrusion
    in_turn : bool, optional
        Whether it guesses the next number of the program's own session, so that the vehicle obeys.
    """

    def __init__(self, port: int, kind: Intrusion, *, in_turn: bool = False) -> None:
        processes = multiprocessing.get_context("spawn")
        self._loose, self._ready = processes.Event(), processes.Event()
        arguments = port, kind, in_turn, self._loose, self._ready
        self._process = processes.Process(target=_intrude, args=arguments, daemon=True)

    def __enter__(self) -> Self:
        self._process.start()
        self._ready.wait()
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.join()

    @contextmanager
    def loose(self) -> Iterator[None]:
        """Let it send."""
        self._loose.set()
        yield
        self._loose.clear()


def _intrude(port: int, kind: Intrusion, in_turn: bool, loose: Any, ready: Any) -> None:
    heard: deque[dict[str, Any]] = deque(maxlen=1000)

    def hear(client: Client, data: Any, message: MQTTMessage) -> None:
        with suppress(ValueError):
            one = json.loads(message.payload)
            if "intruder" not in one["session"]:
                if heard and heard[-1]["session"] != one["session"]:
                    heard.clear()
                heard.append(one)

    client = Client(CallbackAPIVersion.VERSION2)
    client.on_message = hear
    client.connect("127.0.0.1", port)
    client.subscribe(f"{PREFIX}/command")
    client.loop_start()
    ready.set()
    for number in count(1):
        loose.wait()
        if kind is not Intrusion.FLOODING:
            time.sleep(0.01)
        if not heard:
            time.sleep(0.005)
            continue
        newest = heard[-1]
        order = newest | {"order": "drive", "speed": INTRUDER_SPEED, "hold": 0.5}
        if in_turn:
            order |= {"number": newest["number"] + 1, "time": newest["time"] + 1e-3}
        elif kind is Intrusion.FOREIGN:
            here = {"session": "intruder", "number": number, "time": time.monotonic()}
            order |= here
            said = here | {"alive": True, "model": "", "serial": "", "software": ""}
            client.publish(f"{PREFIX}/commander", json.dumps(said))
        elif kind is Intrusion.REPLAYED:
            order = heard[number % len(heard)]  # stops too
        elif kind is Intrusion.FUTURE:
            order |= {"number": newest["number"] + 10**6, "time": newest["time"] + 100.0}
        else:
            order |= {"session": f"intruder{number}"}
        client.publish(f"{PREFIX}/command", json.dumps(order))
        if kind is Intrusion.FLOODING:
            client.publish(f"{PREFIX}/command", b"x" * (number % 3000))


def driver(broker: MosquittoProcess) -> MqttVehicle:
    """The product's driver of vehicle 1; a busy machine is no silent vehicle.

    What an intruder sent before may take a while to drain before the vehicle hears who is there.
    """
    return MqttVehicle(
        MqttSettings(port=broker.port, prefix=PREFIX, silence_limit=5.0, connect_limit=60.0)
    )


def seconds_until_stopped(
    intruder: Intruder, broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> float:
    """Drive beside an intruder, and stop: seconds until the vehicle is at rest, NaN if it isn't."""
    vehicles.unread_output()
    with driver(broker) as vehicle, intruder.loose():
        until = time.monotonic() + 0.4
        with suppress(VehicleFault):  # a replayed stop is a stop
            while time.monotonic() < until:
                vehicle.command(ORDERED)
                vehicle.next_state()
        moves = _last_motion(vehicles)
        since = time.monotonic()
        vehicle.stop()
        return vehicles.wait_until_at_rest() - since if moves else 0.0


def seconds_until_alarm(
    intruder: Intruder, broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> float:
    """Keep the vehicle at rest while an intruder drives it: seconds from its motion to the alarm.

    Zero if the vehicle did not move, infinite if it did and the program did not notice.
    """
    with driver(broker) as vehicle:
        for _ in range(50):
            vehicle.next_state()
        vehicles.unread_output()
        with intruder.loose():
            until = time.monotonic() + WATCHED
            try:
                while time.monotonic() < until:
                    vehicle.next_state()
            except VehicleFault:
                noticed = time.monotonic()
                moved = [line for line in vehicles.unread_output() if line.startswith("moving 1 ")]
                return noticed - float(moved[0].split()[2]) if moved else 0.0
        moved = [line for line in vehicles.unread_output() if line.startswith("moving 1 ")]
        return float("inf") if moved else 0.0


def _last_motion(vehicles: VehicleLoopbackProcess) -> bool:
    lines = [
        line for line in vehicles.unread_output() if line.startswith(("moving 1", "at rest 1"))
    ]
    return bool(lines) and lines[-1].startswith("moving")
