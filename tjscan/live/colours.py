"""Colours of the page, and the scale that turns values into colours."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from math import floor, isfinite, log10
from typing import Final

import numpy as np

from tjscan.core.frames import Array

Colour = tuple[int, int, int]

ARM_COLOUR: Final[Colour] = (72, 99, 132)
TOOL_COLOUR: Final[Colour] = (226, 144, 54)
SOLID_COLOUR: Final[Colour] = (172, 178, 186)
NOMINAL_COLOUR: Final[Colour] = (150, 160, 172)
LASER_COLOUR: Final[Colour] = (226, 38, 54)
FITTED_COLOUR: Final[Colour] = (255, 214, 10)
UNKNOWN_COLOUR: Final[Colour] = (120, 120, 120)
"""Of a piece whose measure is not known."""

COLOUR_SCALE_END_MULTIPLES: Final = (1.0, 2.0, 5.0, 10.0)
"""What the ends of a scale are multiples of, times a power of ten."""

LEAST_SPAN: Final = 4e-3
"""Of a scale, in its unit: less than that is no difference in mm, s, degrees, N or A."""


@dataclass(frozen=True, slots=True)
class ColourScale:
    """From values to colours, evenly between two round numbers.

    Parameters
    ----------
    low, high : float
        Values of its ends; low < high.
    """

    low: float
    high: float

    @classmethod
    def spanning(cls, values: Iterable[float]) -> ColourScale:
        """Scale that holds all values that are known, its ends rounded; see `round_scale_ends`."""
        return cls(*round_scale_ends(values))

    def colour_of(self, value: float) -> Colour:
        """Colour of a value; grey if it is not known."""
        if not isfinite(value):
            return UNKNOWN_COLOUR
        share = min(max((value - self.low) / (self.high - self.low), 0.0), 1.0)
        return viridis_colours()[round(share * (len(viridis_colours()) - 1))]

    @property
    def css_gradient(self) -> str:
        """The scale as a CSS gradient from left to right."""
        stops = [viridis_colours()[k] for k in range(0, 256, 51)]
        return f"linear-gradient(90deg,{','.join(f'rgb{stop}' for stop in stops)})"


def round_scale_ends(values: Iterable[float]) -> tuple[float, float]:
    """Ends that hold all values that are known, rounded outwards.

    They are multiples of a tenth to a quarter of the span, so that a scale rarely changes
    while values come in.
    """
    ticks = scale_ticks(values)
    return float(ticks[0]), float(ticks[-1])


def scale_ticks(values: Iterable[float]) -> Array:
    """Round numbers from below to above all values that are known, evenly spaced."""
    known = [value for value in values if isfinite(value)]
    low, high = (min(known), max(known)) if known else (0.0, 1.0)
    span = max(high - low, 0.02 * max(abs(low), abs(high)), LEAST_SPAN)
    power = 10.0 ** floor(log10(span / 4))
    step = power * next(
        (one for one in COLOUR_SCALE_END_MULTIPLES if one >= span / 4 / power),
        COLOUR_SCALE_END_MULTIPLES[-1],
    )
    first = floor(low / step + 1e-9)
    last = max(-floor(-high / step + 1e-9), first + 1)
    return np.asarray(step * np.arange(first, last + 1), dtype=float)


@cache
def viridis_colours() -> tuple[Colour, ...]:
    """The 256 colours of Matplotlib's viridis: even to the eye, and to the colour-blind."""
    import matplotlib as mpl

    rows = mpl.colormaps["viridis"](range(256), bytes=True)[:, :3].tolist()
    return tuple((r, g, b) for r, g, b in rows)
