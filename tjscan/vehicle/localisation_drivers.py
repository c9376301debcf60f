"""The localisations that a job can name."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from tjscan.core.devices import DriverFactory, DriverKind, DriverRegistry, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.vehicle.localisation import Localisation
from tjscan.vehicle.mqtt.settings import MqttLocalisationSettings
from tjscan.vehicle.pose_disturbance import LocalisationSimulationSettings

if TYPE_CHECKING:
    from tjscan.vehicle.cable.world import TowingWorld
    from tjscan.vehicle.mqtt.localisation import MqttLocalisation
    from tjscan.vehicle.simulated_localisation import SimulatedLocalisation


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LocalisationInputs:
    """What a localisation is made from, besides its own settings.

    Parameters
    ----------
    vehicles : int
        How many it is to see.
    seed : int, optional
        Of a simulation's random numbers.
    world : TowingWorld or None, optional
        The world that a simulated one sees.
    simulation : LocalisationSimulationSettings, optional
        How that disturbs the poses.
    """

    vehicles: int
    seed: int = 0
    world: TowingWorld | None = None
    simulation: LocalisationSimulationSettings = field(
        default_factory=LocalisationSimulationSettings
    )


@dataclass(frozen=True)
class LocalisationDriverFactory(DriverFactory[LocalisationInputs, Localisation]):
    """How a localisation's driver makes it from a job file; see `DriverFactory`."""


def _simulated(inputs: LocalisationInputs, settings: NoSettings) -> SimulatedLocalisation:
    from tjscan.vehicle.simulated_localisation import SimulatedLocalisation

    if inputs.world is None:
        raise ConfigurationError(
            "a simulated localisation sees simulated vehicles alone", key="localisation.driver"
        )
    return SimulatedLocalisation(inputs.world, inputs.simulation, seed=inputs.seed)


def _mqtt(inputs: LocalisationInputs, settings: MqttLocalisationSettings) -> MqttLocalisation:
    from tjscan.vehicle.mqtt.localisation import MqttLocalisation

    return MqttLocalisation(settings, inputs.vehicles)


SIMULATED_DRIVER: Final = LocalisationDriverFactory(_simulated, kind=DriverKind.SIMULATED)
MQTT_DRIVER: Final = LocalisationDriverFactory(_mqtt, MqttLocalisationSettings)

LOCALISATION_DRIVERS: Final[DriverRegistry[LocalisationDriverFactory]] = DriverRegistry(
    "localisation",
    {
        "simulated": "tjscan.vehicle.localisation_drivers:SIMULATED_DRIVER",
        "mqtt": "tjscan.vehicle.localisation_drivers:MQTT_DRIVER",
    },
    extras={"mqtt": "vehicle"},
    key="localisation.driver",
    type=LocalisationDriverFactory,
)
"""Every localisation by name."""
