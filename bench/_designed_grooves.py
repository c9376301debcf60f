"""Grooves of joints as designed: outlines, areas and volume, which no planner had a hand in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Final

import manifold3d
import numpy as np
import shapely

from tjscan.core.frames import Array
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import JointGrooveSections
from tjscan.joint.geometry import cylindrical_to_j
from tjscan.planning.edges import GrooveEdges, fit_edges_to_corners
from tjscan.planning.leg import bound_groove_by_leg
from tjscan.planning.path import GrooveStations

BRACES_MM: Final = {
    168.3: (8.0, 12.5, 16.0, 20.0),
    219.1: (8.0, 12.5, 16.0, 22.0),
    323.9: (8.0, 12.5, 20.0, 32.0),
    457.2: (8.0, 16.0, 25.4, 40.0),
    610.0: (8.0, 16.0, 25.4, 40.0),
}
"""Walls by outer diameter, as `examples/joints-study.toml` has them."""

LEG_TO_BRACE: Final = (1.05, 1.2, 1.5, 2.0, 3.0)
ANGLES_DEG: Final = (60.0, 75.0, 90.0)
GROOVE_DEG: Final = ((60.0, 38.0), (90.0, 50.0), (140.0, 65.0), (165.0, 77.0))
"""The same file's sizes of legs, angles between the axes, and groove angles."""


def designed_corners(joint: JointDefinition, phi: Array) -> Array:
    """p3, p4, g and p2 as designed, shape (n, 4, 3): g where wall and the leg's tangent meet."""
    found = JointGrooveSections(joint, phi)
    slope = joint.leg_surface.slope(phi, found.p4[:, 0])
    rho = found.p2[:, 0]
    g = np.column_stack((rho, found.p4[:, 1] + slope * (rho - found.p4[:, 0])))
    corners = (found.p3, found.p4, g, found.p2)
    return np.stack([cylindrical_to_j(phi, p[:, 0], p[:, 1]) for p in corners], axis=1)


def designed_rims(joint: JointDefinition, phi: Array, count: int) -> Array:
    """Outlines of the groove in radial planes, shape (n, 4 count, 3): root, leg, wall, bevel."""
    found = JointGrooveSections(joint, phi)
    p2, p3, p4 = found.p2[:, None], found.p3[:, None], found.p4[:, None]
    share = np.linspace(0.0, 1.0, count, endpoint=False)[:, None]
    rho = p4[..., 0] + share.T * (p2[..., 0] - p4[..., 0])
    foot = np.stack((p2[..., 0], joint.leg_surface.height(phi, p2[:, 0, 0])[:, None]), axis=2)
    leg = np.stack((rho, joint.leg_surface.height(phi[:, None], rho)), axis=2)
    root, wall, bevel = (a + share * (b - a) for a, b in ((p3, p4), (foot, p2), (p2, p3)))
    rim = np.concatenate((root, leg, wall, bevel), axis=1)
    return cylindrical_to_j(np.broadcast_to(phi[:, None], rim.shape[:2]), rim[..., 0], rim[..., 1])


def designed_areas(joint: JointDefinition, stations: GrooveStations) -> Array:
    """Areas in the stations' planes as designed, shape (m,), m²: of the joint's own surfaces.

    Where the outlines' points, followed round the joint, pass a plane is its section's outline.
    """
    found = []
    for origin, tangent, across, up in zip(
        stations.origin, stations.tangent, stations.across, stations.up, strict=True
    ):
        phi = np.arctan2(origin[1], origin[0]) + np.linspace(-0.3, 0.3, 401)
        away = designed_rims(joint, phi, 50) - origin
        beyond = away @ tangent
        beyond *= np.sign(beyond[-1, 0] - beyond[0, 0])
        outline = [
            [np.interp(0.0, off, line @ axis) for axis in (across, up)]
            for off, line in zip(beyond.T, away.swapaxes(0, 1), strict=True)
        ]
        found.append(shapely.Polygon(outline).area)
    return np.array(found)


def ring_solid(rings: Array) -> manifold3d.Manifold:
    """The solid between outlines, shape (n, k, 3), the last of which joins the first."""
    n, k = rings.shape[:2]
    at = np.arange(n * k).reshape(n, k)
    on = np.roll(at, -1, axis=0)
    faces = []
    for j in range(k):
        a, b, c, d = at[:, j], on[:, j], on[:, (j + 1) % k], at[:, (j + 1) % k]
        faces += [np.column_stack((a, b, c)), np.column_stack((a, c, d))]
    triangles = np.concatenate(faces).astype(np.uint64)
    vertices = rings.reshape(-1, 3)
    solid = manifold3d.Manifold(manifold3d.Mesh64(vertices, triangles))
    if solid.volume() < 0:
        solid = manifold3d.Manifold(manifold3d.Mesh64(vertices, triangles[:, ::-1].copy()))
    return solid


def drawn_edges(
    joint: JointDefinition, phi: Array, sigma: float, seed: int, *, longest_step: float = 0.13
) -> GrooveEdges:
    """Edges through sections drawn at azimuths, shape (n,), with errors in their plane."""
    p, rng = designed_corners(joint, phi), np.random.default_rng(seed)
    up = np.array((0.0, 0.0, 1.0))
    out = np.column_stack((np.cos(phi), np.sin(phi), 0 * phi))[:, None]
    errors = sigma * rng.standard_normal((*p.shape[:2], 2))
    spoiled = p + errors[..., :1] * out + errors[..., 1:] * up
    # A corner moves the area by half the diagonal that it does not stand on.
    diagonals = np.linalg.norm(p[:, 2:] - p[:, :2], axis=2)
    normals = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    area_sigma = sigma * np.linalg.norm(0.5 * diagonals[:, [0, 1, 0, 1]], axis=1)
    edges = fit_edges_to_corners(
        spoiled, np.full(p.shape[:2], np.sqrt(2) * sigma), area_sigma / areas, longest_step
    )
    return bound_groove_by_leg(edges)


def many_joints(joint: JointDefinition) -> Iterator[JointDefinition]:
    """The 300 joints of `examples/joints-study.toml`, with the root of a given one."""
    table = tuple((np.radians(a), np.radians(b)) for a, b in GROOVE_DEG)
    braces = [(d, wall) for d, walls in BRACES_MM.items() for wall in walls]
    for (diameter, wall), ratio, angle in product(braces, LEG_TO_BRACE, ANGLES_DEG):
        yield replace(
            joint,
            name=f"{ratio * diameter:.0f} x {diameter:g} mm, wall {wall:g} mm, {angle:g}°",
            leg_radius=0.5e-3 * ratio * diameter,
            leg_wall=1e-3 * wall,
            brace_radius=0.5e-3 * diameter,
            brace_wall=1e-3 * wall,
            angle=np.radians(angle),
            groove_table=table,
        )
