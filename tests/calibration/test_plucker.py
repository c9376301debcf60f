"""Laws of lines and planes, eq. (17)-(19)."""

import numpy as np
import pytest
from _board import transform_plane
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tjscan.calibration.closed_form import (
    PluckerLine,
    PluckerPlane,
    incidence_residuals,
    line_through_point,
    line_transform_matrix,
    plane_through_point,
    transform_line,
)
from tjscan.core.frames import Array, inverse_pose, pose, transform_points
from tjscan.core.pose_vector import adjoint, pose_from_vector

EXACT = 1e-12

coordinates = st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(np.array)
directions = coordinates.filter(lambda v: np.linalg.norm(v) > 0.1)
poses = st.builds(
    lambda r, p: pose(Rotation.from_rotvec(r).as_matrix(), p), coordinates, coordinates
)
laws = settings(max_examples=40, deadline=None)


@laws
@given(point=coordinates, a=directions, along=st.floats(-3, 3))
def test_a_line_does_not_depend_on_the_point_that_names_it(
    point: Array, a: Array, along: float
) -> None:
    line = line_through_point(point, a)
    np.testing.assert_allclose(line_through_point(point + along * a, a).m, line.m, atol=1e-11)
    assert line.a @ line.m == pytest.approx(0.0, abs=1e-11)


@laws
@given(T=poses, point=coordinates, a=directions)
def test_the_screw_matrix_moves_lines_as_poses_move_points(
    T: Array, point: Array, a: Array
) -> None:
    moved = transform_line(T, line_through_point(point, a))
    by_points = line_through_point(transform_points(T, point), T[:3, :3] @ a)
    np.testing.assert_allclose(moved.six_coordinates, by_points.six_coordinates, atol=1e-11)


@laws
@given(T_1=poses, T_2=poses)
def test_screw_matrices_compose_and_invert_like_poses(T_1: Array, T_2: Array) -> None:
    np.testing.assert_allclose(
        line_transform_matrix(T_1) @ line_transform_matrix(T_2),
        line_transform_matrix(T_1 @ T_2),
        atol=1e-11,
    )
    np.testing.assert_allclose(
        line_transform_matrix(inverse_pose(T_1)) @ line_transform_matrix(T_1), np.eye(6), atol=1e-11
    )


@laws
@given(point=coordinates, u=directions, seed=st.integers(0, 2**32 - 1), T=poses)
def test_a_line_in_a_plane_is_incident_in_every_frame(
    point: Array, u: Array, seed: int, T: Array
) -> None:
    plane = plane_through_point(point, u)
    a = np.cross(plane.u, np.random.default_rng(seed).standard_normal(3))
    line = line_through_point(point, a)
    np.testing.assert_allclose(incidence_residuals(line, plane), 0, atol=1e-11)
    moved = incidence_residuals(transform_line(T, line), transform_plane(T, plane))
    np.testing.assert_allclose(moved, 0, atol=1e-10)


@laws
@given(point=coordinates, u=directions, height=st.floats(-1, 1))
def test_a_parallel_line_shows_its_distance(point: Array, u: Array, height: float) -> None:
    plane = plane_through_point(point, u)
    a = np.linalg.svd(plane.u[None])[2][1]
    line = line_through_point(point + height * plane.u, a)
    np.testing.assert_allclose(incidence_residuals(line, plane)[1:], -height * a, atol=1e-11)


@laws
@given(T=poses)
def test_the_screw_matrix_is_the_adjoint_with_rotations_first(T: Array) -> None:
    swap = np.roll(np.eye(6), 3, axis=0)
    np.testing.assert_allclose(line_transform_matrix(T), swap @ adjoint(T) @ swap, atol=EXACT)


def test_many_lines_at_once_are_those_one_by_one() -> None:
    rng = np.random.default_rng(2)
    T = np.stack([pose_from_vector(v) for v in rng.uniform(-1, 1, (4, 6))])
    points, directions = rng.uniform(-1, 1, (2, 4, 3))
    plane = PluckerPlane(np.array((0.1, -0.4, 0.9)), 0.3)
    many = incidence_residuals(transform_line(T, line_through_point(points, directions)), plane)
    single = [
        incidence_residuals(transform_line(T_b_s, line_through_point(p, a)), plane)
        for T_b_s, p, a in zip(T, points, directions, strict=True)
    ]
    np.testing.assert_allclose(many, single, atol=EXACT)


def test_a_line_that_crosses_is_not_incident() -> None:
    crossing = incidence_residuals(
        line_through_point((0, 0, 0), (0, 0.6, 0.8)), PluckerPlane(np.array((0, 0, 1.0)), 0.0)
    )
    assert crossing[0] == pytest.approx(0.8)


def test_lines_and_planes_are_read_only() -> None:
    line = PluckerLine(np.array((1.0, 0, 0)), np.zeros(3))
    with pytest.raises(ValueError, match="read-only"):
        line.a[0] = 2
    with pytest.raises(ValueError, match="not zero"):
        PluckerPlane(np.zeros(3), 1.0)
