"""Steel at the corners: hysteresis, and no motion towards an edge."""

from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.crawler.guards import ProximityFilter, ProximitySensorPlaces, ProximitySettings
from tjscan.vehicle.vehicle import PROXIMITY_CORNERS, Twist

STEEL = (0.03,) * 4
BODY = ProximitySensorPlaces(0.8, 0.5)


def after(*samples: tuple[float, ...]) -> tuple[str, ...]:
    found = ProximityFilter(ProximitySettings(samples=2))
    for sample in samples:
        found.add_sample(sample)
    return found.missing_corners


def test_nothing_counts_as_steel_before_it_was_seen() -> None:
    assert after() == PROXIMITY_CORNERS
    assert after(STEEL) == PROXIMITY_CORNERS
    assert after(STEEL, STEEL) == ()


@pytest.mark.parametrize("edge", [inf, nan, 0.2])
def test_an_edge_is_one_after_samples_in_a_row(edge: float) -> None:
    gone = (edge, 0.03, 0.03, 0.03)
    assert after(STEEL, STEEL, gone) == ()
    assert after(STEEL, STEEL, gone, STEEL, gone) == ()
    assert after(STEEL, STEEL, gone, gone) == ("front left",)


def test_between_the_limits_nothing_changes() -> None:
    between = (0.05,) * 4
    assert after(STEEL, STEEL, between, between, between) == ()
    assert after(between, between, between) == PROXIMITY_CORNERS


def test_away_from_an_edge_is_allowed() -> None:
    assert BODY.moves_towards_edge(Twist(0.1, 0.0), ["front left"])
    assert not BODY.moves_towards_edge(Twist(-0.1, 0.0), ["front left"])
    assert not BODY.moves_towards_edge(Twist(0.0, 0.0), PROXIMITY_CORNERS)


corners = st.lists(st.sampled_from(PROXIMITY_CORNERS), unique=True)
twists = st.builds(Twist, st.floats(-0.1, 0.1), st.floats(-0.5, 0.5))


@given(corners, twists)
def test_no_corner_without_steel_moves_outward_where_it_is_allowed(
    missing: list[str], twist: Twist
) -> None:
    if BODY.moves_towards_edge(twist, missing):
        return
    for corner in missing:
        end, side = corner.split()
        x, y = 0.4 if end == "front" else -0.4, 0.25 if side == "right" else -0.25
        velocity = (twist.speed - twist.turn_rate * y, twist.turn_rate * x)
        # A moment later the corner is no farther out in either direction.
        assert abs(x + 1e-3 * velocity[0]) <= abs(x)
        assert abs(y + 1e-3 * velocity[1]) <= abs(y)
