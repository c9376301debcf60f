"""What a weld shall fill: the line between its toes, the reinforcement over it, and layers."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.frames import Array, Mask, array_dataclass
from tjscan.welding.bead import column_widths
from tjscan.welding.state import WeldState

SAG_WORTH_SAYING: Final = 0.5e-3
"""Below the line between the toes of a finished weld, metres."""

HALVING_STEPS: Final = 30
"""To find a layer's top: 30 halvings of 60 mm leave a nanometre."""


@array_dataclass
class WeldTarget:
    """The finished weld over the columns of n sections.

    Parameters
    ----------
    chord : ndarray, shape (n, m)
        Line from toe to toe, and on, metres.
    top : ndarray, shape (n, m)
        The same with the reinforcement between the toes.
    slope : ndarray, shape (n,)
        Of the line between the toes.
    between : ndarray of bool, shape (n, m)
        Columns between the toes.
    """

    chord: Array
    top: Array
    slope: Array
    between: Mask

    @classmethod
    def over(cls, state: WeldState, cap_height: float) -> WeldTarget:
        """The target of a state's toes where they are now.

        Parameters
        ----------
        state : WeldState
        cap_height : float
            Of the parabola's middle above the line between the toes, square to it, metres.
        """
        left, right = np.moveaxis(state.toe_points, 1, 0)
        span = right - left
        slope = span[:, 1] / span[:, 0]
        share = (state.u - left[:, :1]) / span[:, :1]
        chord = left[:, 1:] + slope[:, None] * (state.u - left[:, :1])
        between = (share > 0) & (share < 1)
        cap = cap_height * np.hypot(1, slope)[:, None] * 4 * share * (1 - share)
        return cls(chord, chord + np.where(between, cap, 0.0), slope, between)


def surface_in_words(state: WeldState, cap_height: float, step: float) -> str:
    """How far a finished surface, read at stations a step apart, metres, lies off its target."""
    target = WeldTarget.over(state, cap_height)
    upright = np.hypot(1, target.slope)
    below = np.where(target.between, target.chord - state.w, 0.0).max(axis=1) / upright
    over = np.where(target.between, state.w - target.top, 0.0).max(axis=1) / upright
    step *= 1e3
    return (
        f"up to {1e3 * over.max():.1f} mm over its target, up to {1e3 * below.max():.1f} mm "
        f"below the line between its toes, and by more than {1e3 * SAG_WORTH_SAYING:g} mm on "
        f"{step * (below > SAG_WORTH_SAYING).sum():.0f} mm of the {step * len(below):.0f} mm "
        "that were read"
    )


def remaining_area(state: WeldState, target: WeldTarget) -> Array:
    """Area between surface and target, between the toes, shape (n,), m²; what is over it counts."""
    height = np.where(target.between, target.top - state.w, 0.0)
    return np.asarray(np.einsum("ij,ij->i", column_widths(state.u), height))


def area_lost_by_closing(
    depth: Array, by: Array, turn_per_metre: float, cap_height: float
) -> Array:
    """Area that a groove loses when its left side comes nearer by a way, shape (n,), m².

    The metal in it is upset, so all that is lost was open.
    """
    return np.asarray(by * (depth * (1 + 0.5 * turn_per_metre * depth) + 2 / 3 * cap_height))


def layer_top(state: WeldState, target: WeldTarget, share: float, area: Array) -> Array:
    """Top of a layer over the columns, shape (n, m), metres.

    A line, level in the section at the root and parallel to the line of the toes at the cap,
    that leaves a given area above the surface; the last layer's top is the target.

    Parameters
    ----------
    share : float
        Of the weld's area that is filled below it.
    area : ndarray, shape (n,)
        Between the surface and the layer's top, m².
    """
    if share >= 1:
        return target.top
    widths = np.where(target.between, column_widths(state.u), 0.0)
    line = share * target.slope[:, None] * state.u
    low = (state.w - line).min(axis=1)
    high = low + 0.06
    for _ in range(HALVING_STEPS):
        middle = 0.5 * (low + high)
        over = np.maximum(line + middle[:, None] - state.w, 0.0)
        short = np.einsum("ij,ij->i", widths, over) < area
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return np.asarray(line + low[:, None])
