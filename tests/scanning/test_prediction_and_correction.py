"""Laws of the two substeps, on a groove that is a perfect ring."""

import numpy as np
import pytest

from tjscan.core.frames import (
    Array,
    inverse_pose,
    pose,
    rot_x,
    rot_y,
    rot_z,
    rotation_angle_between,
    transform_points,
)
from tjscan.scanning.target import (
    PREDICTION_CASES,
    ScanDirection,
    correction_target_pose,
    predicted_target_pose,
)

EXACT = 1e-12
RADIUS = 0.2286
REVERSED = pose(rot_y(np.pi))


def groove(azimuth: float) -> Array:
    """Frame g on a ring: x counterclockwise, y up, z out."""
    return pose(
        rot_z(azimuth) @ np.array(((0, 0, 1), (1, 0, 0), (0, 1, 0))), RADIUS * rot_z(azimuth)[:, 0]
    )


def chord(angle: float) -> float:
    return float(2 * RADIUS * np.sin(angle / 2))


def predict_on_ring(case: int, direction: ScanDirection, angle: float = 0.2) -> tuple[Array, Array]:
    """Predicted and true frame t after two sections that lie `angle` apart."""
    sign = 1 if direction is ScanDirection.COUNTERCLOCKWISE else -1
    g_before, g_last, g_next = (groove(sign * i * angle) for i in (0, 1, 2))
    turn = np.eye(4) if sign > 0 else REVERSED
    predicted = predicted_target_pose(
        g_last @ turn, g_before, g_last, chord(angle), PREDICTION_CASES[case], direction
    )
    return predicted, g_next @ turn


@pytest.mark.parametrize("direction", ScanDirection)
def test_case_2_is_exact_on_a_ring(direction: ScanDirection) -> None:
    predicted, true = predict_on_ring(2, direction)
    np.testing.assert_allclose(predicted, true, atol=EXACT)


@pytest.mark.parametrize("direction", ScanDirection)
@pytest.mark.parametrize(("case", "turns"), [(1, False), (2, True), (3, False), (4, True)])
def test_cases_2_and_4_turn_the_sensor(direction: ScanDirection, case: int, turns: bool) -> None:
    predicted, true = predict_on_ring(case, direction)
    error = rotation_angle_between(predicted, true)
    assert error == pytest.approx(0.0 if turns else 0.2, abs=1e-7)


@pytest.mark.parametrize("direction", ScanDirection)
@pytest.mark.parametrize(("case", "exact"), [(1, False), (2, True), (3, True), (4, False)])
def test_cases_2_and_3_turn_the_step(direction: ScanDirection, case: int, exact: bool) -> None:
    predicted, true = predict_on_ring(case, direction)
    error = np.linalg.norm(predicted[:3, 3] - true[:3, 3])
    assert error == pytest.approx(0.0 if exact else chord(0.2) * 2 * np.sin(0.1), abs=EXACT)


@pytest.mark.parametrize("case", PREDICTION_CASES)
@pytest.mark.parametrize("direction", ScanDirection)
def test_the_step_has_the_length_asked_for(case: int, direction: ScanDirection) -> None:
    sign = 1 if direction is ScanDirection.COUNTERCLOCKWISE else -1
    T_b_t = groove(sign * 0.2)
    predicted = predicted_target_pose(
        T_b_t, groove(0.0), T_b_t, 0.055, PREDICTION_CASES[case], direction
    )
    assert np.linalg.norm(predicted[:3, 3] - T_b_t[:3, 3]) == pytest.approx(0.055)


@pytest.mark.parametrize("case", PREDICTION_CASES)
def test_prediction_does_not_depend_on_where_the_base_stands(case: int) -> None:
    T_a_b = pose(rot_x(0.3) @ rot_z(2.0), (1.0, -2.0, 0.5))
    args = (0.04, PREDICTION_CASES[case], ScanDirection.COUNTERCLOCKWISE)
    before, last = groove(0.0), groove(0.2)
    in_b = predicted_target_pose(last, before, last, *args)
    in_a = predicted_target_pose(T_a_b @ last, T_a_b @ before, T_a_b @ last, *args)
    np.testing.assert_allclose(in_a, T_a_b @ in_b, atol=EXACT)


@pytest.mark.parametrize("sign", [1, -1])
def test_correction_lays_t_in_the_groove_with_x_along_the_motion_and_y_up(sign: int) -> None:
    tilted = groove(sign * 0.2) @ pose(rot_x(0.1) @ rot_y(-0.05) @ rot_z(0.2))
    T_b_t = correction_target_pose(groove(0.0), tilted)
    np.testing.assert_allclose(T_b_t[:3, :3] @ T_b_t[:3, :3].T, np.eye(3), atol=EXACT)
    np.testing.assert_allclose(T_b_t[:3, 3], tilted[:3, 3], atol=EXACT)
    last_in_t = transform_points(inverse_pose(T_b_t), groove(0.0)[:3, 3])
    np.testing.assert_allclose(last_in_t, (-chord(0.2), 0, 0), atol=EXACT)
    assert T_b_t[:3, 1] @ tilted[:3, 1] > 0.9
    assert sign * T_b_t[:3, 2] @ tilted[:3, 2] > 0.9  # out of the joint, or into it clockwise


def test_correction_is_at_rest_on_a_straight_groove() -> None:
    here = pose(p=(0.04, 0.0, 0.0))
    np.testing.assert_allclose(correction_target_pose(pose(), here), here, atol=EXACT)
