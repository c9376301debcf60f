"""Read a tow job, and refuse what can't be towed before anything moves."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError, package_missing
from tjscan.job.reading import read_job
from tjscan.job.tow.job import TOWING_EXTRA, TowJob
from tjscan.vehicle.cable.model import TowingVehicleModel


def read_tow_job(file: Path, overrides: dict[str, Any] | None = None) -> TowJob:
    """Read the job of a tow, with single keys replaced; see `read_job`.

    Raises
    ------
    ConfigurationError
        If it can't be read, or asks for what can't be towed.
    """
    job = read_job(TowJob, file, overrides)
    with add_file_to_errors(file):
        try:
            check_tow_job(job)
        except ModuleNotFoundError as error:
            raise package_missing(error, "towing", TOWING_EXTRA) from None
    return job


def check_tow_job(job: TowJob) -> None:
    """Refuse what can't be towed, before anything moves.

    Raises
    ------
    ConfigurationError
        With the key, and where and by how much.
    """
    for key, message in _tow_contradictions(job):
        raise ConfigurationError(message, key=key)


def _tow_contradictions(job: TowJob) -> Iterator[tuple[str, str]]:
    """Yield key and message of what can't be towed."""
    yield from _held_link_contradictions(job)
    yield from _size_contradictions(job)
    yield from _fault_contradictions(job)
    from tjscan.job.tow.floor import floor_contradictions  # needs shapely, which only a tow does

    yield from floor_contradictions(job)


def _size_contradictions(job: TowJob) -> Iterator[tuple[str, str]]:
    """Yield sizes that would change nothing, with what to write instead, and too fast a seam."""
    gap, length = job.limits.cable_gap, job.cable.length
    if np.pi / 2 * gap >= length:
        yield (
            "limits.cable_gap_mm",
            f"half a circle that wide, {5e2 * np.pi * gap:.0f} mm, is longer than the cable, and "
            f"no two links would be held apart: take less than {2e3 / np.pi * length:.0f}",
        )
    model, usual, ours = job.simulation.towing_vehicle, TowingVehicleModel(), job.vehicles
    for key, value, allowed, instead in (
        ("body_radius_mm", model.body_radius, (usual.body_radius, ours.radius), "radius_mm"),
        ("force_n", model.force, (usual.force, ours.force), "force_n"),
    ):
        if value not in allowed:
            yield (
                f"simulation.towing_vehicle.{key}",
                f"simulated vehicles have vehicles.{instead}: set that, and leave this out",
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
