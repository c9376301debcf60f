"""Grooves of simulated joints, read through the simulated laser's optics and faults."""

from pathlib import Path

import numpy as np
import pytest

from tjscan.core.frames import Array, inverse_pose, pose, rot_x, transform_points, unit_vector
from tjscan.groove.read import read_groove
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import FeatureEdges, feature_edges
from tjscan.joint.file import read_joint
from tjscan.joint.mesh import build_joint_mesh
from tjscan.laser.faults import FaultRandomStreams, apply_faults
from tjscan.laser.model import LaserModel
from tjscan.laser.optics import RaycastSurface, laser_ray_directions, trace_laser_rays
from tjscan.laser.profile import Profile

STANDOFF = 0.24
MESH = 5e-6
"""Triangles lie within 3 micrometres of the joint, and sections are not quite cubic."""

NOISY = 0.15e-3
"""Noise and the bias of slanting faces, at 95 percent."""

AZIMUTHS = np.radians(np.arange(3, 360, 30))


@pytest.fixture(scope="module", params=["tjoint-600x457", "yjoint-600x457-60deg"])
def joint(request: pytest.FixtureRequest) -> JointDefinition:
    return read_joint(Path(__file__).parent.parent.parent / "cad" / f"{request.param}.toml")


@pytest.fixture(scope="module")
def edges(joint: JointDefinition) -> FeatureEdges:
    return feature_edges(joint)


@pytest.fixture(scope="module")
def surface(joint: JointDefinition) -> RaycastSurface:
    mesh = build_joint_mesh(joint)
    return RaycastSurface(mesh.vertices, mesh.triangles)


def before(joint: JointDefinition, edges: FeatureEdges, phi: float) -> Array:
    """T_j_s that looks along the middle of the groove's opening, x up, pull angle 10°."""
    i = int(np.argmin(np.abs(edges.phi - phi)))
    p2, p3, p4 = (e.points_j[i] for e in (edges.p2, edges.p3, edges.p4))
    up = np.array([0.0, 0.0, 1.0])
    radial = np.array([np.cos(phi), np.sin(phi), 0.0])
    leg = radial + up * joint.leg_surface.slope(phi, float(np.hypot(*p4[:2])))
    z = -unit_vector(unit_vector(p2 - p3) + unit_vector(leg))
    y = unit_vector(np.cross(z, up))
    R = np.column_stack((np.cross(y, z), y, z)) @ rot_x(np.radians(10))
    return pose(R, 0.5 * (p2 + p4) - STANDOFF * R[:, 2])


def corners(edges: FeatureEdges, T_j_s: Array, phi: float) -> Array:
    """Where the laser plane cuts the edges near an azimuth, x and z in frame s."""
    i = int(np.argmin(np.abs(edges.phi - phi)))
    near = (np.arange(-100, 101) + i) % len(edges.phi)
    found = []
    for edge in (edges.p2, edges.p3, edges.p4):
        p = transform_points(inverse_pose(T_j_s), edge.points_j[near])
        k = int(np.flatnonzero(np.diff(np.sign(p[:, 1])))[0])
        share = p[k, 1] / (p[k, 1] - p[k + 1, 1])
        found.append((p[k] + share * (p[k + 1] - p[k]))[[0, 2]])
    return np.array(found)


def profile(surface: RaycastSurface, T_j_s: Array, model: LaserModel, seed: int) -> Profile:
    hits = trace_laser_rays(surface, T_j_s, model, laser_ray_directions(model))
    points = apply_faults(hits, model, FaultRandomStreams.spawn(np.random.default_rng(seed)))
    return Profile(points.x_s, points.z_s)


@pytest.mark.parametrize("phi", AZIMUTHS)
def test_without_faults_the_edges_are_found(
    joint: JointDefinition, edges: FeatureEdges, surface: RaycastSurface, phi: float
) -> None:
    T_j_s = before(joint, edges, phi)
    section = read_groove(profile(surface, T_j_s, LaserModel.without_faults(), 0))
    off = section.points_s[1:4, [0, 2]] - corners(edges, T_j_s, phi)
    assert np.abs(off).max() < 2 * MESH


def test_with_default_faults_they_are_found_nearly(
    joint: JointDefinition, edges: FeatureEdges, surface: RaycastSurface
) -> None:
    model, off = LaserModel(), []
    for k, phi in enumerate(AZIMUTHS):
        T_j_s = before(joint, edges, phi)
        truth = corners(edges, T_j_s, phi)
        for seed in range(4):
            section = read_groove(profile(surface, T_j_s, model, 10 * k + seed))
            off.append(np.linalg.norm(section.points_s[1:4, [0, 2]] - truth, axis=1))
    assert np.percentile(off, 95) < NOISY
    assert np.max(off) < 4 * NOISY


@pytest.mark.parametrize("phi", AZIMUTHS[::4])
def test_x_of_g_runs_counterclockwise_round_the_brace(
    joint: JointDefinition, edges: FeatureEdges, surface: RaycastSurface, phi: float
) -> None:
    T_j_s = before(joint, edges, phi)
    section = read_groove(profile(surface, T_j_s, LaserModel.without_faults(), 0))
    T_j_g = T_j_s @ section.T_s_g
    around = np.array([-np.sin(phi), np.cos(phi), 0.0])
    assert T_j_g[:3, 0] @ around > np.cos(np.radians(25))
    assert T_j_g[2, 1] > np.cos(np.radians(25))  # y of g runs up the brace
