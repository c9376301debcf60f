"""The carriers that a job can name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from tjscan.carrier.carrier import Carrier, ManualCarrier
from tjscan.carrier.kinematics import CarrierKinematics
from tjscan.carrier.simulated import CarrierSimulationSettings, SimulatedCarrier
from tjscan.core.devices import DriverFactory, DriverKind, DriverRegistry
from tjscan.core.frames import Array


@dataclass(frozen=True, slots=True, eq=False)
class CarrierDriverInputs:
    """What a carrier's driver makes it from, beside its own settings.

    Parameters
    ----------
    kinematics : CarrierKinematics
        As the job describes it.
    values : ndarray, shape (n,)
        Where the run left it, metres and radians: a simulated one is there again.
    ask : callable
        Asks a person to do something, and returns whether it is done.
    """

    kinematics: CarrierKinematics
    values: Array
    ask: Callable[[str], bool]


CarrierDriverFactory = DriverFactory[CarrierDriverInputs, Carrier]

CARRIER_DRIVERS: Final = DriverRegistry(
    "carrier",
    {
        "simulated": CarrierDriverFactory(
            lambda inputs, table: SimulatedCarrier(inputs.kinematics, inputs.values, table),
            CarrierSimulationSettings,
            kind=DriverKind.SIMULATED,
        ),
        "none": CarrierDriverFactory(
            lambda inputs, table: ManualCarrier(inputs.kinematics, inputs.values, inputs.ask)
        ),
    },
    key="carrier.driver",
)
"""Every carrier driver by name."""
