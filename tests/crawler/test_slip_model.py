"""Derivatives, symmetry, and what can be seen of slip."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.frames import Array
from tjscan.crawler.slip_model import (
    SETTLING,
    STATES,
    CrawlerGeometry,
    SlipState,
    TrackOdometry,
    laser_offset,
    propagate_state,
)

GEOMETRY = CrawlerGeometry(0.5, 0.1)

states = st.tuples(
    st.floats(-0.02, 0.02),
    st.floats(-0.1, 0.1),
    st.floats(-0.1, 0.1),
    st.floats(0.4, 1.0),
    st.floats(-0.02, 0.02),
    st.floats(-0.01, 0.01),
    st.floats(-0.2, 0.2),
    st.floats(-0.05, 0.05),
    st.floats(-0.01, 0.01),
    st.floats(-0.02, 0.02),
).map(np.array)
odometries = st.builds(
    TrackOdometry,
    st.sampled_from([-0.04, -0.005, 0.005, 0.02]),
    st.sampled_from([-5e-3, -1e-3, 1e-3, 4e-3]),
    st.floats(0.005, 0.05),
)
MIRROR = np.array([-1, -1, 1, 1, -1, -1, -1, -1, -1, -1])
"""A mirror image of vehicle, joint and slip: what is to the right comes to the left."""


def finite_differences(function: object, x: Array) -> Array:
    step = 1e-6
    columns = [
        (function(x + step * e) - function(x - step * e)) / (2 * step)  # type: ignore[operator]
        for e in np.eye(STATES)
    ]
    return np.array(columns).T


@given(states, odometries)
def test_the_derivative_of_a_step_is_that_of_finite_differences(
    x: Array, odometry: TrackOdometry
) -> None:
    drift = x[SlipState.DRIFT] + x[SlipState.UNSTEADY_DRIFT]
    turn = x[SlipState.YAW_EFFICIENCY] * odometry.turn_rate + drift * odometry.speed
    if abs(turn) < 1e-5:
        return  # |turn| has a corner there
    _, F = propagate_state(x, odometry, GEOMETRY)
    numeric = finite_differences(lambda y: propagate_state(y, odometry, GEOMETRY)[0], x)
    np.testing.assert_allclose(F, numeric, atol=1e-8)


@given(states)
def test_the_derivative_of_a_reading_is_that_of_finite_differences(x: Array) -> None:
    _, H = laser_offset(x, GEOMETRY)
    numeric = finite_differences(lambda y: np.array([laser_offset(y, GEOMETRY)[0]]), x)
    np.testing.assert_allclose(H, numeric[0], atol=1e-7)


@given(states, odometries)
def test_a_mirror_image_moves_as_a_mirror_image(x: Array, odometry: TrackOdometry) -> None:
    mirrored = TrackOdometry(odometry.speed, -odometry.turn_rate, odometry.period)
    after, _ = propagate_state(x, odometry, GEOMETRY)
    image, _ = propagate_state(MIRROR * x, mirrored, GEOMETRY)
    np.testing.assert_allclose(image, MIRROR * after, atol=1e-15)
    assert laser_offset(MIRROR * x, GEOMETRY)[0] == pytest.approx(-laser_offset(x, GEOMETRY)[0])


def observability(speeds: list[float]) -> Array:
    """Rows of how each reading depends on the state at first, shape (n, 10)."""
    x = np.zeros(STATES)
    x[SlipState.YAW_EFFICIENCY] = 0.8
    onward, rows = np.eye(STATES), []
    for speed in speeds:
        odometry = TrackOdometry(speed, 0.0, 1.0)
        rows.append(laser_offset(x, GEOMETRY)[1] @ onward)
        x, F = propagate_state(x, odometry, GEOMETRY)
        onward = F @ onward
    return np.array(rows)


def test_crab_shows_at_a_reversal_only() -> None:
    ways = [SlipState.OFFSET, SlipState.HEADING, SlipState.CRAB]
    forward, both = observability([0.02] * 30), observability([0.02] * 15 + [-0.02] * 15)
    ranks = [
        np.linalg.matrix_rank(rows[:, ways] * (1.0, 0.1, 0.1), tol=1e-9) for rows in (forward, both)
    ]
    assert ranks == [2, 3]


def test_what_is_unsteady_is_forgotten_over_the_settling_length() -> None:
    x = np.zeros(STATES)
    x[SlipState.UNSTEADY_CRAB] = 1e-3
    for _ in range(100):
        x, _ = propagate_state(x, TrackOdometry(-0.02, 0.0, SETTLING / 2), GEOMETRY)
    assert x[SlipState.UNSTEADY_CRAB] == pytest.approx(1e-3 * np.exp(-1))


def test_a_vehicle_on_a_circle_beside_a_joint_that_is_one_stays_beside_it() -> None:
    x = np.zeros(STATES)
    x[SlipState.YAW_EFFICIENCY], x[SlipState.CURVATURE] = 0.8, 1 / 20
    still = CrawlerGeometry(0.5, 0.0)
    turn = 0.02 / 20 / 0.8
    for _ in range(1000):
        x, _ = propagate_state(x, TrackOdometry(0.02, turn, 0.05), still)
    assert abs(x[SlipState.OFFSET]) < 1e-12
    # The laser, ahead on the tangent, is outside the arc by D² / 2 R.
    assert laser_offset(x, still)[0] == pytest.approx(-(0.5**2) / 40)
