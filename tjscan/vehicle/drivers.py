"""The vehicles and the localisations that a job can name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from operator import methodcaller
from typing import TYPE_CHECKING, Any, Final

from tjscan.core.devices import DriverFactory, DriverKind, DriverRegistry, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.vehicle.localisation import Localisation
from tjscan.vehicle.mqtt.settings import (
    MqttLocalisationSettings,
    MqttSettings,
    TeamMqttSettings,
)
from tjscan.vehicle.pose_disturbance import LocalisationSimulationSettings
from tjscan.vehicle.replay import ReplayedVehicle
from tjscan.vehicle.simulated import SimulatedVehicle
from tjscan.vehicle.simulated_body import SimulatedBody, VehicleSimulationSettings
from tjscan.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from tjscan.core.frames import Array
    from tjscan.vehicle.cable.world import TowingWorld
    from tjscan.vehicle.tracks import TrackGeometry
    from tjscan.vehicle.vehicle import VehicleState


@dataclass(frozen=True, slots=True, eq=False)
class VehicleDriverInputs:
    """What a vehicle's driver makes its vehicle from, beside its own settings.

    Parameters
    ----------
    tracks : TrackGeometry
        Of the vehicle that the job describes.
    seed : int
        Of a simulation's random numbers.
    simulation : VehicleSimulationSettings or None
        How a simulated vehicle moves and where it begins; None if the job has no
        [simulation.vehicle].
    left : tuple of Array and float, or None
        Where an interrupted run left a simulated vehicle: x, y, heading, shape (3,), and what its
        clock showed.
    recording : callable
        Gives the states of the recording that the job names; raises ConfigurationError if it
        names none.
    """

    tracks: TrackGeometry
    seed: int
    simulation: VehicleSimulationSettings | None
    left: tuple[Array, float] | None
    recording: Callable[[], tuple[VehicleState, ...]]


def _refuse_true_pose(vehicle: Any) -> Array:
    raise ConfigurationError(
        "the true place of this vehicle is not known; a simulated laser needs the simulated "
        "vehicle below it",
        key="vehicle.driver",
    )


@dataclass(frozen=True)
class VehicleDriverFactory(DriverFactory[VehicleDriverInputs, Vehicle]):
    """How a vehicle's driver makes the vehicle from a job file; see `DriverFactory`.

    Parameters
    ----------
    truth : callable, optional
        Gives where a vehicle truly is on the unrolled surface, T_w_v, shape (4, 4). Of a real
        unknown: it raises ConfigurationError.
    """

    truth: Callable[[Any], Array] = field(default=_refuse_true_pose)


def _make_simulated_vehicle(context: VehicleDriverInputs, settings: NoSettings) -> Vehicle:
    if context.simulation is None:
        raise ConfigurationError(
            "a simulated vehicle needs a [simulation.vehicle] table", key="simulation.vehicle"
        )
    pose_w, time = (None, 0.0) if context.left is None else context.left
    body = SimulatedBody(
        context.tracks, context.simulation, seed=context.seed, pose_w=pose_w, time=time
    )
    return SimulatedVehicle(body)


def _make_mqtt_vehicle(inputs: VehicleDriverInputs, settings: MqttSettings) -> Vehicle:
    from tjscan.vehicle.mqtt.vehicle import MqttVehicle

    return MqttVehicle(settings)


VEHICLE_DRIVERS: Final = DriverRegistry(
    "vehicle",
    {
        "simulated": VehicleDriverFactory(
            _make_simulated_vehicle, kind=DriverKind.SIMULATED, truth=methodcaller("true_pose")
        ),
        "replay": VehicleDriverFactory(
            lambda inputs, settings: ReplayedVehicle(inputs.recording()), kind=DriverKind.REPLAYED
        ),
        "mqtt": VehicleDriverFactory(
            _make_mqtt_vehicle, MqttSettings, extra="vehicle", truth=methodcaller("true_pose")
        ),
    },
    key="vehicle.driver",
    type=VehicleDriverFactory,
)
"""Every vehicle driver by name."""


@dataclass(frozen=True, slots=True)
class TowingVehicleInputs:
    """What the driver of a towing vehicle makes it from, beside its own settings.

    Parameters
    ----------
    number : int
        Its place along the cable, from 1 at the root.
    """

    number: int


TowingVehicleDriverFactory = DriverFactory[TowingVehicleInputs, Vehicle]


def _make_mqtt_towing_vehicle(inputs: TowingVehicleInputs, settings: TeamMqttSettings) -> Vehicle:
    from tjscan.vehicle.mqtt.vehicle import MqttVehicle

    return MqttVehicle(replace(settings, prefix=f"{settings.prefix}/{inputs.number}"))


def _refuse_single_simulated_vehicle(inputs: TowingVehicleInputs, settings: NoSettings) -> Vehicle:
    raise ConfigurationError("simulated vehicles share one world", key="vehicles.driver")


TOWING_VEHICLE_DRIVERS: Final = DriverRegistry(
    "towing-vehicle",
    {
        "simulated": TowingVehicleDriverFactory(
            _refuse_single_simulated_vehicle, kind=DriverKind.SIMULATED
        ),
        "mqtt": TowingVehicleDriverFactory(
            _make_mqtt_towing_vehicle, TeamMqttSettings, extra="vehicle"
        ),
    },
    key="vehicles.driver",
)
"""Every driver of towing vehicles by name."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LocalisationInputs:
    """What a localisation is made from, beside its own settings.

    Parameters
    ----------
    vehicles : int
        How many it is to see.
    seed : int
        Of a simulation's random numbers.
    world : TowingWorld or None
        The world that a simulated one sees.
    simulation : LocalisationSimulationSettings
        How that disturbs the poses.
    """

    vehicles: int
    seed: int
    world: TowingWorld | None
    simulation: LocalisationSimulationSettings


LocalisationDriverFactory = DriverFactory[LocalisationInputs, Localisation]


def _make_simulated_localisation(inputs: LocalisationInputs, settings: NoSettings) -> Localisation:
    from tjscan.vehicle.simulated_team import SimulatedLocalisation

    if inputs.world is None:
        raise ConfigurationError(
            "a simulated localisation sees simulated vehicles alone", key="localisation.driver"
        )
    return SimulatedLocalisation(inputs.world, inputs.simulation, seed=inputs.seed)


def _make_mqtt_localisation(
    inputs: LocalisationInputs, settings: MqttLocalisationSettings
) -> Localisation:
    from tjscan.vehicle.mqtt.localisation import MqttLocalisation

    return MqttLocalisation(settings, inputs.vehicles)


LOCALISATION_DRIVERS: Final = DriverRegistry(
    "localisation",
    {
        "simulated": LocalisationDriverFactory(
            _make_simulated_localisation, kind=DriverKind.SIMULATED
        ),
        "mqtt": LocalisationDriverFactory(
            _make_mqtt_localisation, MqttLocalisationSettings, extra="vehicle"
        ),
    },
    key="localisation.driver",
)
"""Every localisation by name."""
