"""Frame t lays the sensor where the paper wants it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.frames import inverse_pose, pose, rot_y, transform_points
from tjscan.scanning.target import ScanDirection, target_pose_in_sensor

EXACT = 1e-12
angles = st.floats(-1.2, 1.2)

P_S_T = (0.0, 0.0, 0.24)
T_B_G = pose()  # the groove as base frame: x counterclockwise, y up the brace, z out of the joint


def sensor_on_groove(beta: float, alpha: float, direction: ScanDirection) -> np.ndarray:
    """T_b_s when frame t lies on the groove, turned round for the clockwise scan."""
    T_b_t = T_B_G if direction is ScanDirection.COUNTERCLOCKWISE else T_B_G @ pose(rot_y(np.pi))
    return T_b_t @ inverse_pose(target_pose_in_sensor(beta, alpha, P_S_T, direction))


@pytest.mark.parametrize("direction", ScanDirection)
@given(beta=angles, alpha=angles)
def test_the_central_ray_hits_the_groove_from_outside_at_the_standoff(
    direction: ScanDirection, beta: float, alpha: float
) -> None:
    T_b_s = sensor_on_groove(beta, alpha, direction)
    np.testing.assert_allclose(transform_points(T_b_s, (0, 0, 0.24)), np.zeros(3), atol=EXACT)
    assert T_b_s[2, 3] > 0  # outside the joint


@pytest.mark.parametrize("direction", ScanDirection)
def test_the_work_angle_raises_the_sensor(direction: ScanDirection) -> None:
    beta = 0.4
    origin = sensor_on_groove(beta, 0.0, direction)[:3, 3]
    np.testing.assert_allclose(origin, 0.24 * np.array((0, np.sin(beta), np.cos(beta))), atol=EXACT)


@pytest.mark.parametrize("direction", ScanDirection)
def test_the_sensor_leads_and_looks_back(direction: ScanDirection) -> None:
    origin = sensor_on_groove(0.0, 0.2, direction)[:3, 3]
    forward = 1 if direction is ScanDirection.COUNTERCLOCKWISE else -1
    np.testing.assert_allclose(
        origin, 0.24 * np.array((forward * np.sin(0.2), 0, np.cos(0.2))), atol=EXACT
    )


@pytest.mark.parametrize("direction", ScanDirection)
def test_x_of_the_sensor_points_up_the_brace(direction: ScanDirection) -> None:
    np.testing.assert_allclose(sensor_on_groove(0.0, 0.0, direction)[:3, 0], (0, 1, 0), atol=EXACT)


def test_the_large_rotation_is_rz_90_rx_180() -> None:
    T_s_t = target_pose_in_sensor(0.0, 0.0, P_S_T, ScanDirection.COUNTERCLOCKWISE)
    np.testing.assert_allclose(T_s_t[:3, :3], [[0, 1, 0], [1, 0, 0], [0, 0, -1]], atol=EXACT)
