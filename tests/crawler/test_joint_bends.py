"""A joint that bends: its course between places, what is known of it at first, and its estimate."""

import numpy as np
import pytest

from tjscan.core.errors import CrawlStopped
from tjscan.crawler.slip_aware import SlipAwareMethod, SteeringSettings
from tjscan.crawler.slip_estimator import (
    BEND_REACH,
    BEND_SPACING,
    BEND_STEP,
    STATE_COUNT,
    STRAIGHT_STEP,
    CrawlerGeometry,
    SlipEstimate,
    SlipEstimator,
    SlipStateIndex,
    SlipUncertainty,
    TrackOdometry,
    bend_shares,
    laser_offset,
    propagate_state,
)
from tjscan.recording.topic import Topic
from tjscan.vehicle.vehicle import Twist, VehicleState

GEOMETRY, UNSURE = CrawlerGeometry(0.5, 0.0), SlipUncertainty()
FIRST = SlipEstimate.before_any_reading(UNSURE)
PLACES = (0.1, 0.12, 0.15)


def kink(s: float) -> float:
    """How far to the right a joint is that goes aside by 3 mm from 0.25 to 0.35 m."""
    into = min(max((s - 0.25) / 0.1, 0.0), 1.0)
    return 3e-3 * into**2 * (3 - 2 * into)


@pytest.mark.parametrize("at", [0.1, 0.11, 0.12, 0.14, 0.15, 0.4])
def test_a_straight_line_through_the_places_is_kept_and_goes_on(at: float) -> None:
    line = 2e-3 + 0.03 * np.array(PLACES)
    if at > PLACES[0]:
        assert bend_shares(PLACES, at) @ line == pytest.approx(2e-3 + 0.03 * at)
        assert bend_shares(PLACES, at).sum() == pytest.approx(1.0)


def test_before_a_bend_the_joint_is_on_its_course() -> None:
    assert not bend_shares(PLACES, 0.05).any()
    assert not len(bend_shares((), 0.5))


def test_at_first_a_bend_goes_on_straight_but_for_a_step_at_each_place() -> None:
    one = FIRST.with_bend((), 0.5)
    assert np.diff(one.bend) == pytest.approx(BEND_SPACING)
    assert (one.bend[0], one.bend[-1]) == pytest.approx((0.5 - BEND_REACH, 0.5 + BEND_REACH - 0.01))
    off = np.diff(np.eye(len(one.bend)), 2, axis=0)
    P = one.P[STATE_COUNT:, STATE_COUNT:]
    assert off @ P @ off.T == pytest.approx(BEND_STEP**2 * np.eye(len(off)), abs=1e-14)
    assert not P[:2].any()  # there it is on its course
    assert not one.P[:STATE_COUNT, STATE_COUNT:].any()
    assert not one.x[STATE_COUNT:].any()


def test_it_is_told_where_the_joint_is_assumed_to_bend_and_how_far_aside() -> None:
    assert FIRST.bends == []
    two = FIRST.with_bend(FIRST.with_bend((), 0.5).bend, 1.2)
    course = 1e-3 + 0.01 * np.array(two.bend)  # a straight line is no bend
    course += [-kink(place - 0.2) for place in two.bend]
    known = SlipEstimate(np.concatenate((two.x[:STATE_COUNT], course)), two.P, two.bend)
    ((start, end, aside, sigma), (_, _, straight, _)) = known.bends
    assert (start, end) == pytest.approx((0.25, 0.74))
    assert aside == pytest.approx(-3e-3)
    assert sigma > BEND_STEP
    assert straight == pytest.approx(0.0, abs=1e-12)


def test_a_contradiction_where_a_bend_is_known_is_no_other_bend() -> None:
    method = SlipAwareMethod(GEOMETRY, FIRST, UNSURE, SteeringSettings())
    for _ in range(25):
        method.move(VehicleState(0.0, Twist(0.01, 0.0)), 1.0, Twist(0.01, 0.0))
    assert method.follow_bend()
    for _ in range(24):
        assert not method.follow_bend()
        assert len(method.slip.bend) == 50
        method.move(VehicleState(0.0, Twist(0.01, 0.0)), 1.0, Twist(0.01, 0.0))
    for _ in range(3):
        method.move(VehicleState(0.0, Twist(0.01, 0.0)), 1.0, Twist(0.01, 0.0))
    assert method.follow_bend()


def test_before_the_first_place_that_the_laser_saw_the_joint_does_not_bend() -> None:
    method = SlipAwareMethod(GEOMETRY, FIRST, UNSURE, SteeringSettings())
    for speed in (*[0.01] * 6, *[-0.01] * 4):
        method.move(VehicleState(0.0, Twist(speed, 0.0)), 1.0, Twist(speed, 0.0))
    first = GEOMETRY.laser_to_torch - 0.02
    assert method.follow_bend()
    assert first < method.slip.bend[0] < first + BEND_SPACING
    method.move(VehicleState(0.0, Twist(0.3, 0.0)), 1.0, Twist(0.3, 0.0))
    assert method.follow_bend()  # another one, and still none before
    assert method.slip.bend[0] > first - 0.3


def test_a_second_bend_joins_the_first_and_between_them_it_is_straight() -> None:
    one = FIRST.with_bend((), 0.5)
    assert FIRST.with_bend(one.bend, 0.5).bend == one.bend
    two = FIRST.with_bend(one.bend, 1.2)
    assert len(two.bend) == 2 * len(one.bend)
    assert np.diff(two.bend).min() > BEND_SPACING / 2
    gap = int(np.argmax(np.diff(two.bend))) + 1
    shares = np.zeros(len(two.x))
    before = bend_shares(two.bend[:gap], two.bend[gap])
    shares[STATE_COUNT : STATE_COUNT + gap] = -before
    shares[STATE_COUNT + gap] = 1.0
    assert shares @ two.P @ shares == pytest.approx(STRAIGHT_STEP**2)


def test_laser_and_motion_of_a_bent_joint() -> None:
    one = FIRST.with_bend((), 0.45)
    x = one.x + np.linspace(-1e-3, 2e-3, len(one.x))
    d, H = laser_offset(x, GEOMETRY, one.bend)
    eps = 1e-7 * np.eye(len(x))
    numeric = [(laser_offset(x + e, GEOMETRY, one.bend)[0] - d) / 1e-7 for e in eps]
    np.testing.assert_allclose(H, numeric, atol=1e-5)
    after, F = propagate_state(x, TrackOdometry(0.02, 1e-3, 0.02), GEOMETRY)
    assert after[STATE_COUNT:].tolist() == x[STATE_COUNT:].tolist()
    assert F[STATE_COUNT:, STATE_COUNT:].tolist() == np.eye(len(one.bend)).tolist()
    assert not F[:STATE_COUNT, STATE_COUNT:].any()


def test_what_is_bent_stays_where_it_is_on_the_hull() -> None:
    estimator = SlipEstimator(GEOMETRY, FIRST.with_bend((), 0.5), UNSURE)
    first = estimator.estimate.bend
    for speed in (0.02, 0.02, -0.01):
        estimator.move(TrackOdometry(speed, 0.0, 1.0))
    assert np.subtract(first, estimator.estimate.bend) == pytest.approx(0.03)
    assert estimator.estimate.at_new_start(UNSURE).bend == ()
    down = estimator.estimate.at_new_start(UNSURE, moved=0.1)
    assert np.subtract(estimator.estimate.bend, down.bend) == pytest.approx(0.1)
    assert down.P[SlipStateIndex.OFFSET, SlipStateIndex.OFFSET] == UNSURE.offset**2


def test_torch_is_known_beside_a_joint_that_bends() -> None:
    rng, errors = np.random.default_rng(4), []
    for _ in range(6):
        truth = FIRST.x + np.sqrt(np.diag(FIRST.P)) * rng.standard_normal(STATE_COUNT)
        truth[SlipStateIndex.YAW_EFFICIENCY :] *= 0.3  # a sound vehicle
        truth[SlipStateIndex.YAW_EFFICIENCY] = 0.6
        # The torch begins 0.2 m before the place from which `kink` counts.
        estimator, torch = SlipEstimator(GEOMETRY, FIRST.with_bend((), 0.5), UNSURE), -0.2
        for k in range(2400):
            speed = (0.02, -0.02)[k // 600 % 2]
            odometry = TrackOdometry(speed, 2e-3 * np.sin(2 * np.pi * k / 300), 0.05)
            truth, _ = propagate_state(truth, odometry, GEOMETRY)
            torch += speed * 0.05
            estimator.move(odometry)
            d = laser_offset(truth, GEOMETRY)[0] - kink(torch + 0.5)
            estimator.read(d + 15e-6 * rng.standard_normal(), 15e-6)
            if k > 1200 and k % 100 == 0:
                known = estimator.estimate
                off = known.torch_shares @ known.x - (truth[0] - kink(torch))
                errors.append(off / np.sqrt(known.torch_shares @ known.P @ known.torch_shares))
    assert np.mean(np.square(errors)) < 2


def test_slip_that_no_vehicle_has_stops_before_an_arc() -> None:
    x = FIRST.x.copy()
    for which in ("rotation_centre", "drift", "crab", "turning_crab", "fixed_centre"):
        x[SlipStateIndex[which.upper()]] += 1.9 * getattr(UNSURE, which)
    method = SlipAwareMethod(GEOMETRY, SlipEstimate(x, FIRST.P), UNSURE, SteeringSettings())
    method.check_slip()
    x[SlipStateIndex.FIXED_CENTRE] += 1.9 * UNSURE.fixed_centre
    method = SlipAwareMethod(GEOMETRY, SlipEstimate(x, FIRST.P), UNSURE, SteeringSettings())
    with pytest.raises(CrawlStopped, match=r"its fixed centre is 3\.8 standard deviations"):
        method.check_slip()


def test_a_bend_is_recorded_and_read_again() -> None:
    topic, one = Topic.of("/slip", SlipEstimate), FIRST.with_bend((), 0.5)
    read = topic.decode(topic.encode(one))
    assert read.bend == one.bend
    np.testing.assert_array_equal(read.P, one.P)
    content = topic.encode(FIRST)
    assert topic.decode(content).bend == ()
    with pytest.raises(ValueError, match="of a bend"):
        SlipEstimate(FIRST.x, FIRST.P, (0.1, 0.2))
