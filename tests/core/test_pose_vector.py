"""Laws of exp, log and steps: the group's axioms, and derivatives by finite differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tjscan.core.frames import (
    Array,
    inverse_pose,
    pose,
    rot_x,
    rot_z,
    rotation_angle_between,
    transform_points,
)
from tjscan.core.pose_vector import (
    adjoint,
    boxminus,
    boxplus,
    left_jacobian,
    pose_from_vector,
    pose_to_vector,
    rotation_from_vector,
    rotation_to_vector,
)

EXACT = 1e-9
"""Rotation vectors lose half of the digits' surplus next to half a turn, and no more."""

STEP = 1e-6
LINEAR = 1e-8
"""Central differences over `STEP`: rounding over the step, and the step squared."""

vectors = arrays(np.float64, 3, elements=st.floats(-1.7, 1.7))  # turns of less than half a turn
six = arrays(np.float64, 6, elements=st.floats(-1.7, 1.7))
laws = settings(deadline=None, max_examples=50)


@laws
@given(vectors)
def test_so3_exp_makes_rotations_and_log_undoes_it(w: Array) -> None:
    R = rotation_from_vector(w)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=EXACT)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation_to_vector(R), w, atol=EXACT)
    assert rotation_angle_between(np.eye(3), R) == pytest.approx(np.linalg.norm(w), abs=EXACT)


def test_known_rotations() -> None:
    np.testing.assert_allclose(rotation_from_vector((0.3, 0, 0)), rot_x(0.3), atol=EXACT)
    np.testing.assert_allclose(rotation_to_vector(rot_z(-2.0)), (0, 0, -2.0), atol=EXACT)
    np.testing.assert_array_equal(pose_from_vector(np.zeros(6)), np.eye(4))
    np.testing.assert_array_equal(pose_to_vector(np.eye(4)), np.zeros(6))


@laws
@given(vectors, st.floats(-1, 1), st.floats(-1, 1))
def test_turns_about_one_axis_add_up(w: Array, s: float, t: float) -> None:
    np.testing.assert_allclose(
        rotation_from_vector(s * w) @ rotation_from_vector(t * w),
        rotation_from_vector((s + t) * w),
        atol=EXACT,
    )


def test_many_rotations_at_once_are_those_one_by_one() -> None:
    w = np.random.default_rng(1).uniform(-1, 1, (5, 3))
    np.testing.assert_array_equal(rotation_from_vector(w), [rotation_from_vector(one) for one in w])
    np.testing.assert_array_equal(
        rotation_to_vector(rotation_from_vector(w)),
        [rotation_to_vector(rotation_from_vector(one)) for one in w],
    )


@laws
@given(six)
def test_log_undoes_exp(v: Array) -> None:
    T = pose_from_vector(v)
    np.testing.assert_array_equal(T[:3, 3], v[:3])
    np.testing.assert_allclose(pose_to_vector(T), v, atol=EXACT)


@laws
@given(six, six)
def test_boxminus_is_the_step_that_boxplus_makes(a: Array, b: Array) -> None:
    T_1, T_2 = pose_from_vector(a), pose_from_vector(b)
    np.testing.assert_allclose(boxplus(T_1, boxminus(T_2, T_1)), T_2, atol=EXACT)
    np.testing.assert_array_equal(boxplus(T_1, np.zeros(6)), T_1)
    np.testing.assert_allclose(boxminus(T_1, T_1), np.zeros(6), atol=EXACT)


@laws
@given(six, six)
def test_boxminus_undoes_boxplus(a: Array, step: Array) -> None:
    T = pose_from_vector(a)
    np.testing.assert_allclose(boxminus(boxplus(T, step), T), step, atol=EXACT)


@laws
@given(six, six)
def test_a_step_is_in_the_axes_of_the_outer_frame(a: Array, step: Array) -> None:
    T = pose_from_vector(a)
    about_its_origin = (
        pose(p=T[:3, 3] + step[:3]) @ pose_from_vector((0, 0, 0, *step[3:])) @ pose(p=-T[:3, 3])
    )
    np.testing.assert_allclose(boxplus(T, step), about_its_origin @ T, atol=EXACT)


@laws
@given(vectors)
def test_the_left_jacobian_is_the_derivative_of_exp(w: Array) -> None:
    R = rotation_from_vector(w)
    columns = [
        (
            rotation_to_vector(rotation_from_vector(w + dw) @ R.T)
            - rotation_to_vector(rotation_from_vector(w - dw) @ R.T)
        )
        / (2 * STEP)
        for dw in STEP * np.eye(3)
    ]
    np.testing.assert_allclose(left_jacobian(w), np.column_stack(columns), atol=LINEAR)


@laws
@given(six)
def test_the_adjoint_carries_small_motions_to_the_outer_frame(a: Array) -> None:
    T = pose_from_vector(a)
    columns = [
        (
            pose_to_vector(T @ pose_from_vector(v) @ inverse_pose(T))
            - pose_to_vector(T @ pose_from_vector(-v) @ inverse_pose(T))
        )
        / (2 * STEP)
        for v in STEP * np.eye(6)
    ]
    np.testing.assert_allclose(adjoint(T), np.column_stack(columns), atol=LINEAR)


@laws
@given(six, six)
def test_adjoints_multiply_as_poses_do(a: Array, b: Array) -> None:
    np.testing.assert_allclose(
        adjoint(pose_from_vector(a) @ pose_from_vector(b)),
        adjoint(pose_from_vector(a)) @ adjoint(pose_from_vector(b)),
        atol=EXACT,
    )
    np.testing.assert_allclose(
        adjoint(inverse_pose(pose_from_vector(a))) @ adjoint(pose_from_vector(a)),
        np.eye(6),
        atol=EXACT,
    )


@laws
@given(six, vectors)
def test_exp_turns_first_and_shifts_then(v: Array, point: Array) -> None:
    np.testing.assert_allclose(
        transform_points(pose_from_vector(v), point),
        rotation_from_vector(v[3:]) @ point + v[:3],
        atol=EXACT,
    )
