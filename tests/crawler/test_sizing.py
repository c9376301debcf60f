"""Closed forms of the paper's sizing."""

import pytest

from tjscan.crawler.sizing import SizeSettings, peel_of_top_pad, size_crawler, torque_of_turn
from tjscan.vehicle.tracks import TrackGeometry

FIGURES = {one.name: one.value for one in size_crawler(SizeSettings(), TrackGeometry(), 8.0)}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("the same with one track broken", 6.0),
        ("grip of both tracks over the weight", 12.0),
        ("least pads of a track for that", 20.0),
        ("friction needed on one track", 1 / 6),
        ("friction needed on both tracks", 1 / 12),
        ("pull of a track", 840.0),
        ("pull of both tracks over the weight", 1.7125),
        ("speed of a motor at top speed", 3724.2),
        ("power of a track at full pull", 84.0),
        ("power to climb at top speed", 98.1),
    ],
)
def test_figures_are_those_of_the_closed_forms(name: str, value: float) -> None:
    assert FIGURES[name] == pytest.approx(value, rel=1e-3)


def test_peel_is_that_of_pads_spread_evenly() -> None:
    # Many pads: sum of x² is n L² / 12, and the top one sits at L / 2.
    size = SizeSettings().pads
    limit = size.mass * 9.81 * size.mass_height * 6 / (size.pads * size.contact_length)
    assert peel_of_top_pad(size) == pytest.approx(limit, rel=0.06)


def test_a_tighter_turn_takes_more_torque() -> None:
    torques = [torque_of_turn(SizeSettings().pads, TrackGeometry(), r) for r in (200, 50, 10)]
    assert torques == sorted(torques)
    # Straight up, each track carries half of the weight.
    straight = torque_of_turn(SizeSettings().pads, TrackGeometry(), 1e6)
    assert straight == pytest.approx(100 * 9.81 / 2 * 0.05, rel=0.02)
