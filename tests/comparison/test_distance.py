"""Laws of distances and alignments, on shapes whose answers are known."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.comparison.alignment import align_icp, nearest_point_finder_in_cloud
from tjscan.comparison.compare import compare_shapes
from tjscan.comparison.distance import DistanceStatistics, MeshDistance
from tjscan.comparison.shapes import Mesh, Shape, UnitAndFrame
from tjscan.core.errors import ComparisonRefused, ConfigurationError
from tjscan.core.frames import (
    Array,
    inverse_pose,
    pose,
    readonly_copy,
    rotation_angle_between,
    transform_points,
)

EXACT = 1e-9
"""A nanometre: double precision on shapes of a metre, with room to spare."""

PROMISED = 1e-6
"""A thousandth of a millimetre."""

SIDE = 0.4


def box() -> MeshDistance:
    mesh = trimesh.creation.box((SIDE, SIDE, SIDE))
    return MeshDistance(mesh.vertices, mesh.faces)


def box_distance(points: Array) -> Array:
    """Closed form of the signed distance to the box."""
    q = np.abs(points) - SIDE / 2
    outside = np.linalg.norm(np.maximum(q, 0), axis=1)
    return np.asarray(outside + np.minimum(q.max(axis=1), 0))


def strips(sides: int, radius: float = 0.3, length: float = 1.4) -> trimesh.Trimesh:
    """A tube of triangles a thousand times longer than wide: what CAD makes of a leg."""
    return trimesh.creation.cylinder(radius, length, sections=sides)


def shape(name: str, frame: str = "j", **parts: object) -> Shape:
    return Shape(name, UnitAndFrame("mm", "the test", frame), **parts)  # type: ignore[arg-type]


@given(st.floats(-0.05, 0.05), st.integers(0, 99))
@settings(max_examples=20)
def test_a_cloud_shifted_from_a_plane_has_the_shift_as_its_distance(d: float, seed: int) -> None:
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float)
    plane = MeshDistance(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    xy = np.random.default_rng(seed).uniform(-0.9, 0.9, (200, 2))
    points = np.column_stack((xy, np.full(200, d)))
    np.testing.assert_allclose(plane.signed_distances(points), d, atol=EXACT)
    assert not plane.facets.watertight


def test_distances_to_a_box_are_those_of_its_closed_form_inside_and_out() -> None:
    points = np.random.default_rng(1).uniform(-0.35, 0.35, (20_000, 3))
    np.testing.assert_allclose(box().signed_distances(points), box_distance(points), atol=EXACT)


def test_the_sign_is_right_before_edges_and_vertices() -> None:
    corner = np.full(3, SIDE / 2)
    points = np.array([corner + 1e-3, corner - 1e-3, corner + np.array((1e-3, 1e-3, -0.1))])
    assert np.sign(box().signed_distances(points)).tolist() == [1, -1, 1]


def test_long_thin_triangles_keep_distances_right() -> None:
    mesh = strips(3000)
    rng = np.random.default_rng(2)
    angle, z = rng.uniform(0, 2 * np.pi, 20_000), rng.uniform(-0.6, 0.6, 20_000)
    d = rng.normal(0, 2e-3, 20_000)
    points = np.column_stack(((0.3 + d) * np.cos(angle), (0.3 + d) * np.sin(angle), z))
    sagitta = 0.3 * (1 - np.cos(np.pi / 3000))
    found = MeshDistance(mesh.vertices, mesh.faces).signed_distances(points)
    np.testing.assert_allclose(found, d, atol=sagitta + EXACT)


def test_a_rigid_motion_of_both_leaves_distances() -> None:
    rng = np.random.default_rng(3)
    mesh = strips(500)
    points = rng.uniform(-0.5, 0.5, (5000, 3))
    T = pose(
        trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3], (3.0, -2.0, 1.0)
    )
    before = MeshDistance(mesh.vertices, mesh.faces).signed_distances(points)
    after = MeshDistance(transform_points(T, mesh.vertices), mesh.faces).signed_distances(
        transform_points(T, points)
    )
    np.testing.assert_allclose(after, before, atol=PROMISED)


def test_feet_lie_as_far_away_as_the_distance_says() -> None:
    points = np.random.default_rng(4).uniform(-0.35, 0.35, (2000, 3))
    feet, _ = box().nearest_points_and_normals(points)
    np.testing.assert_allclose(
        np.linalg.norm(points - feet, axis=1), np.abs(box_distance(points)), atol=EXACT
    )


def test_no_points_have_no_distances() -> None:
    assert box().signed_distances(np.empty((0, 3))).shape == (0,)


@pytest.mark.parametrize("triangles", [[[0, 0, 1]], [[0, 1, 2]]])
def test_a_mesh_without_an_area_is_refused(triangles: list[list[int]]) -> None:
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], dtype=float)
    with pytest.raises(ConfigurationError, match="no triangle with an area"):
        MeshDistance(line, np.array(triangles))


def test_points_that_are_no_points_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="finite"):
        box().signed_distances(np.array([[0.0, np.nan, 0.0]]))


def test_statistics_keep_the_sign_where_it_means_something() -> None:
    s = DistanceStatistics.from_distances(np.array((-3e-3, 1e-3, 1e-3, 1e-3)))
    assert s.mean == pytest.approx(0.0)
    assert s.median == pytest.approx(1.0)
    assert s.rms == pytest.approx(np.sqrt(3))
    assert s.max == pytest.approx(3.0)


def surface_cloud(noise: float, seed: int = 5) -> Array:
    """Points on three sides of the box."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-SIDE / 2, SIDE / 2, (9000, 3))
    for axis in range(3):
        points[axis::3, axis] = SIDE / 2
    return np.asarray(points + rng.normal(0, noise, points.shape))


SMALL = pose(trimesh.transformations.rotation_matrix(0.02, (1, 2, 3))[:3, :3], (3e-3, -4e-3, 2e-3))


@pytest.mark.parametrize("flyers", [0.0, 0.1])
def test_icp_finds_a_known_small_pose_on_a_mesh(flyers: float) -> None:
    noise = 50e-6
    points = surface_cloud(noise)
    wild = np.random.default_rng(6).random(len(points)) < flyers
    points[wild] += 8e-3
    found = align_icp(
        transform_points(inverse_pose(SMALL), points), box().nearest_points_and_normals
    )
    # Standard deviation noise / sqrt(n) of a position, times ten.
    assert np.linalg.norm(found.T[:3, 3] - SMALL[:3, 3]) < 10 * noise / np.sqrt(3000)
    assert rotation_angle_between(found.T, SMALL) < 10 * noise / np.sqrt(3000) / (SIDE / 4)
    assert found.residual < 1.2 * noise
    assert found.fitness > 0.95 - flyers


def test_icp_finds_a_known_small_pose_on_a_cloud() -> None:
    reference = surface_cloud(0.0, seed=7)
    found = align_icp(
        transform_points(inverse_pose(SMALL), surface_cloud(20e-6)),
        nearest_point_finder_in_cloud(reference),
    )
    assert np.linalg.norm(found.T[:3, 3] - SMALL[:3, 3]) < 0.1e-3
    assert rotation_angle_between(found.T, SMALL) < 1e-3


def test_icp_refuses_a_reference_of_separate_lines() -> None:
    x, z = np.meshgrid(np.arange(-0.2, 0.2, 0.04), np.arange(-0.2, 0.2, 0.0005))
    lines = np.column_stack((x.T.ravel(), np.zeros(x.size), z.T.ravel()))
    with pytest.raises(ComparisonRefused, match="lines"):
        nearest_point_finder_in_cloud(lines)


def test_icp_takes_clouds_that_are_read_only() -> None:
    measured = shape(
        "a", points=readonly_copy(transform_points(inverse_pose(SMALL), surface_cloud(0.0)))
    )
    reference = shape("b", points=readonly_copy(surface_cloud(0.0, seed=7)))
    assert compare_shapes(measured, reference, "icp").alignment.fitness > 0.9


def test_icp_refuses_too_small_an_overlap() -> None:
    with pytest.raises(ComparisonRefused, match="overlap"):
        align_icp(surface_cloud(0.0) + 0.2, box().nearest_points_and_normals)


def test_icp_refuses_points_that_can_slide() -> None:
    top = surface_cloud(0.0)[2::3]
    with pytest.raises(ComparisonRefused, match="slide"):
        align_icp(top, box().nearest_points_and_normals)


@pytest.mark.parametrize("factor", [1000.0, 1e-3])
def test_mistaken_units_are_caught(factor: float) -> None:
    mesh = trimesh.creation.box((SIDE, SIDE, SIDE))
    reference = shape("cad", mesh=Mesh(mesh.vertices, mesh.faces))
    points = surface_cloud(0.0)
    compare_shapes(shape("cloud", points=points), reference)
    with pytest.raises(ConfigurationError, match="wrong unit"):
        compare_shapes(shape("cloud", points=factor * points), reference)
    both = shape("cad", mesh=Mesh(factor * mesh.vertices, mesh.faces))
    with pytest.raises(ConfigurationError, match="no joint"):
        compare_shapes(shape("cloud", points=factor * points), both)


def test_other_frames_are_not_compared_without_alignment() -> None:
    points = surface_cloud(0.0)
    measured, reference = shape("a", "b", points=points), shape("b", "j", points=points)
    with pytest.raises(ConfigurationError, match="frame"):
        compare_shapes(measured, reference)
    assert compare_shapes(measured, reference, "icp").measured.stated.frame == "j"


def test_clouds_are_labelled_unsigned_and_the_tolerance_decides() -> None:
    points = surface_cloud(0.0)
    near, reference = shape("a", points=points + np.array((0, 0, 1e-4))), shape("b", points=points)
    told = compare_shapes(near, reference, tolerance=2e-4)
    (deviation,) = told.deviations
    assert deviation.kind == "cloud to cloud"
    assert not deviation.signed
    assert deviation.within == 1.0
    assert told.passed
    assert not compare_shapes(near, reference, tolerance=5e-5).passed
