"""Noise is smoothed, a ramp is not."""

import numpy as np
import pytest

from tjscan.crawler.slip_aware import (
    DRIVE_LAG,
    NOISE_MEMORY_TIME,
    QUIET_TURN_RATE,
    OdometryFilter,
)
from tjscan.vehicle.vehicle import Twist

PERIOD = 0.01


def test_noise_is_smoothed_and_its_mean_kept() -> None:
    rng = np.random.default_rng(1)
    found, asked = OdometryFilter(), Twist(0.005, 1e-3)
    out = [
        found.smooth(Twist(0.0052, 1.1e-3 + 3.5e-4 * rng.standard_normal()), PERIOD, asked)
        for _ in range(4000)
    ]
    turn = np.array([one.turn_rate for one in out[1000:]])
    assert turn.std() < 0.3 * 3.5e-4
    # What the drives make of a command is corrected towards what the encoders show.
    assert 1.0e-3 < turn.mean() < 1.1e-3


@pytest.mark.parametrize("sigma", [1e-4, 3.5e-4, 2e-3])
def test_the_noise_of_the_turn_rate_is_learned_from_encoders_that_move(sigma: float) -> None:
    rng, found = np.random.default_rng(2), OdometryFilter()
    asked = Twist(0.005, 1e-3)
    out = [
        found.smooth(Twist(0.005, 1e-3 + sigma * rng.standard_normal()), PERIOD, asked)
        for _ in range(4000)
    ]
    known = [one.turn_rate_variance for one in out]
    assert known[: int(NOISE_MEMORY_TIME / PERIOD)].count(None) == NOISE_MEMORY_TIME / PERIOD
    assert np.sqrt(np.mean(np.array(known[1000:], float))) == pytest.approx(sigma, rel=0.15)
    for _ in range(1000):  # at rest they show none, and none is unlearned
        rest = found.smooth(Twist(0.0, 0.0), PERIOD)
    assert rest.turn_rate_variance == pytest.approx(sigma**2, rel=0.5)


def test_exact_encoders_are_not_taken_for_free_of_noise() -> None:
    exact = OdometryFilter()
    for _ in range(1000):
        shown = exact.smooth(Twist(0.005, 0.0), PERIOD, Twist(0.005, 0.0))
    assert shown.turn_rate_variance == QUIET_TURN_RATE**2


@pytest.mark.parametrize("speed", [0.02, 0.06])
def test_a_ramp_is_followed_as_the_encoders_show_it(speed: float) -> None:
    found, travel, seen, now = OdometryFilter(), 0.0, 0.0, -speed
    for _ in range(100):
        now = min(now + 0.5 * PERIOD, speed)  # slower than a lag alone
        travel += now * PERIOD
        seen += found.smooth(Twist(now, 0.0), PERIOD, Twist(speed, 0.0)).speed * PERIOD
    assert seen == pytest.approx(travel, abs=0.3e-3)


def test_it_says_once_that_the_vehicle_turned_back() -> None:
    found = OdometryFilter()
    turned = [
        found.smooth(Twist(speed, 0.0), PERIOD, Twist(speed, 0.0)).turned_back
        for speed in [0.02] * 200 + [0.0] * 200 + [-0.02] * 200
    ]
    assert sum(turned) == 1
    assert any(turned[400:])


def test_noise_is_no_turn_and_a_turn_is_one_at_once() -> None:
    """What goes by how much it turns, whichever way, is neither biased by noise nor late."""
    rng = np.random.default_rng(1)
    found, turned, truly, now = OdometryFilter(), 0.0, 0.0, 0.0
    for k in range(2000):
        asked = Twist(0.02, 2e-3 * (k >= 1000))
        now += PERIOD / DRIVE_LAG * (asked.turn_rate - now)
        shown = Twist(0.02, now + 3.5e-4 * rng.standard_normal())
        turned += abs(found.smooth(shown, PERIOD, asked).asked_turn_rate or 0.0) * PERIOD
        truly += abs(now) * PERIOD
    assert turned == pytest.approx(truly, rel=1e-6)
