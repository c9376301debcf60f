"""Before the paper's joint the simulated laser sees leg, bevel and brace, and their mirrors."""

from pathlib import Path

import numpy as np
import pytest

from tjscan.core.frames import Array, pose, rot_x, transform_points
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import FeatureEdges, feature_edges
from tjscan.joint.file import read_joint
from tjscan.joint.mesh import build_joint_mesh, largest_chord_error
from tjscan.laser.faults import LaserRayHits, PointOrigin
from tjscan.laser.model import LaserModel
from tjscan.laser.optics import (
    RaycastSurface,
    SimulatedLaser,
    laser_ray_directions,
    trace_laser_rays,
)

STANDOFF = 0.24
PITCH = 0.5e-3
"""Metres: columns lie 0.17 mm apart, on faces that lean no more than 70° from the rays."""
AZIMUTHS = np.radians([0, 45, 90, 160, 250])


@pytest.fixture(scope="module")
def joint() -> JointDefinition:
    return read_joint(Path(__file__).parent.parent.parent / "cad" / "tjoint-600x457.toml")


@pytest.fixture(scope="module")
def edges(joint: JointDefinition) -> FeatureEdges:
    return feature_edges(joint)


@pytest.fixture(scope="module")
def surface(joint: JointDefinition) -> RaycastSurface:
    mesh = build_joint_mesh(joint)
    return RaycastSurface(mesh.vertices, mesh.triangles)


def before(edges: FeatureEdges, phi: float) -> Array:
    """T_j_s that looks at the groove from outside, x up, with a pull angle of 10°."""
    i = int(np.argmin(np.abs(edges.phi - phi)))
    p2, p4 = edges.p2.points_j[i], edges.p4.points_j[i]
    radial = np.array([np.cos(phi), np.sin(phi), 0.0])
    elevation = np.radians(25 - 42 * np.sin(phi) ** 2)  # about the middle of the opening
    z = -np.cos(elevation) * radial - np.sin(elevation) * np.array([0, 0, 1.0])
    y = np.cross(z, [0, 0, 1.0])
    y /= np.linalg.norm(y)
    R = np.column_stack((np.cross(y, z), y, z)) @ rot_x(np.radians(10))
    return pose(R, 0.5 * (p2 + p4) - STANDOFF * R[:, 2])


def points_of(hits: LaserRayHits) -> Array:
    """Points of all columns in frame s."""
    apex_s = np.array([0, 0, LaserModel().emitter_z])
    return np.asarray(apex_s + hits.distance[:, None] * hits.directions_s)


@pytest.mark.parametrize("phi", AZIMUTHS)
def test_points_lie_on_the_true_surfaces(
    joint: JointDefinition, edges: FeatureEdges, surface: RaycastSurface, phi: float
) -> None:
    model = LaserModel.without_faults()
    T_j_s = before(edges, phi)
    hits = trace_laser_rays(surface, T_j_s, model, laser_ray_directions(model))
    points_s = points_of(hits)[hits.seen]
    x, y, z = transform_points(T_j_s, points_s).T
    above_leg = np.hypot(y, z) - joint.leg_radius
    inside_brace = joint.brace_radius - np.hypot(x, y)
    near = 1.01 * largest_chord_error(joint)
    assert np.all(above_leg > -near)
    assert np.all((inside_brace > -near) | (np.abs(above_leg) < near))
    on_leg, on_brace = np.abs(above_leg) < near, np.abs(inside_brace) < near
    assert on_leg.sum() > 150
    assert on_brace.sum() > 150
    assert np.sum(~on_leg & ~on_brace) > 40  # bevel and root bead


@pytest.mark.parametrize("phi", AZIMUTHS)
def test_a_profile_is_spoilt_as_much_as_asked(
    edges: FeatureEdges, surface: RaycastSurface, phi: float
) -> None:
    model = LaserModel(missing=0.0)
    T_j_s = before(edges, phi)
    with SimulatedLaser(
        surface,
        lambda: T_j_s,
        model=model,
        rng=np.random.default_rng(8),
        clock=lambda: 0.0,
    ) as laser:
        kinds = np.array([laser.capture_with_origins().kind for _ in range(40)])
    points = kinds != PointOrigin.MISSING
    assert points.mean() > 0.85
    assert np.sum(kinds == PointOrigin.GHOST) / points.sum() == pytest.approx(
        model.ghosts, abs=0.01
    )
    assert 0 < np.sum(kinds == PointOrigin.FLYER) / len(kinds) < 6


@pytest.mark.parametrize("phi", AZIMUTHS)
def test_flyers_stand_at_the_edges_of_the_groove(
    edges: FeatureEdges, surface: RaycastSurface, phi: float
) -> None:
    model = LaserModel.without_faults(flyers=1.0)
    T_j_s = before(edges, phi)
    hits = trace_laser_rays(surface, T_j_s, model, laser_ray_directions(model))
    with SimulatedLaser(
        surface,
        lambda: T_j_s,
        model=model,
        rng=np.random.default_rng(8),
        clock=lambda: 0.0,
    ) as laser:
        flyers = laser.capture_with_origins().kind == PointOrigin.FLYER
    points_s = points_of(hits)[flyers]
    away = edges.distances(transform_points(T_j_s, points_s))
    assert np.all(away.min(axis=1) < PITCH)
    assert np.all(away.min(axis=0) < PITCH)
