"""A program that drives a vehicle until it is ended; in a file of its own, for a child to load."""

from __future__ import annotations

from contextlib import suppress
from multiprocessing.connection import Connection

from tjscan.core.errors import VehicleFault
from tjscan.vehicle.mqtt.settings import MqttSettings
from tjscan.vehicle.mqtt.vehicle import MqttVehicle
from tjscan.vehicle.vehicle import Twist


def drive_until_ended(port: int, speed: float, ready: Connection) -> None:
    """Command vehicle 1 to drive straight on, at m/s, with every state that comes."""
    with suppress(VehicleFault), MqttVehicle(MqttSettings(port=port)) as vehicle:
        vehicle.command(Twist(speed, 0.0))
        ready.send(None)
        while True:
            vehicle.next_state()
            vehicle.command(Twist(speed, 0.0))
