"""Equation (10): from a twist to the motors' rates and back."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import Twist

SPEED = st.floats(-1, 1)
LENGTH = st.floats(0.02, 2)


@given(SPEED, SPEED, LENGTH, LENGTH)
def test_rates_show_the_twist_they_were_made_for(
    speed: float, turn_rate: float, radius: float, gauge: float
) -> None:
    tracks = TrackGeometry(sprocket_radius=radius, gauge=gauge)
    left, right = tracks.track_speeds(Twist(speed, turn_rate)) / radius
    shown = tracks.twist(left, -right)  # the motors are mirror images of each other
    assert shown.speed == pytest.approx(speed, abs=1e-12)
    assert shown.turn_rate == pytest.approx(turn_rate, abs=1e-12)


def test_motors_turn_against_each_other_straight_on_and_alike_on_the_spot() -> None:
    tracks = TrackGeometry(sprocket_radius=0.05, gauge=0.4)
    straight, turning = tracks.twist(0.4, -0.4), tracks.twist(0.4, 0.4)
    assert (straight.speed, straight.turn_rate) == pytest.approx((0.02, 0.0))
    assert (turning.speed, turning.turn_rate) == pytest.approx((0.0, 0.1))
