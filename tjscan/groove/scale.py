"""Mill scale on a groove's outer sides: two levels a step apart, of which the farther is the steel.

Scale lies in patches, a few tenths of a millimetre proud, with bare steel between. One side often
shows too little of either level to tell a patch from its own bend: how thick scale is and how far
the side bends is known better from the sections before.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, inf, log, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove.curves import CubicCurve
from tjscan.groove.fitted_profile import (
    LEAST_NOISE,
    OUTLIER_SIGMAS,
    FittedProfile,
    OrderedProfilePoints,
    estimate_noise_correlation,
)
from tjscan.groove.models import SideModel
from tjscan.groove.prior import SCALE_THICKNESSES

SCALE_BLOCK: Final = 6
"""Points that are averaged."""

FEWEST_BLOCKS_OF_SIDE: Final = 5
"""Blocks of a side that say something."""

SURFACE_REACH: Final = 1.0e-3
"""Points this near a side, in metres, are of its surface or of what lies on it."""

BLOCK_UNDULATION: Final = 0.02e-3
"""Standard deviation, in metres, of a block of points beyond noise: no surface is a parabola."""

STEEPEST_STEEL: Final = 0.06
"""Slope against the fitted side that the steel under scale may have."""

TRIED_BENDS: Final = np.linspace(-1.5, 1.5, 7)
WIDEST_BEND: Final = 1.0
"""Bends that are tried, in standard deviations about the expected one; and the largest one of
these, in 1/m, with which a side is looked at."""

MOST_TRIED_LINES: Final = 80
"""Lines that are tried."""

STRAY_COST: Final = 9.0
"""What a block costs that lies on neither level, in squared standard deviations."""

COVERED_SHARE: Final = 0.35
PATCH_WIDTH: Final = 12e-3
"""Share of a surface that scale covers, and about how wide its patches are, in metres:
assumptions, after what tubes show that have lain in a yard."""

BLOCK_WEIGHT: Final = 0.5
"""Weight of a block's evidence: neighbours undulate together."""

STEEL_ROUNDS: Final = 5


@dataclass(frozen=True, slots=True, eq=False)
class TwoLevels:
    """One side looked at as two levels of surface.

    Parameters
    ----------
    base : CubicCurve
        Tangent of the fitted side, from which s and heights count.
    costs : ndarray, shape (n, l)
        What each of l surfaces costs with each of `SCALE_THICKNESSES`, in squared standard deviations.
    surfaces : ndarray, shape (l, 3)
        Coefficients of their heights behind the tangent, in powers of s.
    sigma : float
        Standard deviation of a block of points, in metres.
    along, heights : ndarray, shape (m,)
        Of the side's points, moved back from where light pulls them; in metres.
    expected_bend, bend_sigma : float
        Of the side, in 1/m.
    """

    base: CubicCurve
    costs: Array
    surfaces: Array
    sigma: float
    along: Array
    heights: Array
    expected_bend: float
    bend_sigma: float

    @property
    def log_likelihoods(self) -> Array:
        """Log-likelihood of each of `SCALE_THICKNESSES`, shape (n,)."""
        least = self.costs.min(axis=1)
        return np.asarray(-0.5 * BLOCK_WEIGHT * (least - least[0]))

    def height_variance(self, thickness: float, s: float) -> float:
        """Mean square by which other likely surfaces lie off the likeliest one at s, in m²."""
        cost = self.costs[int(np.abs(SCALE_THICKNESSES - thickness).argmin())]
        best = int(cost.argmin())
        likely = np.exp(-0.5 * BLOCK_WEIGHT * (cost - cost[best]))
        away = (self.surfaces - self.surfaces[best]) @ np.array((1.0, s, s * s))
        return float(likely @ away**2 / likely.sum())

    def find_steel(self, thickness: float) -> Steel:
        """Which points lie on scale of a thickness in metres, and where the steel is."""
        cost = self.costs[int(np.abs(SCALE_THICKNESSES - thickness).argmin())]
        surface = self.surfaces[int(cost.argmin())]
        basis = np.stack((np.ones_like(self.along), self.along, self.along**2))
        expected = np.array((0.0, 0.0, self.expected_bend))
        known = np.diag((0.0, 0.0, self.bend_sigma**-2))
        for _ in range(STEEL_ROUNDS):
            off = self.heights - surface @ basis
            on_scale = (np.abs(off + thickness) < np.abs(off)) & (thickness > 0)
            raised = np.where(on_scale, self.heights + thickness, self.heights)
            used = np.abs(raised - surface @ basis) < OUTLIER_SIGMAS * self.sigma
            if np.count_nonzero(used) < FEWEST_BLOCKS_OF_SIDE * SCALE_BLOCK:
                break
            # A block's standard deviation is that of a mean: its points count as one.
            weighted = basis[:, used] / (SCALE_BLOCK * self.sigma**2)
            information, seen = weighted @ basis[:, used].T, weighted @ raised[used]
            surface = np.linalg.solve(information + known, seen + known @ expected)
        else:
            alone = np.linalg.inv(information)
            bend, sigma = float((alone @ seen)[2]), sqrt(max(float(alone[2, 2]), 0.0))
            return Steel(on_scale, self._curve(surface), bend, sigma)
        return Steel(on_scale, self._curve(surface), self.expected_bend, inf)

    def _curve(self, surface: Array) -> CubicCurve:
        c0, c1, c2 = surface.tolist()
        return self.base._replace(c0=c0, c1=c1, c2=c2)


@dataclass(frozen=True, slots=True, eq=False)
class Steel:
    """Where the steel of a side is.

    Parameters
    ----------
    on_scale : ndarray of bool, shape (m,)
        Which of the side's points lie on scale.
    curve : CubicCurve
        The steel.
    bend, bend_sigma : float
        Its bend as the points alone show it and the standard deviation, in 1/m; infinite where
        they show none.
    """

    on_scale: NDArray[np.bool_]
    curve: CubicCurve
    bend: float
    bend_sigma: float


def find_two_levels(
    row: OrderedProfilePoints,
    fitted: FittedProfile,
    k: int,
    side: SideModel,
    pulled: Array,
) -> TwoLevels | None:
    """Look at an outer side as two levels; None where it shows too little.

    Parameters
    ----------
    row : OrderedProfilePoints
    fitted : FittedProfile
    k : int
        Number of the side.
    side : SideModel
        What it is like.
    pulled : ndarray, shape (n,)
        How far light seems to pull each of the row's points, square to its side, in metres.
    """
    own = fitted.points_of(k)
    near = np.flatnonzero(np.abs(fitted.residuals[own]) < SURFACE_REACH)
    count = len(near) // SCALE_BLOCK
    if count < FEWEST_BLOCKS_OF_SIDE:
        return None
    base = fitted.curves[k].rebased_at_tangent(fitted.middles[k])
    s, d = base.local_coordinates(row.points[own])
    d = d + pulled[own] - base.c3 * s**3
    blocks = near[: count * SCALE_BLOCK].reshape(count, SCALE_BLOCK)
    along, heights = s[blocks].mean(axis=1), np.median(d[blocks], axis=1)
    noise = fitted.noise or estimate_noise_correlation(row, fitted)
    least = max(float(fitted.sigmas.min()), LEAST_NOISE)
    sigma = hypot(least * sqrt(min(noise.variance_inflation / SCALE_BLOCK, 1.0)), BLOCK_UNDULATION)
    known = side.expected_bend is not None or side.bend < WIDEST_BEND
    expected = (side.expected_bend or 0.0) if known else base.c2
    bend_sigma = min(side.bend, WIDEST_BEND)
    i, j = np.triu_indices(count, max(2, count // 4))
    every = -(-len(i) // MOST_TRIED_LINES)
    i, j = i[::every], j[::every]
    bends = expected + bend_sigma * TRIED_BENDS
    flat = heights - bends[:, None] * along**2
    slope = (flat[:, j] - flat[:, i]) / (along[j] - along[i])
    level = flat[:, i] - slope * along[i]
    usual = np.abs(slope) < STEEPEST_STEEL
    which, line = usual.nonzero()
    if not len(which):
        return None
    surfaces = np.column_stack((level[which, line], slope[which, line], bends[which]))
    # What was fitted is one of them: between the bends that are tried it may fit much better.
    surfaces = np.vstack((surfaces, (base.c0, base.c1, base.c2)))
    off = heights - surfaces @ np.stack((np.ones_like(along), along, along**2))
    costs = _costs(off / sigma, SCALE_THICKNESSES / sigma, along)
    costs += ((surfaces[:, 2] - expected) / bend_sigma) ** 2
    return TwoLevels(base, costs, surfaces, sigma, s, d, expected, bend_sigma)


def _costs(off: Array, steps: Array, along: Array) -> Array:
    """What surfaces cost, shape (n, l), whose blocks, shape (l, b), lie so far behind them."""
    bare = off**2
    pitch = abs(float(np.median(np.diff(along)))) / PATCH_WIDTH
    seldom = max(-2 * log(pitch), 0.0)
    found = np.empty((len(steps), len(off)))
    found[0] = np.minimum(bare, STRAY_COST).sum(axis=1)
    for k, step in enumerate(steps[1:].tolist(), 1):
        raised = (off + step) ** 2
        on_scale = raised < bare
        pays = np.minimum(np.minimum(raised, bare), STRAY_COST)
        seen = pays < STRAY_COST
        change = (on_scale[:, 1:] != on_scale[:, :-1]) & seen[:, 1:] & seen[:, :-1]
        begins = np.where((on_scale & seen)[:, 0], log(COVERED_SHARE), log(1 - COVERED_SHARE))
        found[k] = pays.sum(axis=1) + seldom * change.sum(axis=1) - 2 * begins
    return found
