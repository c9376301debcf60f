"""The bound that spares a search for the groove without the face at its root."""

from dataclasses import replace

import pytest
from grooves import MM, Groove, Noise, draw

from tjscan.groove.alternatives import bound_cost_of_removing_root
from tjscan.groove.read import order_points
from tjscan.groove.search import MOST_REFIT_GAIN, SIDE_COST, UNREACHED_CORNER_COST, find_best_fit
from tjscan.groove.settings import DEFAULT_SETTINGS, TEE_GROOVE, TEE_NO_ROOT

ALONE = replace(TEE_GROOVE, alternatives=())
CORNER_SIDES = 6
"""Sides that may be seen beside a corner of a tee."""


@pytest.mark.parametrize("ghosts", [0.0, 0.05, 0.1])
@pytest.mark.parametrize("seed", range(6))
def test_a_search_finds_nothing_below_the_bound(ghosts: float, seed: int) -> None:
    profile = draw(Groove(), Noise(0.03 * MM, ghosts=ghosts, missing=0.1), seed)
    row = order_points(profile, DEFAULT_SETTINGS)
    with_root = find_best_fit(row, replace(DEFAULT_SETTINGS, model=ALONE))
    without = find_best_fit(row, replace(DEFAULT_SETTINGS, model=TEE_NO_ROOT))
    bound = bound_cost_of_removing_root(row, with_root.fitted, DEFAULT_SETTINGS.support_tolerance)
    least = bound - SIDE_COST - CORNER_SIDES * UNREACHED_CORNER_COST - MOST_REFIT_GAIN
    assert without.cost - with_root.cost > least


def test_a_root_that_explains_much_bounds_the_loss_well() -> None:
    profile = draw(Groove(), Noise(0.03 * MM))
    row = order_points(profile, DEFAULT_SETTINGS)
    found = find_best_fit(row, replace(DEFAULT_SETTINGS, model=ALONE))
    explained = found.fitted.counts[-2]
    bound = bound_cost_of_removing_root(row, found.fitted, DEFAULT_SETTINGS.support_tolerance)
    assert 0.5 * explained < bound <= explained
