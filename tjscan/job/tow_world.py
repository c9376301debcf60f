"""The world of a simulated tow: what a job says of it, and what goes wrong in it by plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen

from tjscan.core.frames import Array
from tjscan.core.units import LIST_OR_WORD_IN_FILE, MM, SECONDS, SettingsTable
from tjscan.towing.tables import Coordinate, ObstacleSettings
from tjscan.vehicle.cable_model import (
    CableModel,
    PasserBy,
    TowingVehicleModel,
    TowingWorldModel,
)
from tjscan.vehicle.pose_disturbance import LocalisationSimulationSettings, PoseFault

if TYPE_CHECKING:
    from tjscan.job.tow_job import TowJob
    from tjscan.vehicle.simulated_team import SimulatedTeam
    from tjscan.vehicle.vehicle import Vehicle

ROUND: Final = 24
"""Corners of a polygon that stands for a round obstacle."""

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

    kind: WorldFault | PoseFaultName
    at: Annotated[float, Ge(0), Le(1e6), SECONDS] = 0.0
    seconds: Annotated[float | None, SECONDS.with_key("for_s")] = None
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
        What every vehicle is; its radius is that of [vehicles].
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


def towing_world_of_job(job: TowJob) -> TowingWorldModel:
    """The simulated work area that a job describes."""
    cable = job.cable
    model = CableModel(
        links=cable.links,
        link_length=cable.link,
        radius=cable.radius,
        link_mass=cable.mass * cable.link,
        stiffness=cable.stiffness,
        damping=cable.damping,
        friction=cable.friction,
        root=job.root.pose,
        held=job.held_links,
    )
    walls = [np.array(ring) for ring in (job.area.outline, *job.area.holes)]
    walls += [_polygon_of(one) for one in job.obstacles if not one.speed]
    return TowingWorldModel(
        cable=model,
        vehicle=replace(job.simulation.towing_vehicle, body_radius=job.vehicles.radius),
        walls=tuple(walls),
        passers_by=tuple(
            PasserBy(one.radius, np.array(one.points), one.speed, one.start)
            for one in job.obstacles
            if one.speed
        ),
        exempt_links=job.limits.free_links,
    )


def _polygon_of(obstacle: ObstacleSettings) -> Array:
    (x, y), turns = obstacle.points[0], np.linspace(0, 2 * np.pi, ROUND, endpoint=False)
    return np.column_stack(
        (x + obstacle.radius * np.cos(turns), y + obstacle.radius * np.sin(turns))
    )


class FaultyTeam:
    """A simulated team in whose world the faults of a job happen; a context manager.

    Parameters
    ----------
    team : SimulatedTeam
    localisation : object
        The simulated one, which takes faults of poses.
    faults : sequence of FaultSettings
    """

    def __init__(
        self, team: SimulatedTeam, localisation: Any, faults: Sequence[FaultSettings]
    ) -> None:
        self._team, self._localisation = team, localisation
        self._begin = sorted(faults, key=lambda fault: fault.at)
        self._end: list[FaultSettings] = []

    def __enter__(self) -> Self:
        self._team.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._team.__exit__(*error)

    @property
    def vehicles(self) -> Sequence[Vehicle]:
        """All of them."""
        return self._team.vehicles

    @property
    def time(self) -> float:
        """Seconds on the world's clock."""
        return self._team.time

    def advance_to(self, time: float) -> Any:
        """Let what is due go wrong, or right again, and the world go on."""
        now = self._team.time
        while self._begin and self._begin[0].at <= now:
            fault = self._begin.pop(0)
            self._set(fault, begins=True)
            if fault.seconds is not None:
                self._end.append(fault)
        for fault in [one for one in self._end if one.at + (one.seconds or 0.0) <= now]:
            self._set(fault, begins=False)
            self._end.remove(fault)
        return self._team.advance_to(time)

    def _set(self, fault: FaultSettings, *, begins: bool) -> None:
        world = self._team.world
        which = None if fault.vehicle is None else fault.vehicle - 1
        if fault.kind == "jam":
            (world.jam if begins else world.release)(which or 0)
        elif fault.kind == "push":
            if begins:
                world.push(which or 0, *fault.push)
        elif fault.kind == "passer-by-stands":
            world.hold_passer_by(which or 0, begins)
        else:
            poses = self._localisation.poses.faults
            (poses.add if begins else poses.discard)((PoseFault(fault.kind), which))
