"""The vehicles that a job can name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from tjscan.core.devices import DriverFactory, DriverKind, DriverRegistry, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.vehicle.mqtt.settings import MqttSettings
from tjscan.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from tjscan.core.frames import Array
    from tjscan.vehicle.mqtt.vehicle import MqttVehicle
    from tjscan.vehicle.replay import ReplayedVehicle
    from tjscan.vehicle.simulated import SimulatedVehicle
    from tjscan.vehicle.simulation import VehicleSimulationSettings
    from tjscan.vehicle.tracks import TrackGeometry
    from tjscan.vehicle.vehicle import VehicleState


@dataclass(frozen=True, slots=True, eq=False)
class VehicleDriverInputs:
    """What a vehicle's driver makes its vehicle from, besides its own settings.

    Parameters
    ----------
    tracks : TrackGeometry
        Of the vehicle that the job describes.
    seed : int
        Of a simulation's random numbers.
    simulation : VehicleSimulationSettings or None
        Where a simulated vehicle stands and how it moves; None where the job has no
        [simulation.vehicle].
    left : tuple of Array and float, or None
        Where an interrupted run left a simulated vehicle: x, y, heading, shape (3,), and what its
        clock showed.
    recording : callable
        Gives the states of the recording that the job names; raises ConfigurationError where it
        names none.
    """

    tracks: TrackGeometry
    seed: int
    simulation: VehicleSimulationSettings | None
    left: tuple[Array, float] | None
    recording: Callable[[], tuple[VehicleState, ...]]


def _no_truth(vehicle: Any) -> Array:
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

    truth: Callable[[Any], Array] = field(default=_no_truth)


def _simulated(context: VehicleDriverInputs, settings: NoSettings) -> SimulatedVehicle:
    from tjscan.vehicle.simulated import SimulatedVehicle
    from tjscan.vehicle.simulated_body import SimulatedBody

    if context.simulation is None:
        raise ConfigurationError(
            "a simulated vehicle needs a [simulation.vehicle] table", key="simulation.vehicle"
        )
    pose_w, time = (None, 0.0) if context.left is None else context.left
    return SimulatedVehicle(
        SimulatedBody(
            context.tracks, context.simulation, seed=context.seed, pose_w=pose_w, time=time
        )
    )


def _replayed(context: VehicleDriverInputs, settings: NoSettings) -> ReplayedVehicle:
    from tjscan.vehicle.replay import ReplayedVehicle

    return ReplayedVehicle(context.recording())


def _over_mqtt(inputs: VehicleDriverInputs, settings: MqttSettings) -> MqttVehicle:
    from tjscan.vehicle.mqtt.vehicle import MqttVehicle

    return MqttVehicle(settings)


SIMULATED_DRIVER: Final = VehicleDriverFactory(
    _simulated, kind=DriverKind.SIMULATED, truth=lambda vehicle: vehicle.true_pose()
)
REPLAY_DRIVER: Final = VehicleDriverFactory(_replayed, kind=DriverKind.REPLAYED)
MQTT_DRIVER: Final = VehicleDriverFactory(
    _over_mqtt, MqttSettings, truth=lambda vehicle: vehicle.true_pose()
)

VEHICLE_DRIVERS: Final[DriverRegistry[VehicleDriverFactory]] = DriverRegistry(
    "vehicle",
    {
        "simulated": "tjscan.vehicle.drivers:SIMULATED_DRIVER",
        "replay": "tjscan.vehicle.drivers:REPLAY_DRIVER",
        "mqtt": "tjscan.vehicle.drivers:MQTT_DRIVER",
    },
    extras={"mqtt": "vehicle"},
    key="vehicle.driver",
    type=VehicleDriverFactory,
)
"""Every vehicle driver by name."""
