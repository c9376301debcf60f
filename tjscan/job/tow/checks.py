"""Read a tow job, and refuse what can't be towed before anything moves."""

from __future__ import annotations

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
    _check_held_links(job)
    _check_sizes(job)
    if job.seam.speed > job.vehicles.speed:
        raise ConfigurationError(
            f"{6e4 * job.seam.speed:g} mm/min is more than the vehicles' "
            f"{6e4 * job.vehicles.speed:g}",
            key="seam.speed_mm_min",
        )
    _check_faults(job)
    from tjscan.job.tow.floor import check_floor  # needs shapely, which only a tow does

    check_floor(job)


def _check_sizes(job: TowJob) -> None:
    """Refuse sizes that would change nothing.

    Raises
    ------
    ConfigurationError
        With the key, and what to write instead.
    """
    gap, length = job.limits.cable_gap, job.cable.length
    if np.pi / 2 * gap >= length:
        raise ConfigurationError(
            f"half a circle that wide, {5e2 * np.pi * gap:.0f} mm, is longer than the cable, and "
            f"no two links would be held apart: take less than {2e3 / np.pi * length:.0f}",
            key="limits.cable_gap_mm",
        )
    model, usual = job.simulation.towing_vehicle, TowingVehicleModel()
    for key, value, default, ours, instead in (
        ("body_radius_mm", model.body_radius, usual.body_radius, job.vehicles.radius, "radius_mm"),
        ("force_n", model.force, usual.force, job.vehicles.force, "force_n"),
    ):
        if value not in (default, ours):
            raise ConfigurationError(
                f"simulated vehicles have vehicles.{instead}: set that, and leave this out",
                key=f"simulation.towing_vehicle.{key}",
            )


def _check_faults(job: TowJob) -> None:
    """Refuse faults of vehicles and passers-by that the job does not have.

    Raises
    ------
    ConfigurationError
        With the key, and how many there are.
    """
    moving = sum(one.speed > 0 for one in job.obstacles)
    for number, fault in enumerate(job.simulation.faults):
        if fault.kind == "passer-by-stands":
            count, found = moving, f"{moving} moving obstacle{'' if moving == 1 else 's'}"
        else:
            count, found = job.vehicles.count, f"{job.vehicles.count} vehicles"
        if (fault.vehicle or 1) > count:
            raise ConfigurationError(
                f"{fault.kind} is to happen to number {fault.vehicle or 1} of {found}",
                key=f"simulation.faults.{number}.vehicle",
            )


def _check_held_links(job: TowJob) -> None:
    """Refuse links that can't be held, or vehicles that would touch one another.

    Raises
    ------
    ConfigurationError
        With the key and what is wrong.
    """
    held, last = job.held_links, job.cable.links - 1
    key = "vehicles.count" if job.vehicles.links is None else "vehicles.links"
    if job.vehicles.behind_welder is not None:
        key = "vehicles.behind_welder_mm"
        if job.vehicles.links is not None:
            raise ConfigurationError(
                "vehicles.links give the length of the piece behind the welder: leave this key out",
                key=key,
            )
        count = job.vehicles.behind_welder / job.cable.link
        if abs(count - round(count)) > 1e-6 or not round(count):
            raise ConfigurationError(
                f"must be a whole number of links: it is {count:g} times cable.link_mm", key=key
            )
    if len(held) != job.vehicles.count:
        raise ConfigurationError(
            f"there are {job.vehicles.count} vehicles, and {len(held)} links to hold", key=key
        )
    if held[-1] != last:
        raise ConfigurationError(
            f"the last vehicle is the welder, and holds the last link, {last} (found {held[-1]})",
            key=key,
        )
    if held[0] < 0 or any(b <= a for a, b in pairwise(held)):
        raise ConfigurationError(
            f"the links must rise along the cable, from 0 at the root to {last}", key=key
        )
    need = 2 * job.vehicles.radius + job.limits.vehicle_gap
    for number, (a, b) in enumerate(pairwise(held), 1):
        length = (b - a) * job.cable.link
        if length < need:
            raise ConfigurationError(
                f"vehicles {number} and {number + 1} hold the cable {1e3 * length:.0f} mm apart, "
                f"and need {1e3 * need:.0f} mm: two radii, and limits.vehicle_gap_mm",
                key=_cause_of_short_piece(job, number, need),
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
