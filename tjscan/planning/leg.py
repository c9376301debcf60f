"""The leg below a groove: its cylinder, through the line of p4, in place of its tangents there."""

from __future__ import annotations

from dataclasses import replace
from math import ceil
from typing import Final

import numpy as np

from tjscan.core.errors import TubesNotFound
from tjscan.core.frames import Array, cross, unit_vectors
from tjscan.joint.tubes.cylinder import Cylinder, cylinder_from_normals
from tjscan.planning.edges import EDGE_CORNER_NAMES, GrooveEdges
from tjscan.planning.path import cut_groove_stations
from tjscan.planning.smoothing import SmoothCurve

LEG_PLACE_STEP: Final = 5e-3
"""Metres along the groove between places at which the leg's wall is taken for its cylinder."""

LARGEST_LEG_MISFIT: Final = 1e-3
"""Metres, rms, that the line of p4 may be off a cylinder: beyond, the leg is no tube."""

LARGEST_NORMAL_MISFIT: Final = np.radians(2.0)
"""The same of the wall's normals, rms."""

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
    """Move g along the wall to where a straight line from p4 bounds the area that the leg bounds.

    A section then stays a quadrilateral, and its area is that down to the leg's own curve: of rays
    along the wall from the tangent to the cylinder, g moves by twice their mean.

    Parameters
    ----------
    edges : GrooveEdges
        With g where wall and tangent meet; they stay as they are if there is no cylinder.
    """
    leg = find_leg_cylinder(edges)
    if leg is None:
        return edges
    stations, normals = (
        cut_groove_stations(edges, edges.sections),
        _leg_normals(edges, edges.sections),
    )
    corners = stations.points_to_space(stations.corners)
    p4, g = corners[:, 1], corners[:, G]
    down = unit_vectors(g - corners[:, 3])
    # The leg's axis and radius, but through each section's own p4 and tangent.
    out = unit_vectors(normals - (normals @ leg.axis)[:, None] * leg.axis)
    out *= np.sign(np.sum(out * leg.normals(p4), axis=1, keepdims=True))
    along = g - p4 - np.sum((g - p4) * out, axis=1, keepdims=True) * out
    places, weights = np.polynomial.legendre.leggauss(5)  # exact for curves of ninth degree
    starts = leg.radius * out + 0.5 * (places[:, None, None] + 1) * along
    moved = weights @ _lengths_down_to_cylinder(leg, starts, down)
    curve = edges.curves[G]
    lowered = SmoothCurve(
        edges.sections,
        edges.corners(edges.sections)[:, G] + moved[:, None] * down,
        curve.sigma,
        edges.length,
        closed=edges.closed,
    )
    curves = (*edges.curves[:G], lowered, *edges.curves[G + 1 :])
    return replace(edges, curves=curves, leg_radius=leg.radius)


def _leg_normals(edges: GrooveEdges, s: Array) -> Array:
    """Unit normals of the leg at p4, shape (m, 3): square to its line, and to that from p4 to g."""
    corners = edges.corners(s)
    return unit_vectors(cross(edges.derivatives(s)[:, 1], corners[:, G] - corners[:, 1]))


def _lengths_down_to_cylinder(leg: Cylinder, starts: Array, down: Array) -> Array:
    """How far along unit vectors (m, 3) the wall is from points beside the axis, (k, m, 3)."""
    axis = leg.axis
    from_axis, way = (v - (v @ axis)[..., None] * axis for v in (starts, down))
    a, b = np.sum(way**2, axis=-1), np.sum(from_axis * way, axis=-1)
    c = np.sum(from_axis**2, axis=-1) - leg.radius**2
    root = np.sqrt(np.maximum(b**2 - a * c, 0.0))
    return np.asarray(-c / (b + np.copysign(root, b)))  # the nearer crossing
