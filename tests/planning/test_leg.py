"""A groove is bounded by the leg's cylinder; of a plate, or of what is no tube, by a line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plates import half_v
from ringed_grooves import corners_along_arc, edges_of

from tjscan.core.frames import Array
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import JointGrooveSections
from tjscan.joint.file import read_joint
from tjscan.joint.geometry import cylindrical_to_j
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.leg import bound_groove_by_leg, find_leg_cylinder
from tjscan.planning.path import cut_groove_stations, map_template_onto
from tjscan.planning.template import planar_cross

JOINT = read_joint(Path(__file__).parents[2] / "cad" / "tjoint-600x457.toml")
ROUND = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)


def measured(phi: Array, joint: JointDefinition = JOINT) -> GrooveEdges:
    """Edges as a scan has them: g is where the wall and the leg's tangent at p4 meet."""
    found = JointGrooveSections(joint, phi)
    slope = joint.leg_surface.slope(phi, found.p4[:, 0])
    rho = found.p2[:, 0]
    g = np.column_stack((rho, found.p4[:, 1] + slope * (rho - found.p4[:, 0])))
    corners = (found.p3, found.p4, g, found.p2)
    return edges_of(np.stack([cylindrical_to_j(phi, *p.T) for p in corners], axis=1))


def area_at(edges: GrooveEdges, azimuth: float) -> float:
    s = np.linspace(0.0, edges.length, 4001)
    p3 = edges.corners(s)[:, 0]
    turned = np.mod(np.arctan2(p3[:, 1], p3[:, 0]) - azimuth + np.pi, 2 * np.pi) - np.pi
    at = s[[int(np.argmin(np.abs(turned)))]]
    return float(map_template_onto(cut_groove_stations(edges, at), 0.0).area[0])


def saddle_area() -> float:
    """Square to the leg's axis it is a circle: the chord's quadrilateral less the circle's cap."""
    found, R = JointGrooveSections(JOINT, np.array([0.5 * np.pi])), JOINT.leg_radius
    p2, p3, p4 = found.p2[0], found.p3[0], found.p4[0]
    foot = np.array((p2[0], JOINT.leg_surface.height(np.array([0.5 * np.pi]), p2[:1])[0]))
    x, z = np.array((p3, p4, foot, p2)).T
    quad = 0.5 * abs(np.sum(x * np.roll(z, -1) - np.roll(x, -1) * z))
    turn = 2 * np.arcsin(0.5 * np.linalg.norm(foot - p4) / R)
    return float(quad - 0.5 * R**2 * (turn - np.sin(turn)))


def test_the_leg_s_cylinder_is_found_through_the_groove_alone() -> None:
    for phi in (ROUND, np.radians(np.linspace(-10.0, 120.0, 16))):
        leg = find_leg_cylinder(measured(phi))
        assert leg is not None
        assert leg.radius == pytest.approx(JOINT.leg_radius, rel=1e-3)


def test_at_the_saddle_the_area_is_that_over_the_circle() -> None:
    tangent = measured(ROUND)
    bounded = bound_groove_by_leg(tangent)
    assert bounded.leg_radius == pytest.approx(JOINT.leg_radius, rel=1e-3)
    for azimuth in (0.5 * np.pi, 1.5 * np.pi):
        assert area_at(tangent, azimuth) / saddle_area() - 1 < -0.03
        assert area_at(bounded, azimuth) == pytest.approx(saddle_area(), rel=1e-3)


def test_all_round_a_y_joint_the_area_is_that_between_its_surfaces() -> None:
    """The reference counts points of the plane that lie between bevel, wall, root and leg."""
    joint = replace(JOINT, leg_radius=1.2 * JOINT.brace_radius, angle=np.radians(70.0))
    edges = bound_groove_by_leg(measured(ROUND, joint))
    stations = cut_groove_stations(edges, np.linspace(0.0, edges.length, 5)[:-1] + 7e-3)
    step = 0.3e-3
    at = np.arange(-50e-3, 50e-3, step) + 0.5 * step
    grid = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    found = np.array([points_between_surfaces(joint, p) for p in stations.points_to_space(
        np.broadcast_to(grid, (len(stations.s), *grid.shape))
    )]) * step**2  # fmt: skip
    areas = map_template_onto(stations, 0.0).area
    assert areas == pytest.approx(found, rel=3e-3)


def points_between_surfaces(joint: JointDefinition, points: Array) -> int:
    """How many points, shape (k, 3), are in the groove as it was designed."""
    rho, phi, z = np.hypot(*points[:, :2].T), np.arctan2(points[:, 1], points[:, 0]), points[:, 2]
    found = JointGrooveSections(joint, phi)

    def beyond(a: Array, b: Array) -> Array:
        """On the left of the line from a to b in the radial plane."""
        return planar_cross(b - a, np.column_stack((rho, z)) - a)

    above_leg = np.linalg.norm(np.cross(points, joint.leg_surface.axis), axis=1) > joint.leg_radius
    bevel, root = beyond(found.p3, found.p2), beyond(found.p4, found.p3)
    return int(np.sum(above_leg & (rho < found.p2[:, 0]) & (bevel < 0) & (root < 0)))


def test_at_the_crown_where_the_leg_is_straight_nothing_changes() -> None:
    tangent = measured(ROUND)
    before, now = (area_at(one, 0.0) for one in (tangent, bound_groove_by_leg(tangent)))
    assert now == pytest.approx(before, rel=1e-4)


def test_a_plate_and_a_cone_are_no_tube() -> None:
    flat = half_v()
    x = np.linspace(0, 0.3, 8)[:, None]
    straight = np.stack(np.broadcast_arrays(x, flat[:, 0], flat[:, 1]), axis=2)
    tilted = flat @ np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    for corners in (straight, corners_along_arc(tilted)):
        edges = edges_of(corners)
        assert bound_groove_by_leg(edges) is edges
