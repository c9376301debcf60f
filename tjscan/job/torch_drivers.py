"""The torches that a crawl job can name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from tjscan.core.devices import DriverFactory, DriverKind, DriverRegistry, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.crawler.torch_axes import FixedTorch, SimulatedTorchAxes, TorchAxes
from tjscan.vehicle.mqtt.settings import MqttSettings

if TYPE_CHECKING:
    from tjscan.vehicle.mqtt.torch import MqttTorch


@dataclass(frozen=True, slots=True, kw_only=True)
class TorchDriverInputs:
    """What a torch's driver makes its torch from, beside its own settings.

    Parameters
    ----------
    reach : float
        To either side of the vehicle's middle, metres.
    speed : float
        Across the joint, m/s.
    vehicle : SettingsTable or object
        Settings of the vehicle's driver: a torch may hang on the same link.
    """

    reach: float
    speed: float
    vehicle: object


TorchDriverFactory = DriverFactory[TorchDriverInputs, TorchAxes]


def _make_mqtt_torch(context: TorchDriverInputs, settings: NoSettings) -> MqttTorch:
    if not isinstance(context.vehicle, MqttSettings):
        raise ConfigurationError(
            'the torch "mqtt" hangs on the link of its vehicle: vehicle.driver must be "mqtt" too',
            key="torch.driver",
        )
    from tjscan.vehicle.mqtt.torch import MqttTorch

    return MqttTorch(context.vehicle, context.reach)


SIMULATED_DRIVER: Final = TorchDriverFactory(
    lambda context, settings: SimulatedTorchAxes(context.reach, context.speed),
    kind=DriverKind.SIMULATED,
)
FIXED_DRIVER: Final = TorchDriverFactory(lambda context, settings: FixedTorch())
MQTT_DRIVER: Final = TorchDriverFactory(_make_mqtt_torch)

TORCH_DRIVERS: Final[DriverRegistry[TorchDriverFactory]] = DriverRegistry(
    "torch",
    {
        "simulated": "tjscan.job.torch_drivers:SIMULATED_DRIVER",
        "none": "tjscan.job.torch_drivers:FIXED_DRIVER",
        "mqtt": "tjscan.job.torch_drivers:MQTT_DRIVER",
    },
    extras={"mqtt": "vehicle"},
    key="torch.driver",
    type=DriverFactory,
)
"""Every torch driver by name."""
