"""The job of a tow: cable, vehicles, area, seam, obstacles, and the world of a simulation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import ceil, hypot
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen

from tjscan.core.config import StrictFileModel, add_file_to_errors, read_toml
from tjscan.core.devices import DriverRegistry
from tjscan.core.errors import explain_missing_package
from tjscan.core.units import LIST_OR_WORD_IN_FILE, MM, MM_S, SECONDS, SettingsTable
from tjscan.job.devices import DeviceSettings
from tjscan.job.reading import read_job
from tjscan.towing import tables
from tjscan.towing.shape.area import Floor
from tjscan.towing.shape.cable import Cable, TowingTeam, equally_spaced_links
from tjscan.vehicle.cable.model import TowingVehicleSettings
from tjscan.vehicle.drivers import LOCALISATION_DRIVERS, TOWING_VEHICLE_DRIVERS
from tjscan.vehicle.pose_disturbance import LocalisationSimulationSettings

GRAVITY_ACCELERATION: Final = 9.81  # m/s²
PLAN_CLEARANCE_RESERVE: Final = 5e-3
"""Metres that plans add to the clearances of the job: vehicles and cable follow a plan to within
some millimetres."""

BEND_RADIUS_RESERVE: Final = 1.02
"""Factor by which plans enlarge the least bend radius of the job."""

LEAST_FRICTION_DOUBT: Final = 0.1
"""Share by which the floor's friction differs from place to place, however well it is known."""

MOST_VEHICLES: Final = 50

TOWING_EXTRA: Final = "towing"
"""Name of the extra that brings what only a tow needs."""


@dataclass(frozen=True, kw_only=True)
class VehiclesSettings(DeviceSettings):
    """The table [vehicles]: who carries the cable, by which driver; the last one is the welder.

    Parameters
    ----------
    count : int
        With the welder.
    links : tuple of int or None
        Link of the cable that each holds, counted from 0 at the root; the welder holds the last.
        Equally spaced if left out.
    behind_welder : float or None
        Length of the piece of cable behind the welder, a whole number of links, metres, where that
        is not as long as the others.
    radius : float
        Of a body seen from above, metres.
    speed : float
        At most, m/s.
    force : float
        With which a vehicle can pull at most, newton.
    """

    registry: ClassVar[DriverRegistry[Any]] = TOWING_VEHICLE_DRIVERS

    count: Annotated[int, Ge(2), Le(MOST_VEHICLES)] = 6
    links: Annotated[tuple[int, ...] | None, LIST_OR_WORD_IN_FILE] = None
    behind_welder: Annotated[float | None, Gt(0), Le(1e5), MM] = None
    radius: Annotated[float, Gt(0), Le(5000), MM] = 0.15
    speed: Annotated[float, Gt(0), Le(5000), MM_S] = 0.1
    force: Annotated[float, Gt(0), Le(1e5), tables.NEWTON] = 49.0


@dataclass(frozen=True, kw_only=True)
class TowLocalisationSettings(tables.LocalisationSettings, DeviceSettings):
    """The table [localisation]: who measures the vehicles' poses, and how well; see its bases."""

    registry: ClassVar[DriverRegistry[Any]] = LOCALISATION_DRIVERS


WorldFault = Literal["jam", "push", "passer-by-stands"]
PoseFaultName = Literal[
    "pose-noise", "pose-lost", "pose-late", "pose-disorder", "pose-frozen", "pose-jump", "pose-swap"
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
    vehicle: Annotated[int, Ge(1), Le(MOST_VEHICLES)] | None = None
    push: Annotated[tuple[tables.Coordinate, tables.Coordinate], MM] = (0.2, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class TowSimulationSettings(SettingsTable):
    """The table [simulation]: the world of a simulated tow.

    Parameters
    ----------
    seed : int
        Of all random numbers.
    settle : float
        Seconds for which cable and vehicles rest before the clock starts.
    towing_vehicle : TowingVehicleSettings
        What every vehicle truly is.
    localisation : LocalisationSimulationSettings
        How well poses are truly measured.
    faults : tuple of FaultSettings
    """

    seed: Annotated[int, Ge(0)] = 1
    settle: Annotated[float, Gt(0), Le(60), SECONDS] = 1.0
    towing_vehicle: TowingVehicleSettings = field(default_factory=TowingVehicleSettings)
    localisation: LocalisationSimulationSettings = field(
        default_factory=LocalisationSimulationSettings
    )
    faults: Annotated[tuple[FaultSettings, ...], MaxLen(100), LIST_OR_WORD_IN_FILE] = ()


class TowJob(StrictFileModel):
    """A job file that describes a tow."""

    method: Literal["ours", "paper"] = "ours"
    cable: tables.CableSettings = tables.CableSettings()
    identified: tables.IdentifiedCable | None = None
    root: tables.CableRootSettings = tables.CableRootSettings()
    vehicles: VehiclesSettings = VehiclesSettings()
    area: tables.AreaSettings
    seam: tables.SeamSettings
    obstacles: Annotated[
        tuple[tables.ObstacleSettings, ...], MaxLen(100), LIST_OR_WORD_IN_FILE
    ] = ()
    weights: tables.WeightSettings = tables.WeightSettings()
    targets: tables.TargetSettings = tables.TargetSettings()
    limits: tables.LimitSettings = tables.LimitSettings()
    localisation: TowLocalisationSettings = TowLocalisationSettings()
    following: tables.FollowingSettings = tables.FollowingSettings()
    simulation: TowSimulationSettings = TowSimulationSettings()

    @property
    def held_links(self) -> tuple[int, ...]:
        """Link that each vehicle holds, the welder's last."""
        vehicles, cable = self.vehicles, self.cable
        behind = vehicles.behind_welder
        last = None if behind is None else round(behind / cable.link)
        if vehicles.links is not None:
            return vehicles.links
        return equally_spaced_links(cable.links, vehicles.count, last)

    @property
    def chain(self) -> Cable:
        """The cable, as the planner knows it."""
        cable, found = self.cable, self.identified
        chain = Cable(
            links=cable.links,
            link_length=cable.link,
            least_bend_radius=cable.least_radius,
            bending_stiffness=cable.stiffness,
            friction=cable.friction * cable.mass * cable.link * GRAVITY_ACCELERATION,
            root=self.root.pose,
        )
        if found is None:
            return chain
        doubt = hypot(found.stiffness_sd / found.stiffness, found.drag_sd / found.drag)
        return replace(
            chain,
            bending_stiffness=found.stiffness / cable.link,
            friction=found.drag * cable.link,
            rest_angle=found.curvature * cable.link,
            friction_doubt=max(doubt, LEAST_FRICTION_DOUBT),
        )

    @property
    def team(self) -> TowingTeam:
        """The vehicles, as the planner knows them."""
        ours = self.vehicles
        return TowingTeam(self.held_links, ours.radius, ours.speed, ours.force)

    @property
    def cable_with_bend_reserve(self) -> Cable:
        """The cable as it is planned: bent less than allowed, since it follows a plan roughly."""
        chain = self.chain
        return replace(chain, least_bend_radius=BEND_RADIUS_RESERVE * chain.least_bend_radius)

    @property
    def hard_limits(self) -> tables.LimitSettings:
        """What no plan breaks: the job's limits, and a reserve for what the plan is off by."""
        limits = self.limits
        return replace(
            limits,
            link_clearance=limits.link_clearance + PLAN_CLEARANCE_RESERVE,
            vehicle_clearance=limits.vehicle_clearance + PLAN_CLEARANCE_RESERVE,
            vehicle_gap=limits.vehicle_gap + PLAN_CLEARANCE_RESERVE,
        )

    @property
    def floor(self) -> Floor:
        """The area, as the planner knows it."""
        return Floor(self.area.outline, self.area.holes)

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Yield key and message of what can't be towed."""
        yield from _held_link_contradictions(self)
        yield from _size_contradictions(self)
        yield from _fault_contradictions(self)
        # Needs shapely, which only a tow does.
        from tjscan.job.tow.floor import TowFloor, floor_contradictions

        body = self.vehicles.radius + self.limits.vehicle_clearance
        pieces = np.diff(self.cable.link * np.array((-1, *self.held_links)))
        on_floor = TowFloor(self.area, self.root, self.seam, self.obstacles, body, pieces)
        yield from floor_contradictions(on_floor)


def read_tow_job(file: Path, overrides: dict[str, Any] | None = None) -> TowJob:
    """Read the job of a tow, with single keys replaced; see `read_job`.

    Its ``identified`` may name a file instead, beside the job's; the job then holds its keys.

    Raises
    ------
    ConfigurationError
        If it can't be read, or asks for what can't be towed.
    """
    keys = dict(overrides or {})
    with add_file_to_errors(file), explain_missing_package("towing", TOWING_EXTRA):
        named = keys.get("identified", read_toml(file).get("identified"))
        if isinstance(named, str):
            keys["identified"] = read_toml(file.parent / named)
        return read_job(TowJob, file, keys)


def _size_contradictions(job: TowJob) -> Iterator[tuple[str, str]]:
    """Yield sizes that would change nothing, forces that can't be, and too fast a seam."""
    gap, length = job.limits.cable_gap, job.cable.length
    if np.pi / 2 * gap >= length:
        yield (
            "limits.cable_gap_mm",
            f"half a circle that wide, {5e2 * np.pi * gap:.0f} mm, is longer than the cable, and "
            f"no two links would be held apart: take less than {2e3 / np.pi * length:.0f}",
        )
    ours = job.vehicles
    drag = job.cable.friction * job.cable.mass * GRAVITY_ACCELERATION  # of a metre
    if ours.force < drag:
        yield (
            "vehicles.force_n",
            f"{ours.force:g} N is less than the {drag:.1f} N with which the floor holds a metre of "
            f"cable: such a vehicle tows nothing. Write what it can pull, {ceil(drag)} or more, or "
            "less mass or friction of the cable",
        )
    if job.seam.speed > ours.speed:
        yield (
            "seam.speed_mm_min",
            f"{6e4 * job.seam.speed:g} mm/min is more than the vehicles' {6e4 * ours.speed:g}",
        )


def _fault_contradictions(job: TowJob) -> Iterator[tuple[str, str]]:
    """Yield faults of vehicles and passers-by that the job does not have."""
    moving = sum(one.speed > 0 for one in job.obstacles)
    for number, fault in enumerate(job.simulation.faults):
        if fault.kind == "passer-by-stands":
            count, found = moving, f"{moving} moving obstacle{'' if moving == 1 else 's'}"
        else:
            count, found = job.vehicles.count, f"{job.vehicles.count} vehicles"
        if (fault.vehicle or 1) > count:
            yield (
                f"simulation.faults.{number}.vehicle",
                f"{fault.kind} is to happen to number {fault.vehicle or 1} of {found}",
            )


def _held_link_contradictions(job: TowJob) -> Iterator[tuple[str, str]]:
    """Yield what prevents the vehicles from holding their links, or from keeping apart."""
    vehicles, last = job.vehicles, job.cable.links - 1
    key = "vehicles.count" if vehicles.links is None else "vehicles.links"
    if vehicles.behind_welder is not None:
        key = "vehicles.behind_welder_mm"
        if vehicles.links is not None:
            yield (
                key,
                "vehicles.links give the length of the piece behind the welder: leave this key out",
            )
        count = vehicles.behind_welder / job.cable.link
        if abs(count - round(count)) > 1e-6 or not round(count):
            yield key, f"must be a whole number of links: it is {count:g} times cable.link_mm"
    held = job.held_links
    if len(held) != vehicles.count:
        yield key, f"there are {vehicles.count} vehicles, and {len(held)} links to hold"
    if held[-1] != last:
        yield (
            key,
            f"the last vehicle is the welder, and holds the last link, {last} (found {held[-1]})",
        )
    if held[0] < 0 or any(b <= a for a, b in pairwise(held)):
        yield key, f"the links must rise along the cable, from 0 at the root to {last}"
    need = 2 * vehicles.radius + job.limits.vehicle_gap
    for number, (a, b) in enumerate(pairwise(held), 1):
        length = (b - a) * job.cable.link
        if length < need:
            yield (
                _cause_of_short_piece(job, number, need),
                f"vehicles {number} and {number + 1} hold the cable {1e3 * length:.0f} mm apart, "
                f"and need {1e3 * need:.0f} mm: two radii, and limits.vehicle_gap_mm",
            )


def _cause_of_short_piece(job: TowJob, number: int, need: float) -> str:
    """Key that has to change if the piece of cable behind a vehicle is too short."""
    if need > job.cable.length / 2:  # more than two vehicles have, the fewest
        wide = 2 * job.vehicles.radius > job.limits.vehicle_gap
        return "vehicles.radius_mm" if wide else "limits.vehicle_gap_mm"
    if job.vehicles.links is not None:
        return "vehicles.links"
    behind = job.vehicles.behind_welder is not None and number == job.vehicles.count - 1
    return "vehicles.behind_welder_mm" if behind else "vehicles.count"
