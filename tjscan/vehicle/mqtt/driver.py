"""A vehicle behind an MQTT broker as a driver that a job can name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from tjscan.vehicle.drivers import VEHICLES, VehicleDriverFactory, VehicleDriverInputs
from tjscan.vehicle.mqtt.settings import MqttSettings

if TYPE_CHECKING:
    from tjscan.vehicle.mqtt.vehicle import MqttVehicle


def _make(context: VehicleDriverInputs, settings: MqttSettings) -> MqttVehicle:
    with VEHICLES.explain_missing_package("mqtt"):
        from tjscan.vehicle.mqtt.vehicle import MqttVehicle
    return MqttVehicle(settings)


DRIVER: Final = VehicleDriverFactory(_make, MqttSettings, truth=lambda vehicle: vehicle.true_pose())
