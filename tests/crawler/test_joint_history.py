"""What is drawn of the joint is what the passes left."""

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.crawler.joint_sections import (
    PLACES_ACROSS,
    height_over_hull,
    section_histories,
    shows_filled_joint,
)
from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.method import TorchEstimate
from tjscan.crawler.phases import Phase
from tjscan.laser.profile import Profile
from tjscan.vehicle.vehicle import AT_REST, VehicleState

X: Array = np.linspace(-0.04, 0.04, 290)


def seen(phase: Phase, number: int, travel: float, d: float, depth: float) -> CrawlCycle:
    state = VehicleState(0.0, AT_REST)
    torch = TorchEstimate(0.0, 1e-3, 0.0)
    return CrawlCycle(phase, number, travel, state, AT_REST, torch, 0.0, 0.0, False, d, 1e-5)


def profile(d: float, depth: float) -> Profile:
    groove = np.abs(X + d) < 0.01
    return Profile(X, np.where(groove, 0.149 + depth, 0.149))


def test_sections_are_those_after_each_pass_wherever_the_vehicle_was() -> None:
    taken = [
        (phase, number, 0.01 * k - 0.5, 1e-3 * k, depth)
        for phase, number, depth in (
            (Phase.WELDING, 1, 0.02),
            (Phase.RETURN, 1, 0.012),
            (Phase.WELDING, 2, 0.012),
            (Phase.RETURN, 2, 0.004),
        )
        for k in range(5)
    ]
    found = section_histories(
        [(seen(*one), profile(one[3], one[4])) for one in taken], length=0.1, laser_to_torch=0.5
    )
    assert list(found) == [0, 1, 2]
    middle = len(PLACES_ACROSS) // 2
    np.testing.assert_allclose(
        [found[k][middle] for k in found], [-0.02, -0.012, -0.004], atol=1e-5
    )
    for height in found.values():
        np.testing.assert_allclose(height[np.abs(PLACES_ACROSS) > 0.011], 0.0, atol=1e-5)


def test_a_filled_joint_that_is_not_read_is_drawn_where_the_vehicle_last_was() -> None:
    """On the way back over the last pass only the crater at its end is read."""
    offsets = (0.002, *[np.nan] * 4)
    taken = [
        (seen(Phase.RETURN, 3, 0.1 - 0.01 * k - 0.5, d, 0.0), profile(0.002, 0.001 if k else 0.02))
        for k, d in enumerate(offsets)
    ]
    found = section_histories(taken, length=0.1, laser_to_torch=0.5)
    assert found[3][len(PLACES_ACROSS) // 2] == pytest.approx(-0.001, abs=1e-5)


def test_what_lies_beside_the_weld_does_not_count() -> None:
    beside = seen(Phase.WELDING, 1, 0.2, 0.0, 0.02)
    assert section_histories([(beside, profile(0.0, 0.02))], 0.1, 0.5) == {}


def test_a_section_is_level_with_its_hull_under_the_light_of_an_arc() -> None:
    rng, groove = np.random.default_rng(0), profile(0.0, 0.02)
    lit = rng.random(len(X)) < 0.2
    z = np.where(lit, groove.z_s + rng.uniform(-0.04, 0.04, len(X)), groove.z_s) + 0.02 * X
    height = height_over_hull(Profile(X, z), 0.0)
    assert height is not None
    depth = np.where(np.abs(PLACES_ACROSS) < 0.0095, -0.02, 0.0)
    beside = np.abs(np.abs(PLACES_ACROSS) - 0.01) > 1e-3
    assert abs(float(np.median((height - depth)[beside]))) < 1e-4
    assert height_over_hull(Profile(X[X < 0], z[X < 0]), 0.0) is None


@pytest.mark.parametrize(
    ("unseen", "height", "filled"),
    [
        ((0.0, 0.0), 0.0, True),
        ((-0.0025, 0.0025), 0.0, True),  # the light of an arc hides so much
        ((-0.004, 0.004), 0.0, False),  # and this may be a groove that is too dark
        ((0.024, 0.031), 0.0, False),
        ((0.0, 0.0), 0.0015, True),  # a crown
        ((0.0, 0.0), 0.003, False),
    ],
)
def test_a_joint_is_filled_if_even_steel_is_seen_at_every_place_of_it(
    unseen: tuple[float, float], height: float, *, filled: bool
) -> None:
    bead = np.where(np.abs(X) < 0.01, 0.149 - height, 0.149)
    hidden = np.abs(X - np.mean(unseen)) < np.ptp(unseen) / 2
    assert shows_filled_joint(Profile(X, np.where(hidden, np.nan, bead))) == filled
