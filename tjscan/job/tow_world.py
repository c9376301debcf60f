"""What a job says of the world of a simulated tow, and of what goes wrong in it by plan."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le, MaxLen

from tjscan.core.units import LIST_OR_WORD_IN_FILE, MM, SECONDS, SettingsTable
from tjscan.towing.tables import Coordinate
from tjscan.vehicle.cable.model import (
    TowingVehicleModel,
)
from tjscan.vehicle.pose_disturbance import LocalisationSimulationSettings

WorldFault = Literal["jam", "push", "passer-by-stands"]
PoseFaultName = Literal[
    "pose-noise",
    "pose-lost",
    "pose-late",
    "pose-disorder",
    "pose-frozen",
    "pose-jump",
    "pose-swap",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultSettings(SettingsTable):
    """A table of [[simulation.faults]]: what goes wrong, when, and for how long.

    Parameters
    ----------
    kind : str
        ``jam`` a vehicle's wheels, ``push`` it, let a ``passer-by-stands``, or one of the faults of
        measured poses.
    at : float
        When, seconds.
    seconds : float or None
        For how long; None for good.
    vehicle : int or None
        Which one, from 1 at the root; of a passer-by likewise. None is the first, or, of poses,
        all.
    push : tuple of float
        How far it is pushed, frame w, metres.
    """

    kind: Literal[WorldFault, PoseFaultName]
    at: Annotated[float, Ge(0), Le(1e6), SECONDS] = 0.0
    seconds: Annotated[float | None, Gt(0), Le(1e6), SECONDS.with_key("for_s")] = None
    vehicle: Annotated[int, Ge(1), Le(20)] | None = None
    push: Annotated[tuple[Coordinate, Coordinate], MM] = (0.2, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class TowSimulationSettings(SettingsTable):
    """The table [simulation]: the world of a simulated tow.

    Parameters
    ----------
    seed : int
        Of all random numbers.
    settle : float
        Seconds for which cable and vehicles stand before the clock starts.
    towing_vehicle : TowingVehicleModel
        What every vehicle is; its radius and its force are those of [vehicles].
    localisation : LocalisationSimulationSettings
        How well poses are truly measured.
    faults : tuple of FaultSettings
    """

    seed: Annotated[int, Ge(0)] = 1
    settle: Annotated[float, Gt(0), Le(60), SECONDS] = 1.0
    towing_vehicle: TowingVehicleModel = field(default_factory=TowingVehicleModel)
    localisation: LocalisationSimulationSettings = field(
        default_factory=LocalisationSimulationSettings
    )
    faults: Annotated[tuple[FaultSettings, ...], MaxLen(100), LIST_OR_WORD_IN_FILE] = ()
