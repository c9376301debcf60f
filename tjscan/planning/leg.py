"""What bounds a groove's sections: the leg's cylinder, not its tangents, and faces that turn."""

from __future__ import annotations

from dataclasses import replace
from math import ceil
from typing import Final

import numpy as np

from tjscan.core.errors import TubesNotFound
from tjscan.core.frames import Array, cross, unit_vectors
from tjscan.joint.tubes.cylinder import Cylinder, cylinder_from_normals
from tjscan.planning.edges import EDGE_CORNER_NAMES, GrooveEdges
from tjscan.planning.path import GrooveStations, cut_groove_stations
from tjscan.planning.smoothing import SmoothCurve
from tjscan.planning.template import planar_cross

LEG_PLACE_STEP: Final = 5e-3
"""Metres along the groove between places at which the leg's wall is taken for its cylinder."""

LARGEST_LEG_MISFIT: Final = 1e-3
"""Metres, rms, that the line of p4 may be off a cylinder: beyond, the leg is no tube."""

LARGEST_NORMAL_MISFIT: Final = np.radians(2.0)
"""The same of the wall's normals, rms."""

CUTTING_ROUNDS: Final = 4
"""Newton's, for where a plane cuts a line: more move nothing by a micrometre."""

LINE_SHARES: Final = np.linspace(0.0, 1.0, 13)
"""Of a line between two corners, at which it is cut."""

G: Final = EDGE_CORNER_NAMES.index("g")


def find_leg_cylinder(edges: GrooveEdges) -> Cylinder | None:
    """Find the leg's cylinder: p4 runs along it, and from p4 to g the groove follows its tangent.

    Parameters
    ----------
    edges : GrooveEdges
        With g where wall and tangent meet.

    Returns
    -------
    Cylinder or None
        None for a plate, if too little of the leg's circumference was seen, or if it is no tube.
    """
    s = np.linspace(0.0, edges.length, ceil(edges.length / LEG_PLACE_STEP) + 1)
    p4, normals = edges.corners(s)[:, 1], _leg_normals(edges, s)
    try:
        leg = cylinder_from_normals(p4, normals)
    except TubesNotFound:
        return None
    off = float(np.sqrt(np.mean(leg.signed_distances(p4) ** 2)))
    sines = np.linalg.norm(cross(leg.normals(p4), normals), axis=1)
    turned = float(np.sqrt(np.mean(sines**2)))
    return leg if off <= LARGEST_LEG_MISFIT and turned <= LARGEST_NORMAL_MISFIT else None


def bound_groove_by_leg(edges: GrooveEdges) -> GrooveEdges:
    """Move g along the wall to where the quadrilaterals have the areas that the steel bounds.

    Bounds are the leg's cylinder, and the root, bevel and wall that the sections' straight lines
    sweep along the groove. A plane square to the groove cuts them in curves: most where a section
    stands askew to the groove, as beside the saddles and all round a Y-joint.

    Parameters
    ----------
    edges : GrooveEdges
        With g where wall and tangent meet; they stay as they are if there is no cylinder.
    """
    leg = find_leg_cylinder(edges)
    if leg is None:
        return edges
    _, p4, g, p2 = np.moveaxis(edges.corners(edges.sections), 1, 0)
    down = unit_vectors(g - p2)
    swept = _with_g(edges, g + _lengths_down_to_leg(leg, p4, g, down)[..., None] * down)
    return replace(_match_areas(swept, leg), leg_radius=leg.radius)


def _with_g(edges: GrooveEdges, g: Array) -> GrooveEdges:
    """Edges with g elsewhere at their sections, shape (k, 3)."""
    sigma, closed = edges.curves[G].sigma, edges.closed
    curve = SmoothCurve(edges.sections, g, sigma, edges.length, closed=closed)
    return replace(edges, curves=(*edges.curves[:G], curve, *edges.curves[G + 1 :]))


def _match_areas(swept: GrooveEdges, leg: Cylinder) -> GrooveEdges:
    """Edges with g moved along the wall: areas are those in their planes of what sections sweep."""
    stations = cut_groove_stations(swept, swept.sections)
    p3, p4, g, p2 = np.moveaxis(stations.corners, 1, 0)
    down = unit_vectors(g - p2)
    way = stations.vectors_to_space(down)
    root, face, wall, bevel = (
        _cut_swept_line(swept, stations, k, (k + 1) % len(EDGE_CORNER_NAMES)) for k in range(4)
    )
    face = face + _lengths_down_to_leg(leg, face[0], face, way)[..., None] * way
    away = np.concatenate((root, face, wall, bevel)) - stations.origin
    x, y = (np.sum(away * axis, axis=2) for axis in (stations.across, stations.up))
    area = 0.5 * np.sum(x * np.roll(y, -1, axis=0) - np.roll(x, -1, axis=0) * y, axis=0)
    # The area is linear in g, whose lever is the line from p4 to p2.
    by = (2 * area - planar_cross(g - p3, p2 - p4)) / planar_cross(down, p2 - p4)
    return _with_g(swept, swept.corners(swept.sections)[:, G] + by[:, None] * way)


def _cut_swept_line(edges: GrooveEdges, stations: GrooveStations, a: int, b: int) -> Array:
    """Where stations' planes cut what the line from one corner to another sweeps, (k, m, 3)."""
    shares = LINE_SHARES[:, None, None]
    s = np.tile(stations.s, (len(shares), 1))

    def on_line(corners: Array) -> Array:
        ends = corners.reshape(*s.shape, len(EDGE_CORNER_NAMES), 3)
        return np.asarray((1 - shares) * ends[:, :, a] + shares * ends[:, :, b])

    for _ in range(CUTTING_ROUNDS):
        off = np.sum((on_line(edges.corners(s.ravel())) - stations.origin) * stations.tangent, 2)
        s = s - off / np.sum(on_line(edges.derivatives(s.ravel())) * stations.tangent, axis=2)
        if not edges.closed:
            s = np.clip(s, 0.0, edges.length)
    return on_line(edges.corners(s.ravel()))


def _leg_normals(edges: GrooveEdges, s: Array) -> Array:
    """Unit normals of the leg at p4, shape (m, 3): square to its line, and to that from p4 to g."""
    corners = edges.corners(s)
    return unit_vectors(cross(edges.derivatives(s)[:, 1], corners[:, G] - corners[:, 1]))


def _lengths_down_to_leg(leg: Cylinder, p4: Array, starts: Array, down: Array) -> Array:
    """How far along unit vectors (m, 3) the leg is from points (..., m, 3).

    It has the cylinder's axis, and a radius that brings it through each p4, shape (m, 3).
    """
    from_axis, way = (v - (v @ leg.axis)[..., None] * leg.axis for v in (starts - leg.point, down))
    a, b = np.sum(way**2, axis=-1), np.sum(from_axis * way, axis=-1)
    c = np.sum(from_axis**2, axis=-1) - (leg.radius + leg.signed_distances(p4)) ** 2
    root = np.sqrt(np.maximum(b**2 - a * c, 0.0))
    return np.asarray(-c / (b + np.copysign(root, b)))  # the nearer crossing
