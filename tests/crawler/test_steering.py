"""Poles, mirror images, and the bound of the tightest turn."""

from math import exp

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.frames import Array
from tjscan.crawler.slip_aware import SteeringSettings, track_turn_rate
from tjscan.crawler.slip_estimator import (
    STATE_COUNT,
    CrawlerGeometry,
    SlipStateIndex,
    TrackOdometry,
    propagate_state,
)
from tjscan.runs.crawl.run import SETTLING_MULTIPLE, TURNING_MULTIPLE

GEOMETRY = CrawlerGeometry(0.5, 0.0)
WIDE = SteeringSettings(gain=8.0, least_radius=0.5)


def slipping(offset: float = 0.0, heading: float = 0.0, crab: float = 0.0) -> Array:
    x = np.zeros(STATE_COUNT)
    x[[SlipStateIndex.OFFSET, SlipStateIndex.HEADING, SlipStateIndex.CRAB]] = offset, heading, crab
    x[[SlipStateIndex.YAW_EFFICIENCY, SlipStateIndex.DRIFT]] = 0.7, 5e-3
    return x


def drive(x: Array, speed: float, travel: float, settings: SteeringSettings) -> Array:
    period = 1e-3 / abs(speed)
    for _ in range(round(travel / (abs(speed) * period))):
        turn = track_turn_rate(x, speed, GEOMETRY, settings)
        x, _ = propagate_state(x, TrackOdometry(speed, turn, period), GEOMETRY)
    return x


@pytest.mark.parametrize("speed", [0.005, 0.02, -0.02])
def test_both_poles_are_the_gain_whichever_way_and_speed(speed: float) -> None:
    x = drive(slipping(offset=1e-4), speed, 0.3, WIDE)
    expected = 1e-4 * (1 + 8 * 0.3) * exp(-8 * 0.3)
    assert x[SlipStateIndex.OFFSET] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("speed", [0.005, -0.02])
@pytest.mark.parametrize("ahead", [0.0, 0.06])
def test_the_torch_ends_on_the_joint_whatever_the_crab(speed: float, ahead: float) -> None:
    start = slipping(offset=5e-3, heading=0.015, crab=5e-3)
    start[SlipStateIndex.ROTATION_CENTRE] = ahead
    x = drive(start, speed, 3.0, SteeringSettings())
    assert abs(x[SlipStateIndex.OFFSET]) < 2e-6


@given(st.floats(-0.05, 0.05), st.floats(-0.2, 0.2), st.sampled_from([-0.02, 0.005]))
def test_no_turn_is_tighter_than_allowed(offset: float, heading: float, speed: float) -> None:
    x = slipping(offset, heading)
    turn = track_turn_rate(x, speed, GEOMETRY, SteeringSettings(least_radius=8.0))
    curvature = turn * x[SlipStateIndex.YAW_EFFICIENCY] / speed + x[SlipStateIndex.DRIFT]
    assert abs(curvature) <= 1 / 8 + 1e-12


@given(st.floats(-0.03, 0.03), st.floats(-0.1, 0.1))
def test_from_far_off_it_does_not_swing_past_by_much(offset: float, heading: float) -> None:
    x = drive(slipping(offset, heading), 0.02, 4.0, SteeringSettings())
    assert abs(x[SlipStateIndex.OFFSET]) < 1e-4


def test_nothing_is_steered_at_rest() -> None:
    assert track_turn_rate(slipping(1.0), 0.0, GEOMETRY, SteeringSettings()) == 0.0


def shuttled(length: float, crab: float, settings: SteeringSettings, times: int = 6) -> float:
    """How far off it is after some ways back and forth, when all is known exactly."""
    x = slipping(offset=1e-3, crab=crab)
    x[SlipStateIndex.DRIFT] = 0.0
    for _ in range(times):
        x = drive(drive(x, 0.02, length, settings), -0.02, length, settings)
    return abs(float(x[SlipStateIndex.OFFSET]))


@pytest.mark.parametrize(("crab", "radius"), [(5e-3, 8.0), (10e-3, 8.0), (10e-3, 4.0)])
def test_ways_too_short_to_turn_by_twice_the_crab_lead_outward(crab: float, radius: float) -> None:
    """With everything known: it is geometry; `short_pass_warning` warns of it."""
    settings = SteeringSettings(least_radius=radius)
    needed = SETTLING_MULTIPLE / settings.gain + TURNING_MULTIPLE * crab * radius
    # Where it goes straight along the joint, it stands askew by the crab.
    assert shuttled(needed, crab, settings) < crab / settings.gain * 3
    short = 0.3 * needed
    assert shuttled(short, crab, settings) > 1e-3 + 6 * crab * short
