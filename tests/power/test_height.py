"""Height by the arc's current: it follows a surface, and is fooled by wire that slips."""

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.power.height import FASTEST_HEIGHT_CHANGE, ArcHeight, ArcHeightSettings
from tjscan.power.laws import ArcLaw

LAW = ArcLaw()
FEED = 9 / 60
STICK_OUT = 15e-3
CYCLE = 0.01


def follow(height: ArcHeight, higher: Array, fed: float = FEED, noise: float = 0.0) -> list[float]:
    """A torch that is so much too high, shape (n,), metres; what is left in each cycle."""
    rng, left = np.random.default_rng(3), []
    for k, by in enumerate(higher):
        left.append(float(by) + height.raised)
        slipped = fed if k * CYCLE > 1.0 else FEED
        current = LAW.current(slipped, STICK_OUT + left[-1]) + noise * rng.normal()
        height.update(k * CYCLE, FEED, current)
    return left


def test_torch_follows_a_surface_that_leads_away() -> None:
    height = ArcHeight(ArcHeightSettings(most=3e-3))
    ramp = np.clip(np.arange(2000) * CYCLE - 1.0, 0.0, 10.0) * 0.2e-3  # 0.2 mm a second
    left = follow(height, ramp, noise=2.0)
    assert height.raised == pytest.approx(-2e-3, abs=0.1e-3)
    assert np.abs(left).max() < 0.4e-3
    assert not height.at_bound


def test_height_is_relative_to_that_of_the_arc_s_start() -> None:
    height = ArcHeight(ArcHeightSettings())
    assert follow(height, np.full(1000, 0.7e-3))[-1] == pytest.approx(0.7e-3, abs=1e-6)


def test_wire_that_slips_by_three_per_cent_passes_for_a_millimetre_of_height() -> None:
    wide = ArcHeight(ArcHeightSettings(most=5e-3))
    led_astray = follow(wide, np.zeros(3000), fed=0.97 * FEED)[-1]
    assert led_astray == pytest.approx(-1.1e-3, abs=0.1e-3)
    held = ArcHeight(ArcHeightSettings(most=0.5e-3))
    assert follow(held, np.zeros(3000), fed=0.97 * FEED)[-1] == pytest.approx(-0.5e-3)
    assert held.at_bound


@pytest.mark.parametrize("misread", [0.0, 40.0, 120.0, 900.0])
@pytest.mark.parametrize("at", [0, 20, 49, 50, 300])
def test_single_currents_that_are_misread_move_no_torch(misread: float, at: int) -> None:
    height = ArcHeight(ArcHeightSettings())
    usual = LAW.current(FEED, STICK_OUT)
    for k in range(600):
        height.update(k * CYCLE, FEED, misread if at <= k < at + 3 else usual)
        assert height.raised == pytest.approx(0.0, abs=1e-9)
    assert not height.at_bound


def test_torch_moves_no_faster_than_it_may_and_is_said_once_to_be_at_its_bound() -> None:
    height, rng = ArcHeight(ArcHeightSettings()), np.random.default_rng(5)
    raised, said = [], []
    for k in range(6000):
        off = 0.0 if k < 100 else 8e-3 if k < 300 else 1.0e-3
        current = LAW.current(FEED, STICK_OUT + off + height.raised) + 2.0 * rng.normal()
        raised.append(height.update(k * CYCLE, FEED, current))
        said.append(height.at_bound)
    assert np.abs(np.diff(raised)).max() <= 1.001 * FASTEST_HEIGHT_CHANGE * CYCLE
    assert np.count_nonzero(np.diff(said)) == 1
    before = height.raised  # after a pause no way is made up for at once
    assert abs(height.update(100.0, FEED, 100.0) - before) < 0.3e-3
