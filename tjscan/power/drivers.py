"""The power sources that a job can name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from typing import Final

from tjscan.core.devices import DriverFactory, DriverKind, DriverRegistry
from tjscan.power.modbus.registers import ModbusPowerSettings
from tjscan.power.simulated import PowerSimulationSettings, SimulatedPowerSource
from tjscan.power.source import ManualPowerSource, PowerSource


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PowerDriverInputs:
    """What a power source's driver makes it from, beside its own settings.

    Parameters
    ----------
    ask : callable
        Asks a person to do something at the torch, and returns whether it is done.
    clock : callable, optional
        Gives the seconds of a simulated world.
    raised : callable, optional
        Gives by how much the torch is too high in a simulated world, metres.
    seed : int, optional
        Of a simulation's random numbers.
    """

    ask: Callable[[str], bool]
    clock: Callable[[], float] = monotonic
    raised: Callable[[], float] = float
    seed: int = 0


PowerDriverFactory = DriverFactory[PowerDriverInputs, PowerSource]


def _make_simulated(inputs: PowerDriverInputs, settings: PowerSimulationSettings) -> PowerSource:
    return SimulatedPowerSource(settings, inputs.clock, inputs.raised, inputs.seed)


def _make_modbus(inputs: PowerDriverInputs, settings: ModbusPowerSettings) -> PowerSource:
    from tjscan.power.modbus.source import ModbusPowerSource

    return ModbusPowerSource(settings)


POWER_DRIVERS: Final = DriverRegistry(
    "power_source",
    {
        "simulated": PowerDriverFactory(
            _make_simulated, PowerSimulationSettings, kind=DriverKind.SIMULATED
        ),
        "modbus": PowerDriverFactory(_make_modbus, ModbusPowerSettings, extra="power"),
        "none": PowerDriverFactory(
            lambda inputs, settings: ManualPowerSource(inputs.ask, inputs.clock)
        ),
    },
    key="power.driver",
)
"""Every power source driver by name."""
