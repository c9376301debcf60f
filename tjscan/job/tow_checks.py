"""What a tow job asks for that can't be, by its numbers and its plane geometry alone."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.job.tow_job import TowJob
from tjscan.towing.seam import Seam
from tjscan.towing.tables import Point
from tjscan.vehicle.cable.model import TowingVehicleModel

SAMPLE: Final = 0.1
"""Metres of seam from one place that is looked at to the next."""

ON_EDGE: Final = 1e-6
"""Metres within which a point counts as on an edge: work begins and ends at walls."""


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
    _check_geometry(job)
    _check_corridor(job)


def _check_sizes(job: TowJob) -> None:
    """Refuse sizes that would change nothing.

    Raises
    ------
    ConfigurationError
        With the key, and what to say instead.
    """
    gap, length = job.limits.cable_gap, job.cable.length
    if np.pi / 2 * gap >= length:
        raise ConfigurationError(
            f"half a circle that wide, {5e2 * np.pi * gap:.0f} mm, is longer than the cable, and "
            f"no two links would be held apart: say less than {2e3 / np.pi * length:.0f}",
            key="limits.cable_gap_mm",
        )
    model, usual = job.simulation.towing_vehicle, TowingVehicleModel()
    for key, value, default, ours, instead in (
        ("body_radius_mm", model.body_radius, usual.body_radius, job.vehicles.radius, "radius_mm"),
        ("force_n", model.force, usual.force, job.vehicles.force, "force_n"),
    ):
        if value not in (default, ours):
            raise ConfigurationError(
                f"simulated vehicles are as vehicles.{instead} says: set that, and leave this out",
                key=f"simulation.towing_vehicle.{key}",
            )


def _check_faults(job: TowJob) -> None:
    """Refuse faults of vehicles and passers-by that there are not.

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


def _check_geometry(job: TowJob) -> None:
    """Refuse an area, a root or a seam that can't be, and what stands on them.

    Raises
    ------
    ConfigurationError
        With the key, and where and by how much.
    """
    from shapely import LineString, get_coordinates
    from shapely import Point as ShapelyPoint

    outline = _polygon(job.area.outline, "area.outline_mm")
    inside = outline.buffer(ON_EDGE)
    for hole in job.area.holes:
        pillar = _polygon(hole, "area.holes_mm")
        if not inside.contains(pillar):
            raise ConfigurationError(
                f"the pillar at {_mm(hole[0])} mm does not lie within the outline",
                key="area.holes_mm",
            )
    solids = _solids(job)
    root = ShapelyPoint(job.root.position)
    if not inside.contains(root):
        off = 1e3 * inside.distance(root)
        raise ConfigurationError(
            f"{_mm(job.root.position)} mm lies {off:.0f} mm outside the area",
            key="root.position_mm",
        )
    for solid in solids:
        if solid.shape.buffer(-ON_EDGE).contains(root):
            raise ConfigurationError(
                f"{solid.name} stands on the root, at {_mm(job.root.position)} mm", key=solid.key
            )
    seam = Seam(job.seam)
    line: Any = LineString(job.seam.points) if seam.length else ShapelyPoint(job.seam.points[0])
    if not inside.contains(line):
        along, off = _farthest_outside(seam, inside)
        raise ConfigurationError(
            f"the seam leaves the area: {1e3 * along:.0f} mm from its beginning it lies "
            f"{1e3 * off:.0f} mm outside",
            key="seam.points_mm",
        )
    blocked = line.difference(_floor(job, solids).buffer(ON_EDGE))
    if not blocked.is_empty:
        along = min(line.project(ShapelyPoint(at)) for at in get_coordinates(blocked))
        first = ShapelyPoint(seam.path.point_at(along))
        solid = min(solids, key=lambda one: float(one.shape.distance(first)))
        raise ConfigurationError(
            f"{solid.name} stands on the seam, {1e3 * along:.0f} mm from its beginning",
            key=solid.key,
        )


class _Solid(NamedTuple):
    """What never moves: its name in messages, its key, and its shape."""

    name: str
    key: str
    shape: Any


def _solids(job: TowJob) -> list[_Solid]:
    """Pillars, and obstacles that stand."""
    from shapely import Point as ShapelyPoint
    from shapely import Polygon

    pillars = [
        _Solid(f"the pillar at {_mm(hole[0])} mm", "area.holes_mm", Polygon(hole))
        for hole in job.area.holes
    ]
    standing = [
        _Solid(
            f"the obstacle {one.name!r} at {_mm(one.points[0])} mm",
            f"obstacles.{number}",
            ShapelyPoint(one.points[0]).buffer(one.radius),
        )
        for number, one in enumerate(job.obstacles)
        if not one.speed
    ]
    return pillars + standing


def _floor(job: TowJob, solids: Sequence[_Solid]) -> Any:
    """The area without what stands in it; a wall and a pillar that touch leave nothing between."""
    from shapely import Polygon, union_all

    return Polygon(job.area.outline).difference(union_all([solid.shape for solid in solids]))


def _check_corridor(job: TowJob) -> None:
    """Refuse a floor too narrow for the vehicles somewhere between root and seam.

    A piece of cable between two vehicles may lie in a gap that no vehicle passes, so places for
    vehicles count as joined where the longest piece reaches from one to the other.

    Raises
    ------
    ConfigurationError
        With what they need, and how much there is.
    """
    radius = job.vehicles.radius + job.limits.vehicle_clearance
    if _is_passable(job, radius):
        return
    low, high = 0.0, radius
    while high - low > 1e-4:
        middle = (low + high) / 2
        low, high = (middle, high) if _is_passable(job, middle) else (low, middle)
    raise ConfigurationError(
        f"between root and seam vehicles pass ways {2e3 * high:.0f} mm wide at most, and need "
        f"{2e3 * radius:.0f} mm: two radii, and limits.vehicle_clearance_mm on either side",
        key="area.outline_mm",
    )


def _is_passable(job: TowJob, radius: float) -> bool:
    """Whether bodies of a radius may stand one after the other from the root to all the seam."""
    from shapely import Point as ShapelyPoint
    from shapely import get_parts

    places = list(get_parts(_floor(job, _solids(job)).buffer(-radius)))
    pieces = job.cable.link * np.diff(job.held_links, prepend=-1)
    if len(pieces) < 2 or not places:
        return bool(places)
    root = ShapelyPoint(job.root.position)
    reached = {k for k, place in enumerate(places) if place.distance(root) <= pieces[0]}
    while True:
        more = {
            k
            for k, place in enumerate(places)
            if any(place.distance(places[n]) <= pieces[1:-1].max(initial=0.0) for n in reached)
        } - reached
        if not more:
            break
        reached |= more
    seam = Seam(job.seam)
    samples = np.linspace(0, seam.length, 1 + int(seam.length / SAMPLE))
    return all(
        any(places[k].distance(ShapelyPoint(seam.path.point_at(s))) <= pieces[-1] for k in reached)
        for s in samples
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
                "vehicles.links say how long the piece behind the welder is: leave this key out",
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
    """Key that has to change where the piece of cable behind a vehicle is too short."""
    if need > job.cable.length / 2:  # more than two vehicles have, the fewest
        wide = 2 * job.vehicles.radius > job.limits.vehicle_gap
        return "vehicles.radius_mm" if wide else "limits.vehicle_gap_mm"
    if job.vehicles.links is not None:
        return "vehicles.links"
    behind = job.vehicles.behind_welder is not None and number == job.vehicles.count - 1
    return "vehicles.behind_welder_mm" if behind else "vehicles.count"


def _polygon(ring: Sequence[Point], key: str) -> Any:
    from shapely import Polygon
    from shapely.validation import explain_validity

    polygon = Polygon(ring)
    why = explain_validity(polygon)
    if why != "Valid Geometry" or not polygon.area:
        place = why.partition("[")[2].rstrip("]").split()
        at = f" at {_mm(tuple(map(float, place)))} mm" if len(place) == 2 else ""
        raise ConfigurationError(
            f"the polygon that begins at {_mm(ring[0])} mm crosses or touches itself{at}", key=key
        )
    return polygon


def _farthest_outside(seam: Seam, inside: Any) -> tuple[float, float]:
    """Where along the seam it is farthest outside, and how far, metres."""
    from shapely import distance, points

    corners = seam.path.corners
    along = np.unique(np.concatenate((corners, np.linspace(0, seam.length, 1001))))
    places = np.array([seam.path.point_at(s) for s in along])
    off = distance(points(places), inside)
    worst = int(np.argmax(off))
    return float(along[worst]), float(off[worst])


def _mm(point: Sequence[float]) -> str:
    return f"({1e3 * point[0]:.6g}, {1e3 * point[1]:.6g})"
