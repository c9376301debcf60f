"""Derivatives, symmetry, and what can be seen of slip."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.frames import Array
from tjscan.crawler.slip_aware import OdometryFilter, SlipAwareMethod, SteeringSettings
from tjscan.crawler.slip_estimator import (
    RIPPLE_STATES,
    SETTLING_LENGTH,
    STATE_COUNT,
    CrawlerGeometry,
    SlipEstimate,
    SlipStateIndex,
    SlipUncertainty,
    TrackOdometry,
    laser_offset,
    propagate_state,
)
from tjscan.vehicle.pad_plant import PadPlant, PadSettings
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import Twist

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
    st.floats(-0.1, 0.1),
    st.floats(-0.05, 0.05),
    st.floats(-0.1, 0.1),
    *5 * [st.floats(-0.01, 0.01)],
    st.floats(-0.01, 0.01),
    st.floats(-3.0, 3.0),
    st.floats(0.0, 0.3),
    st.floats(-1e-4, 1e-4),
    st.floats(-0.01, 0.01),
    st.floats(-0.02, 0.02),
).map(np.array)
odometries = st.builds(
    TrackOdometry,
    st.sampled_from([-0.04, -0.005, 0.005, 0.02]),
    st.sampled_from([-5e-3, -1e-3, 1e-3, 4e-3]),
    st.floats(0.005, 0.05),
    st.floats(-0.5, 0.5),
    asked_turn_rate=st.none() | st.sampled_from([-2e-3, 3e-3]),
    turn_rate_parts=st.tuples(*5 * [st.floats(-0.05, 0.05)]),
)
MIRROR = np.array([-1, -1, 1, 1, -1, -1, -1, -1, 1, 1, *5 * [-1], 1, -1, -1, 1, -1, -1, -1])
"""A mirror image of vehicle, joint and slip: what is to the right comes to the left."""


def finite_differences(function: object, x: Array) -> Array:
    step = 1e-6
    columns = [
        (function(x + step * e) - function(x - step * e)) / (2 * step)  # type: ignore[operator]
        for e in np.eye(STATE_COUNT)
    ]
    return np.array(columns).T


@given(states, odometries)
def test_the_derivative_of_a_step_is_that_of_finite_differences(
    x: Array, odometry: TrackOdometry
) -> None:
    drift = x[SlipStateIndex.DRIFT] + x[SlipStateIndex.UNSTEADY_DRIFT]
    mean = odometry.asked_turn_rate or odometry.turn_rate
    tracks = mean + x[RIPPLE_STATES] @ odometry.turn_rate_parts[:4]
    turn = x[SlipStateIndex.YAW_EFFICIENCY] * tracks + drift * odometry.speed
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
    parts = (*odometry.turn_rate_parts[:4], -odometry.turn_rate_parts[4])
    mirrored = replace(
        odometry,
        turn_rate=-odometry.turn_rate,
        recent_turn=-odometry.recent_turn,
        asked_turn_rate=-(odometry.asked_turn_rate or odometry.turn_rate),
        turn_rate_parts=parts,
    )
    after, _ = propagate_state(x, odometry, GEOMETRY)
    image, _ = propagate_state(MIRROR * x, mirrored, GEOMETRY)
    np.testing.assert_allclose(image, MIRROR * after, atol=1e-15)
    assert laser_offset(MIRROR * x, GEOMETRY)[0] == pytest.approx(-laser_offset(x, GEOMETRY)[0])


def observability(speeds: list[float]) -> Array:
    """Rows of how each reading depends on the state at first, shape (n, 22)."""
    x = np.zeros(STATE_COUNT)
    x[SlipStateIndex.YAW_EFFICIENCY] = 0.8
    onward, rows = np.eye(STATE_COUNT), []
    for speed in speeds:
        odometry = TrackOdometry(speed, 0.0, 1.0)
        rows.append(laser_offset(x, GEOMETRY)[1] @ onward)
        x, F = propagate_state(x, odometry, GEOMETRY)
        onward = F @ onward
    return np.array(rows)


@pytest.mark.parametrize("speed", [8e-3, 40e-3])
def test_the_encoders_noise_is_no_turn_that_carries_the_vehicle_aside(speed: float) -> None:
    rng, tracks, x = np.random.default_rng(2), OdometryFilter(), np.zeros(STATE_COUNT)
    x[SlipStateIndex.YAW_EFFICIENCY], x[SlipStateIndex.TURNING_CRAB] = 0.7, 0.1
    count, way, sideways = 1.6e-6, np.zeros(2), 0.0
    for _ in range(3000):
        counted, way = np.floor(way / count), way + speed * 0.02 * (1 + 1e-4 * rng.random(2))
        left, right = (np.floor(way / count) - counted) * count / 0.02
        shown = Twist((left + right) / 2, (left - right) / 0.4)
        level = x.copy()
        after, _ = propagate_state(level, tracks.smooth(shown, 0.02, Twist(speed, 0.0)), GEOMETRY)
        turned = after[SlipStateIndex.HEADING] * GEOMETRY.centre_to_torch
        sideways += after[SlipStateIndex.OFFSET] + turned
    assert abs(sideways) < 0.06e-3 * 3000 * speed * 0.02  # of 0.1 mrad and more by single periods


def test_crab_shows_at_a_reversal_only() -> None:
    ways = [SlipStateIndex.OFFSET, SlipStateIndex.HEADING, SlipStateIndex.CRAB]
    forward, both = observability([0.02] * 30), observability([0.02] * 15 + [-0.02] * 15)
    ranks = [
        np.linalg.matrix_rank(rows[:, ways] * (1.0, 0.1, 0.1), tol=1e-9) for rows in (forward, both)
    ]
    assert ranks == [2, 3]


def test_what_is_unsteady_is_forgotten_over_the_settling_length() -> None:
    x = np.zeros(STATE_COUNT)
    x[SlipStateIndex.UNSTEADY_CRAB] = 1e-3
    for _ in range(100):
        x, _ = propagate_state(x, TrackOdometry(-0.02, 0.0, SETTLING_LENGTH / 2), GEOMETRY)
    assert x[SlipStateIndex.UNSTEADY_CRAB] == pytest.approx(1e-3 * np.exp(-1))


def test_a_vehicle_on_a_circle_beside_a_joint_that_is_one_stays_beside_it() -> None:
    x = np.zeros(STATE_COUNT)
    x[SlipStateIndex.YAW_EFFICIENCY], x[SlipStateIndex.CURVATURE] = 0.8, 1 / 20
    still = CrawlerGeometry(0.5, 0.0)
    turn = 0.02 / 20 / 0.8
    for _ in range(1000):
        x, _ = propagate_state(x, TrackOdometry(0.02, turn, 0.05), still)
    assert abs(x[SlipStateIndex.OFFSET]) < 1e-12
    # The laser, ahead on the tangent, is outside the arc by D² / 2 R.
    assert laser_offset(x, still)[0] == pytest.approx(-(0.5**2) / 40)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_centre_of_rotation_comes_ahead_as_the_contact_fills(way: float) -> None:
    x = np.zeros(STATE_COUNT)
    x[SlipStateIndex.YAW_EFFICIENCY], x[SlipStateIndex.SETTLED_CENTRE] = 0.5, 0.1
    tracks, speed, turn = OdometryFilter(), 0.02 * way, 2e-5
    sideways = []
    for _ in range(3000):
        odometry = tracks.smooth(Twist(speed, turn), 0.01, Twist(speed, turn))
        level = x.copy()
        level[[SlipStateIndex.OFFSET, SlipStateIndex.HEADING]] = 0.0
        x, _ = propagate_state(level, odometry, CrawlerGeometry(0.5, 0.0))
        sideways.append(x[SlipStateIndex.OFFSET] / (0.02 * 0.01))
    settled = -way * 0.1 * 0.5 * turn / 0.02
    assert abs(sideways[50]) < 0.1 * abs(settled)
    assert sideways[-1] == pytest.approx(settled, rel=0.02)


def centre_ahead_on_pads(curvature: float) -> tuple[float, float]:
    """Where the centre of rotation lies in a turn by the tracks: at its start, and later, m."""
    plant = PadPlant(PadSettings(mass=0.0), TrackGeometry(), np.zeros(3))
    step, moves = 0.7 / 24 / 3, []  # a third of the way from pad to pad
    for k in range(140):  # straight until no foot remembers the start
        half = 0.2 * curvature * step if k >= 80 else 0.0
        before = plant.pose_w
        plant.advance(step + half, step - half, 1.0)
        forward, right, turn = plant.pose_w - before
        moves.append((right - forward * (before[2] + turn / 2), turn))
    first, late = np.sum(moves[80:86], axis=0), np.sum(moves[110:], axis=0)
    return -first[0] / first[1], -late[0] / late[1]


def test_so_it_does_on_pads_the_less_the_more_feet_slide() -> None:
    first, gentle = centre_ahead_on_pads(0.04)
    assert first < 0.3 * gentle
    assert 0.7 / 6 - 0.04 < gentle < 0.7 / 6 + 0.04  # a sixth of the contact where feet stick
    assert centre_ahead_on_pads(0.3)[1] < 0.5 * gentle


def test_ripple_about_a_contact_that_goes_to_and_fro_is_a_crab() -> None:
    """`SlipAwareMethod` states what this comes to over all ways in which the chains may lie."""
    pitch, gauge, efficiency, ripple = TrackGeometry().pad_pitch, 0.4, 0.6, 0.02
    way = np.linspace(0.0, 10 * pitch, 2000, endpoint=False)
    centre = pitch * (0.5 - way / pitch % 1.0)
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, (1000, 2, 1))
    left, right = ripple * np.cos(2 * np.pi * way / pitch + phases).transpose(1, 0, 2)
    crab = -(efficiency * (left - right) / gauge * centre).mean(axis=1)
    x = SlipEstimate.before_any_reading(SlipUncertainty()).x.copy()
    x[SlipStateIndex.YAW_EFFICIENCY] = efficiency
    x[[SlipStateIndex.LEFT_RIPPLE_SINE, SlipStateIndex.RIGHT_RIPPLE_COSINE]] = ripple
    sure = SlipEstimate(x, np.zeros((len(x), len(x))))
    geometry = CrawlerGeometry(0.5, 0.0)
    known = SlipAwareMethod(geometry, sure, SlipUncertainty(), SteeringSettings()).torch.sigma
    assert known == pytest.approx(0.5 * crab.std(), rel=0.05)
