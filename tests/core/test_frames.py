"""Laws of poses and of read-only arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from tjscan.core.frames import (
    Array,
    cross,
    frozen_arrays,
    inverse_pose,
    pose,
    pose_from_euler_zyx,
    pose_from_rounded_matrix,
    pose_to_euler_zyx,
    readonly_copy,
    rot_x,
    rot_y,
    rot_z,
    rotation_angle_between,
    skew_matrix,
    transform_points,
)

EXACT = 1e-12
"""A few roundings of numbers of order one."""

Mask = NDArray[np.bool_]

vectors = arrays(np.float64, 3, elements=st.floats(-3, 3))


@given(vectors, vectors, vectors)
def test_inner_letters_cancel(p: Array, angles: Array, point: Array) -> None:
    T_b_s = pose_from_euler_zyx(p, angles)
    np.testing.assert_allclose(inverse_pose(T_b_s) @ T_b_s, np.eye(4), atol=EXACT)
    np.testing.assert_allclose(
        transform_points(inverse_pose(T_b_s), transform_points(T_b_s, point)), point, atol=EXACT
    )


@given(vectors, vectors, vectors, vectors)
def test_composition_maps_points_one_after_the_other(
    p_1: Array, angles_1: Array, p_2: Array, angles_2: Array
) -> None:
    T_b_f, T_f_s = pose_from_euler_zyx(p_1, angles_1), pose_from_euler_zyx(p_2, angles_2)
    p_s = np.array([0.1, -0.2, 0.3])
    np.testing.assert_allclose(
        transform_points(T_b_f @ T_f_s, p_s),
        transform_points(T_b_f, transform_points(T_f_s, p_s)),
        atol=EXACT,
    )


def test_euler_angles_turn_about_z_then_y_then_x() -> None:
    a, b, c = 0.3, -0.5, 1.1
    T = pose_from_euler_zyx((1, 2, 3), (a, b, c))
    np.testing.assert_allclose(T[:3, :3], rot_z(a) @ rot_y(b) @ rot_x(c), atol=EXACT)
    position, angles = pose_to_euler_zyx(T)
    np.testing.assert_allclose(position, (1, 2, 3))
    np.testing.assert_allclose(angles, (a, b, c), atol=EXACT)


def test_rotation_angle_is_the_angle_between_orientations() -> None:
    assert rotation_angle_between(rot_x(0.2), rot_x(0.9)) == pytest.approx(0.7)


def test_a_pose_printed_with_four_decimals_becomes_a_rotation() -> None:
    T = pose_from_euler_zyx((0.1, 0.2, 0.3), (0.01, 0.02, -0.03))
    near = pose_from_rounded_matrix(np.round(T, 4))
    np.testing.assert_allclose(near[:3, :3] @ near[:3, :3].T, np.eye(3), atol=EXACT)
    np.testing.assert_allclose(near, T, atol=1e-4)


@pytest.mark.parametrize(
    ("matrix", "complaint"),
    [
        (np.eye(3), "4 x 4"),
        (2 * np.eye(4) - pose(), "not orthonormal"),
        (np.diag((1.0, 1.0, -1.0, 1.0)), "left-handed"),
        (pose(np.full((3, 3), np.nan)), "not orthonormal"),
    ],
)
def test_what_is_no_pose_is_refused(matrix: Array, complaint: str) -> None:
    with pytest.raises(ValueError, match=r"pose|rotation") as caught:
        pose_from_rounded_matrix(
            matrix if complaint != "not orthonormal" else 1.01 * matrix + np.diag((0, 0, 0, -0.01))
        )
    assert complaint in str(caught.value)


def test_readonly_arrays_refuse_writing_and_leave_the_original_alone() -> None:
    original = np.zeros(3)
    copy = readonly_copy(original)
    with pytest.raises(ValueError, match="read-only"):
        copy[0] = 1
    original[0] = 1
    assert copy[0] == 0


def test_cross_products_are_those_of_numpy() -> None:
    a, b = np.random.default_rng(3).standard_normal((2, 4, 5, 3))
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=1e-15)
    np.testing.assert_allclose(cross(a[0, 0], b[0, 0]), np.cross(a[0, 0], b[0, 0]), atol=1e-15)


@given(vectors, vectors)
def test_the_skew_matrix_is_the_cross_product(v: Array, w: Array) -> None:
    np.testing.assert_allclose(skew_matrix(v) @ w, np.cross(v, w), atol=EXACT)
    np.testing.assert_array_equal(skew_matrix(np.stack((v, w)))[1], skew_matrix(w))


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class Points:
    points: Array
    used: Mask
    sigma: Array | None = None

    def __post_init__(self) -> None:
        if self.points.ndim != 2:
            raise ValueError("no rows of points")


def test_a_frozen_dataclass_holds_read_only_copies_of_its_arrays() -> None:
    original = np.zeros((2, 3))
    used = np.ones(2, dtype=bool)
    held = Points(original, used)
    original[0] = 1
    used[0] = False
    assert not held.points.any()
    assert held.used.all()
    assert held.sigma is None
    for array in (held.points, held.used):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_a_frozen_dataclass_takes_lists_and_checks_what_it_made_of_them() -> None:
    assert Points([[0, 1, 2]], [1]).points.dtype == np.float64  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="rows"):
        Points([0, 1, 2], [1])  # type: ignore[arg-type]
