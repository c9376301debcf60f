"""What the estimator believes holds against worlds drawn from its own model."""

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.crawler.slip_aware import OdometryFilter
from tjscan.crawler.slip_estimator import (
    SETTLING_LENGTH,
    STATE_COUNT,
    UNEVEN_LENGTH,
    CrawlerGeometry,
    SlipEstimate,
    SlipEstimator,
    SlipStateIndex,
    SlipUncertainty,
    TrackOdometry,
    laser_offset,
    propagate_state,
)
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import Twist

GEOMETRY = CrawlerGeometry(0.5, 0.0)
UNSURE = SlipUncertainty()
TRACKS = TrackGeometry()
GYRO_BIAS = 0.7e-3
SIGMA = 0.015e-3
PERIOD = 0.05
TURN_RATE_SIGMA = 2e-4
"""rad/s: of the noise of the tracks' turn rate, new in each period, as their encoders show it."""


UNSTEADY = [SlipStateIndex.UNSTEADY_CRAB, SlipStateIndex.UNSTEADY_DRIFT]


def unsteady(turns: float) -> Array:
    """Standard deviations of unsteady crab and drift where a track turns with a curvature, 1/m."""
    straight = np.array((UNSURE.unsteady_crab, UNSURE.unsteady_drift))
    turning = np.array((UNSURE.unsteady_centre, UNSURE.unsteady_efficiency))
    return np.asarray(np.hypot(straight, turning * turns))


def crawl(seed: int, changes: float = 1.0) -> tuple[float, float]:
    """Mean normalised error squared over its dimension, and unsteadiness, of one way out and back.

    Slip changes by `changes` times the standard deviations that the estimator is told.
    """
    rng = np.random.default_rng(seed)
    first = SlipEstimate.before_any_reading(UNSURE, curvature_sigma=1e-4)
    truth = rng.multivariate_normal(first.x, first.P)
    estimator = SlipEstimator(GEOMETRY, first, UNSURE)
    walks = np.zeros(STATE_COUNT)
    walks[[2, 3, 4, 5, 8]] = (
        UNSURE.rotation_centre_walk,
        UNSURE.yaw_efficiency_walk,
        UNSURE.drift_walk,
        UNSURE.crab_walk,
        UNSURE.settled_centre_walk,
    )
    found, turns, recent = [], 0.0, 0.0
    for k in range(1200):
        speed = 0.02 if k < 600 else -0.02
        asked = 2e-3 * np.sin(2 * np.pi * k / 300)
        noise = TURN_RATE_SIGMA * rng.standard_normal()
        kept = np.exp(-abs(speed) * PERIOD / SETTLING_LENGTH)
        recent = kept * (0.0 if k == 600 else recent) + (1 - kept) * asked / abs(speed)
        truly = TrackOdometry(speed, asked - noise, PERIOD, recent)
        truth, _ = propagate_state(truth, truly, GEOMETRY)
        truth = truth + walks * np.sqrt(abs(speed) * PERIOD) * changes * rng.standard_normal(
            STATE_COUNT
        )
        turns = kept * turns + (1 - kept) * truth[SlipStateIndex.YAW_EFFICIENCY] * asked / speed
        truth[UNSTEADY] += np.sqrt(1 - kept**2) * unsteady(turns) * changes * rng.standard_normal(2)
        estimator.move(
            TrackOdometry(speed, asked, PERIOD, recent, turn_rate_variance=TURN_RATE_SIGMA**2)
        )
        evenly = np.exp(-abs(speed) * PERIOD / UNEVEN_LENGTH)
        truth[SlipStateIndex.UNEVENNESS] += (
            np.sqrt(1 - evenly**2) * UNSURE.unevenness * rng.standard_normal()
        )
        estimator.read(laser_offset(truth, GEOMETRY)[0] + SIGMA * rng.standard_normal(), SIGMA)
        if k % 40 == 39:
            error = estimator.estimate.x - truth
            found.append(error @ np.linalg.solve(estimator.estimate.P, error) / STATE_COUNT)
    return float(np.mean(found)), estimator.unsteadiness


def test_stated_covariances_are_those_of_the_errors() -> None:
    # The median: where drift and turning crab are both far out, the filter does not know the sign
    # of a turn at first, and no linear filter knows that it does not (one draw of twenty).
    assert 0.7 < np.median([crawl(seed)[0] for seed in range(20)]) < 1.5


@pytest.mark.parametrize(("changes", "low", "high"), [(0.0, 0.0, 0.7), (2.0, 0.7, 1.0)])
def test_it_learns_how_unsteady_slip_is(changes: float, low: float, high: float) -> None:
    learned = np.median([crawl(seed, changes)[1] for seed in range(5)])
    assert low <= learned <= high


def test_a_reversal_shows_the_crab() -> None:
    truth = SlipEstimate.before_any_reading(UNSURE).x.copy()
    truth[SlipStateIndex.CRAB] = 5e-3
    first = SlipEstimate.before_any_reading(UNSURE)
    estimator = SlipEstimator(GEOMETRY, first, UNSURE)
    sigmas = []
    for speed in (0.02, -0.02):
        for _ in range(600):
            truth, _ = propagate_state(truth, TrackOdometry(speed, 0.0, PERIOD), GEOMETRY)
            estimator.move(TrackOdometry(speed, 0.0, PERIOD))
            estimator.read(laser_offset(truth, GEOMETRY)[0], SIGMA)
        sigmas.append(estimator.estimate.sigma(SlipStateIndex.CRAB))
    assert sigmas[0] > 0.7 * UNSURE.crab
    assert sigmas[1] < 0.2 * UNSURE.crab
    assert estimator.estimate.x[SlipStateIndex.CRAB] == pytest.approx(5e-3, abs=3 * sigmas[1])


def misfit_of_reading(estimator: SlipEstimator, d: float) -> float:
    """How far off a reading is, squared, in the variance of what was expected."""
    return (estimator.read(d, SIGMA)[0] / float(np.hypot(SIGMA, UNSURE.unevenness))) ** 2


@pytest.mark.parametrize("sigma", [10e-6, 1e-3])
def test_how_far_readings_went_aside_does_not_depend_on_what_was_made_of_them(sigma: float) -> None:
    first = SlipEstimate.before_any_reading(UNSURE)
    estimator, rng = SlipEstimator(GEOMETRY, first, UNSURE), np.random.default_rng(1)
    course = np.where(np.arange(60) < 30, 0.0, 0.4e-3) + 20e-6 * rng.standard_normal(60)
    shown = []
    for d in course:
        estimator.move(TrackOdometry(0.02, 0.0, PERIOD))
        shown.append(estimator.read(float(d), sigma)[1])
    assert np.diff(shown) == pytest.approx(np.diff(course), abs=30e-6)


def test_an_outlier_moves_it_little() -> None:
    estimator = SlipEstimator(GEOMETRY, SlipEstimate.before_any_reading(UNSURE), UNSURE)
    for _ in range(200):
        estimator.move(TrackOdometry(0.02, 0.0, PERIOD))
        estimator.read(0.0, SIGMA)
    before = (
        estimator.estimate.x[SlipStateIndex.OFFSET]
        + 0.5 * estimator.estimate.x[SlipStateIndex.HEADING]
    )
    assert misfit_of_reading(estimator, 5e-3) > 1e3
    after = (
        estimator.estimate.x[SlipStateIndex.OFFSET]
        + 0.5 * estimator.estimate.x[SlipStateIndex.HEADING]
    )
    assert abs(after - before) < 0.05e-3


def test_how_it_slips_is_kept_where_it_is_is_not() -> None:
    """Nor in which direction the joint runs there, nor how the chains lie on their sprockets."""
    known = SlipEstimate(np.arange(STATE_COUNT) / 10, np.diag(np.arange(1.0, STATE_COUNT + 1)))
    moved, new = known.at_new_start(UNSURE), SlipEstimate.before_any_reading(UNSURE)
    place = {"OFFSET", "HEADING", "JOINT_DOWN", "UNEVENNESS"}
    left = [one for one in SlipStateIndex if one.name in place or "RIPPLE" in one.name]
    kept = [one for one in SlipStateIndex if one not in left]
    np.testing.assert_array_equal(moved.x[kept], known.x[kept])
    np.testing.assert_array_equal(moved.P[np.ix_(kept, kept)], known.P[np.ix_(kept, kept)])
    assert (moved.x[left] == 0).all()
    np.testing.assert_array_equal(moved.P[np.ix_(left, left)], new.P[np.ix_(left, left)])
    assert moved.sigma(SlipStateIndex.OFFSET) == pytest.approx(UNSURE.offset)


@pytest.mark.parametrize("turn", [-1, 0, 1])
def test_a_way_that_nobody_saw_does_not_contradict_what_was_known(turn: int) -> None:
    way, radius, slope = 0.02, 8.0, 0.02
    estimator = SlipEstimator(GEOMETRY, SlipEstimate.before_any_reading(UNSURE), UNSURE)
    for _ in range(400):
        estimator.move(TrackOdometry(0.02, 0.0, PERIOD))
        estimator.read(0.0, SIGMA)
    sure = estimator.estimate
    d = slope * way + GEOMETRY.laser_to_torch * turn * way / radius
    assert misfit_of_reading(SlipEstimator(GEOMETRY, sure, UNSURE), d) > 100
    doubts = sure.with_unseen_travel(way, radius)
    assert misfit_of_reading(SlipEstimator(GEOMETRY, doubts, UNSURE), d) < 4
    same = sure.with_unseen_travel(0.0, radius)
    assert misfit_of_reading(SlipEstimator(GEOMETRY, same, UNSURE), d) > 100


def test_a_reversal_leaves_what_slip_is_off_by_for_now_unknown() -> None:
    estimator = SlipEstimator(GEOMETRY, SlipEstimate.before_any_reading(UNSURE), UNSURE)
    for k in range(400):
        estimator.move(TrackOdometry(0.02, 0.0, PERIOD))
        estimator.read(1e-3 * np.sin(k / 40), SIGMA)
    before = estimator.estimate
    estimator.move(TrackOdometry(-0.02, 0.0, 1e-6, turned_back=True))
    after = estimator.estimate
    assert before.sigma(SlipStateIndex.UNSTEADY_DRIFT) < 0.9 * UNSURE.unsteady_drift
    assert after.sigma(SlipStateIndex.UNSTEADY_DRIFT) == pytest.approx(
        UNSURE.unsteady_drift, rel=0.1
    )
    assert after.x[UNSTEADY] == pytest.approx(0.0)
    np.testing.assert_allclose(after.x[2:8], before.x[2:8])


def follow_straight_joint(
    efficiency: float, delay: int = 0, ripple: float = 0.0, inertial: bool = False, lag: int = 0
) -> tuple[SlipEstimator, float]:
    """An estimator, and how far its heading is off, after a way out, back and out in waves.

    The truth turns as the tracks did `delay` periods before, and its left chain ripples. The
    inclinometer shows the direction of `lag` periods before.
    """
    rng, odometry_filter = np.random.default_rng(5), OdometryFilter(TRACKS)
    estimator = SlipEstimator(GEOMETRY, SlipEstimate.before_any_reading(UNSURE), UNSURE)
    truth = np.zeros(STATE_COUNT)
    truth[SlipStateIndex.YAW_EFFICIENCY] = efficiency
    turns, way, headings = [0.0] * (delay + 1), 0.0, [0.0] * lag
    for k in range(3000):
        speed = -0.02 if 1000 <= k < 2000 else 0.02
        turns.append(4e-3 * np.sign(np.sin(2 * np.pi * k / 400)))
        way += (speed + turns[-1] * TRACKS.gauge / 2) * 0.02
        own = ripple * np.cos(2 * np.pi * way / TRACKS.pad_pitch) * speed / TRACKS.gauge
        before = truth[SlipStateIndex.HEADING]
        truly = TrackOdometry(speed, turns[-1 - delay] + own, 0.02)
        truth, _ = propagate_state(truth, truly, GEOMETRY)
        shown = Twist(speed, turns[-1])
        estimator.move(odometry_filter.smooth(shown, 0.02, shown))
        estimator.read(laser_offset(truth, GEOMETRY)[0] + 20e-6 * rng.standard_normal(), SIGMA)
        if inertial:
            headings.append(float(truth[SlipStateIndex.HEADING]))
            rate = (headings[-1] - before) / 0.02 + GYRO_BIAS
            noise = rng.standard_normal(2) * (UNSURE.gyro / np.sqrt(0.02), UNSURE.down)
            estimator.read_inertial([rate + noise[0]], [1.5 - headings[-1 - lag] + noise[1]], 0.02)
    return estimator, estimator.estimate.x[SlipStateIndex.HEADING] - truth[SlipStateIndex.HEADING]


def test_it_learns_by_how_much_the_tracks_turn_later_than_their_odometry() -> None:
    estimator, off = follow_straight_joint(0.6, delay=4)
    known = estimator.estimate
    assert known.x[SlipStateIndex.ODOMETRY_DELAY] == pytest.approx(0.08, abs=0.01)
    assert known.x[SlipStateIndex.DRIFT] == pytest.approx(0.0, abs=1e-3)
    assert abs(off) < 4 * known.sigma(SlipStateIndex.HEADING)


def test_it_learns_the_ripple_of_a_chain() -> None:
    estimator, _ = follow_straight_joint(0.6, ripple=0.02)
    known = estimator.estimate
    assert known.x[SlipStateIndex.LEFT_RIPPLE_COSINE] == pytest.approx(0.02, rel=0.2)
    assert known.x[SlipStateIndex.RIGHT_RIPPLE_COSINE] == pytest.approx(0.0, abs=0.004)


def test_inertial_sensors_make_the_heading_surer_and_their_bias_is_learned() -> None:
    (without, _), (known, off) = (follow_straight_joint(0.6, inertial=one) for one in (False, True))
    heading, bias = SlipStateIndex.HEADING, SlipStateIndex.GYRO_BIAS
    assert known.estimate.sigma(heading) < 0.9 * without.estimate.sigma(heading)
    assert abs(off) < 4 * known.estimate.sigma(heading)
    assert known.estimate.x[bias] == pytest.approx(GYRO_BIAS, abs=0.1e-3)
    assert known.estimate.x[SlipStateIndex.JOINT_DOWN] == pytest.approx(1.5, abs=2e-3)


@pytest.mark.parametrize("lag", [0, 10])
def test_an_inclinometer_that_lags_misleads_no_quantity_of_turns(lag: int) -> None:
    known = follow_straight_joint(0.6, inertial=True, lag=lag)[0].estimate
    truths = {SlipStateIndex.YAW_EFFICIENCY: 0.6, SlipStateIndex.FIXED_CENTRE: 0.0}
    for which, truth in truths.items():
        assert abs(known.x[which] - truth) < 3 * known.sigma(which)
    assert known.x[SlipStateIndex.INCLINOMETER_LAG] == pytest.approx(0.02 * lag, abs=0.05)


def test_an_inclinometer_is_taken_to_lag_by_no_less_than_nothing_and_no_more_than_a_second() -> (
    None
):
    estimator = SlipEstimator(GEOMETRY, SlipEstimate.before_any_reading(UNSURE), UNSURE)
    found = []
    for angle in (1.0, -1.0):
        for _ in range(30):
            estimator.move(TrackOdometry(0.02, 0.3, PERIOD))
            estimator.read_inertial((), (angle,), PERIOD)
            found.append(estimator.estimate.x[SlipStateIndex.INCLINOMETER_LAG])
    assert 0 <= min(found) < max(found) <= 1


def test_neither_down_nor_the_bias_of_the_gyro_is_known_for_good() -> None:
    """Plates are not straight, and a bias wanders: after a metre both are unsure again."""
    first = SlipEstimate.before_any_reading(UNSURE)
    sure = SlipEstimate(first.x, np.zeros((STATE_COUNT, STATE_COUNT)))
    estimator = SlipEstimator(GEOMETRY, sure, UNSURE)
    for _ in range(100):
        estimator.move(TrackOdometry(0.1, 0.0, 0.1))
    known = estimator.estimate
    assert known.sigma(SlipStateIndex.GYRO_BIAS) == pytest.approx(UNSURE.gyro_bias_walk)
    assert known.sigma(SlipStateIndex.JOINT_DOWN) == pytest.approx(UNSURE.joint_down_walk)
