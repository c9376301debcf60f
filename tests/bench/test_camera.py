"""The simulated structured-light camera sees the joint's surface, and only what it can see."""

from dataclasses import replace
from functools import cache

import numpy as np
from camera import CAD, EXACT, MIDDLE, Camera, Stage
from scipy.spatial import KDTree

from tjscan.comparison.distance import MeshDistance
from tjscan.joint.edges import feature_edges
from tjscan.joint.file import read_joint
from tjscan.joint.mesh import build_joint_mesh

COARSE = replace(EXACT, points=(486, 300))


@cache
def stage() -> Stage:
    return Stage()


def distances(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Points of a cloud, and how far they are outside the surface, metres."""
    mesh = build_joint_mesh(read_joint(CAD))
    points = stage().cloud_j(camera, np.random.default_rng(1))
    return points, MeshDistance(mesh.vertices, mesh.triangles.astype(np.intp)).signed_distances(
        points
    )


def test_an_exact_camera_measures_the_surface_on_its_side_of_the_brace() -> None:
    points, off = distances(COARSE)
    assert len(points) > 1000
    assert np.abs(off).max() < 1e-6
    brace = points[np.hypot(points[:, 0], points[:, 1]) < 0.2287]
    azimuth = np.angle(np.exp(1j * (np.arctan2(brace[:, 1], brace[:, 0]) - MIDDLE)))
    assert np.abs(azimuth).max() < np.pi / 2


def test_noise_is_as_large_as_stated_where_the_surface_faces_the_camera() -> None:
    noise = 55e-6
    _, off = distances(replace(COARSE, noise=noise))
    assert noise / 2 < np.std(off) < 2 * noise


def test_corners_count_where_a_cloud_has_points_at_all_edges_of_the_groove() -> None:
    it, edges = stage(), feature_edges(read_joint(CAD))
    cloud = KDTree(it.cloud_j(EXACT, np.random.default_rng(1)))
    counted = it.is_seen(edges.p3.points_j)
    for edge in (edges.p2, edges.p3, edges.p4):
        assert np.max(cloud.query(edge.points_j[counted])[0]) < 1e-3
    turn = np.degrees(it.seen)
    assert -70 < turn[0] < -30
    assert 30 < turn[1] < 70


def test_what_the_projector_does_not_light_has_no_point() -> None:
    both = stage().cloud_j(COARSE, np.random.default_rng(1))
    apart = stage().cloud_j(replace(COARSE, baseline=0.5), np.random.default_rng(1))
    assert len(apart) < len(both)
