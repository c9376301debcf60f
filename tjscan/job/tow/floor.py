"""Checks of the floor of a tow: its area, the obstacles on it, and the ways between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from scipy.sparse.csgraph import connected_components

from tjscan.core.frames import Array
from tjscan.towing import tables
from tjscan.towing.seam import Seam

SEAM_SAMPLE_STEP: Final = 0.1
"""Metres of seam between two places that are checked."""

EDGE_TOLERANCE: Final = 1e-6
"""Metres within which a point counts as on an edge: work begins and ends at walls."""


class TowFloor(NamedTuple):
    """What of a job lies on the floor.

    Parameters
    ----------
    area : AreaSettings
    root : CableRootSettings
    seam : SeamSettings
    obstacles : sequence of ObstacleSettings
    body : float
        Radius of a vehicle and its clearance, metres.
    pieces : ndarray, shape (vehicles,)
        Lengths of cable before the vehicles, metres.
    """

    area: tables.AreaSettings
    root: tables.CableRootSettings
    seam: tables.SeamSettings
    obstacles: Sequence[tables.ObstacleSettings]
    body: float
    pieces: Array


def floor_contradictions(floor: TowFloor) -> Iterator[tuple[str, str]]:
    """Yield key and message of areas, roots and seams that can't be, and of ways too narrow."""
    outline = shapely.Polygon(floor.area.outline)
    yield from _crossing_contradictions(floor.area.outline, "area.outline_mm")
    inside = outline.buffer(EDGE_TOLERANCE)
    for hole in floor.area.holes:
        yield from _crossing_contradictions(hole, "area.holes_mm")
        if not inside.contains(shapely.Polygon(hole)):
            yield (
                "area.holes_mm",
                f"the pillar at {_point_in_mm(hole[0])} mm is not within the outline",
            )
    solids = _fixed_solids(floor)
    root = shapely.Point(floor.root.position)
    at_root = f"{_point_in_mm(floor.root.position)} mm"
    if not inside.contains(root):
        off = 1e3 * inside.distance(root)
        yield "root.position_mm", f"{at_root} is {off:.0f} mm outside the area"
    for solid in solids:
        if solid.shape.buffer(-EDGE_TOLERANCE).contains(root):
            yield solid.key, f"{solid.name} is on the root, at {at_root}"
    seam = Seam(floor.seam)
    points = floor.seam.points
    line: Any = shapely.LineString(points) if seam.length else shapely.Point(points[0])
    if not inside.contains(line):
        along, off = _farthest_outside(seam, inside)
        yield (
            "seam.points_mm",
            f"the seam leaves the area: {1e3 * along:.0f} mm from its beginning it is "
            f"{1e3 * off:.0f} mm outside",
        )
    blocked = line.difference(_free_floor(floor, solids).buffer(EDGE_TOLERANCE))
    if not blocked.is_empty:
        along = min(line.project(shapely.Point(at)) for at in shapely.get_coordinates(blocked))
        first = shapely.Point(seam.path.point_at(along))
        solid = min(solids, key=lambda one: float(one.shape.distance(first)))
        yield (
            solid.key,
            f"{solid.name} is on the seam, {1e3 * along:.0f} mm from its beginning",
        )
    yield from _welder_contradictions(floor, line)
    yield from _corridor_contradictions(floor)


def _welder_contradictions(floor: TowFloor, line: Any) -> Iterator[tuple[str, str]]:
    """Yield obstacles that never move and are too near to the welder's body on its way."""
    for number, one in enumerate(floor.obstacles):
        off = float(line.distance(shapely.Point(one.points[0]))) - one.radius
        if not one.speed and 0 < off < floor.body:
            yield (
                f"obstacles.{number}",
                f"{one.name} is {1e3 * off:.0f} mm from the seam, and the welder needs "
                f"{1e3 * floor.body:.0f} mm: vehicles.radius_mm and limits.vehicle_clearance_mm",
            )


class _FixedSolid(NamedTuple):
    """What never moves: its name in messages, its key, and its shape."""

    name: str
    key: str
    shape: Any


def _fixed_solids(floor: TowFloor) -> list[_FixedSolid]:
    """Pillars, and obstacles that never move."""
    solids = []
    for hole in floor.area.holes:
        name = f"the pillar at {_point_in_mm(hole[0])} mm"
        solids.append(_FixedSolid(name, "area.holes_mm", shapely.Polygon(hole)))
    for number, one in enumerate(floor.obstacles):
        if not one.speed:
            name = f"{one.name} at {_point_in_mm(one.points[0])} mm"
            disc = shapely.Point(one.points[0]).buffer(one.radius)
            solids.append(_FixedSolid(name, f"obstacles.{number}", disc))
    return solids


def _free_floor(floor: TowFloor, solids: Sequence[_FixedSolid]) -> Any:
    """The area without pillars and obstacles; a wall and a pillar that touch leave no gap."""
    return shapely.Polygon(floor.area.outline).difference(
        shapely.union_all([solid.shape for solid in solids])
    )


def _corridor_contradictions(floor: TowFloor) -> Iterator[tuple[str, str]]:
    """Yield that the floor is too narrow for the vehicles somewhere between root and seam.

    A piece of cable between two vehicles may be in a gap that no vehicle passes, so places for
    vehicles count as joined if the longest piece reaches from one to the other.
    """
    if _can_vehicles_pass(floor, floor.body):
        return
    low, high = 0.0, floor.body
    while high - low > 1e-4:
        middle = (low + high) / 2
        low, high = (middle, high) if _can_vehicles_pass(floor, middle) else (low, middle)
    yield (
        "area.outline_mm",
        f"between root and seam vehicles pass ways {2e3 * high:.0f} mm wide at most, and need "
        f"{2e3 * floor.body:.0f} mm: two radii, and limits.vehicle_clearance_mm on either side",
    )


def _can_vehicles_pass(floor: TowFloor, radius: float) -> bool:
    """Whether bodies of a radius fit one after the other from the root to all of the seam."""
    places = shapely.get_parts(_free_floor(floor, _fixed_solids(floor)).buffer(-radius))
    if len(floor.pieces) < 2 or not len(places):
        return bool(len(places))
    longest = floor.pieces[1:-1].max(initial=0.0)
    _, groups = connected_components(shapely.distance(places[:, None], places) <= longest)
    beside_root = shapely.distance(places, shapely.Point(floor.root.position)) <= floor.pieces[0]
    reached = places[np.isin(groups, groups[beside_root])]
    seam = Seam(floor.seam)
    samples = np.linspace(0, seam.length, 1 + int(seam.length / SEAM_SAMPLE_STEP))
    points = shapely.points(seam.path.point_at(samples))
    is_beside = shapely.distance(reached[:, None], points) <= floor.pieces[-1]
    return bool(is_beside.any(axis=0).all())


def _crossing_contradictions(ring: Sequence[tables.Point], key: str) -> Iterator[tuple[str, str]]:
    """Yield where a polygon crosses or touches itself."""
    polygon = shapely.Polygon(ring)
    why = shapely.is_valid_reason(polygon)
    if why != "Valid Geometry" or not polygon.area:
        place = why.partition("[")[2].rstrip("]").split()
        at = f" at {_point_in_mm(tuple(map(float, place)))} mm" if len(place) == 2 else ""
        yield (
            key,
            f"the polygon that begins at {_point_in_mm(ring[0])} mm crosses or touches itself{at}",
        )


def _farthest_outside(seam: Seam, inside: Any) -> tuple[float, float]:
    """Where along the seam it is farthest outside, and how far, metres."""
    corners = seam.path.corners
    along = np.unique(np.concatenate((corners, np.linspace(0, seam.length, 1001))))
    off = shapely.distance(shapely.points(seam.path.point_at(along)), inside)
    worst = int(np.argmax(off))
    return float(along[worst]), float(off[worst])


def _point_in_mm(point: Sequence[float]) -> str:
    return f"({1e3 * point[0]:.6g}, {1e3 * point[1]:.6g})"
