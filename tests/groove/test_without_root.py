"""The bound that spares a search for the groove without the face at its root."""

from dataclasses import replace

import pytest
from grooves import MM, Groove, Noise, draw

from tjscan.groove.fit import DETACHED_COST, REFIT_GAIN, SIDE_COST, find_best_candidate
from tjscan.groove.models import TEE_GROOVE, TEE_NO_ROOT
from tjscan.groove.settings import DEFAULT_SETTINGS
from tjscan.groove.without_root import least_loss_without_root

ALONE = replace(TEE_GROOVE, alternatives=())
CORNER_SIDES = 6
"""Sides that may be seen beside a corner of a tee."""


@pytest.mark.parametrize("ghosts", [0.0, 0.05, 0.1])
@pytest.mark.parametrize("seed", range(6))
def test_a_search_finds_nothing_below_the_bound(ghosts: float, seed: int) -> None:
    profile = draw(Groove(), Noise(0.03 * MM, ghosts=ghosts, missing=0.1), seed)
    row, with_root = find_best_candidate(profile, replace(DEFAULT_SETTINGS, model=ALONE))
    _, without = find_best_candidate(profile, replace(DEFAULT_SETTINGS, model=TEE_NO_ROOT))
    bound = least_loss_without_root(row, with_root.fitted, DEFAULT_SETTINGS.support_tolerance)
    least = bound - SIDE_COST - CORNER_SIDES * DETACHED_COST - REFIT_GAIN
    assert without.cost - with_root.cost > least


def test_a_root_that_explains_much_bounds_the_loss_well() -> None:
    profile = draw(Groove(), Noise(0.03 * MM))
    row, found = find_best_candidate(profile, replace(DEFAULT_SETTINGS, model=ALONE))
    explained = found.fitted.counts[-2]
    bound = least_loss_without_root(row, found.fitted, DEFAULT_SETTINGS.support_tolerance)
    assert 0.5 * explained < bound <= explained
