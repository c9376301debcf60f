"""Values become colours on a scale with round ends."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tjscan.live.colours import UNKNOWN_COLOUR, ColourScale, viridis_colours

FLOATS = st.floats(-1e4, 1e4)


@given(st.lists(FLOATS, min_size=1))
def test_a_scale_holds_its_values(values: list[float]) -> None:
    scale = ColourScale.spanning([*values, np.nan])
    slack = 1e-6 * max(1.0, *(abs(value) for value in values))
    assert scale.low - slack <= min(values) <= max(values) <= scale.high + slack
    assert scale.low < scale.high


def test_its_ends_are_round() -> None:
    assert ColourScale.spanning((0.031, 0.079)) == ColourScale(0.02, 0.08)
    assert ColourScale.spanning((58.7, 61.2)) == ColourScale(58.0, 62.0)


def test_its_ends_have_the_ends_of_the_colours() -> None:
    scale = ColourScale(-1.0, 3.0)
    assert scale.colour_of(-1.0) == scale.colour_of(-9.0) == viridis_colours()[0]
    assert scale.colour_of(3.0) == scale.colour_of(9.0) == viridis_colours()[-1]
    assert scale.colour_of(np.nan) == UNKNOWN_COLOUR


def test_without_values_there_is_still_a_scale() -> None:
    assert ColourScale.spanning([np.nan]) == ColourScale.spanning([])
