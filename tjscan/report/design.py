"""What each section should measure, as the joint was designed, in that section's own plane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array, inverse_pose, transform_points, unit_vector
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.section import section_from_points
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import ClosedPolyline, feature_edges
from tjscan.joint.geometry import radial_direction

SEARCH_DISTANCE: Final = 30e-3
"""Metres from a measured corner within which its designed one is sought."""


def designed_measures(sections: Sequence[MeasuredSection], joint: JointDefinition) -> Array:
    """Groove angle, root width, depth and area, shape (n, 4); NaN if a plane meets no groove.

    The laser's plane is turned from the groove's normal plane, where a drawing states angles. So
    the designed edges are cut by the plane of each section, and measured like it.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        In frame j.
    joint : JointDefinition
        As designed.
    """
    edges = feature_edges(joint)
    lines = (edges.p2, edges.p3, edges.p4)
    return np.array([_measures(section, lines, joint) for section in sections]).reshape(-1, 4)


def _measures(
    section: MeasuredSection, lines: Sequence[ClosedPolyline], joint: JointDefinition
) -> Array:
    T_g_j = inverse_pose(section.T_r_g)
    corners = [
        _cut(line, T_g_j, corner) for line, corner in zip(lines, section.points[1:4], strict=True)
    ]
    if any(corner is None for corner in corners):
        return np.full(4, np.nan)
    p2, p3, p4 = (corner for corner in corners if corner is not None)
    across = T_g_j[:3, :3]
    wall = _in_plane(across @ radial_direction(np.arctan2(p2[1], p2[0])))
    leg = _in_plane(across @ joint.leg_surface.normal(p4))
    points_g = transform_points(T_g_j, [p2, p3, p4])
    # As frame s sees it: x up the wall, z from the sensor into the joint.
    points = np.zeros((5, 3))
    points[1:4, 0], points[1:4, 2] = points_g[:, 1], -points_g[:, 2]
    down, out = (np.array((v[1], 0.0, -v[2])) for v in (-wall, leg))
    points[0], points[4] = points[1] - down, points[3] + out
    try:
        found = section_from_points(points, wall_s=down, leg_s=out)
    except GrooveNotFound:
        return np.full(4, np.nan)
    return np.array((found.groove_angle, found.root_width, found.depth, found.area))


def _in_plane(normal_g: Array) -> Array:
    """Where a surface of that normal goes in the section's plane, up or outwards, in g."""
    direction = unit_vector(np.cross((1.0, 0.0, 0.0), normal_g))
    return np.asarray(direction * np.sign(direction[1] + direction[2]))


def _cut(line: ClosedPolyline, T_g_j: Array, near: Array) -> Array | None:
    """Where a line goes through the section's plane, nearest to a point, in frame j."""
    points = line.points_j
    x = points @ T_g_j[0, :3] + T_g_j[0, 3]
    after = np.roll(x, -1)
    starts = np.flatnonzero((x <= 0) != (after <= 0))
    if not starts.size:
        return None
    share = (x[starts] / (x[starts] - after[starts]))[:, None]
    ends = np.roll(points, -1, axis=0)[starts]
    cuts = points[starts] + share * (ends - points[starts])
    apart = np.linalg.norm(cuts - near, axis=1)
    return np.asarray(cuts[apart.argmin()]) if apart.min() < SEARCH_DISTANCE else None
