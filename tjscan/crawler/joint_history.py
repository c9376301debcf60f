"""Cross-sections of the joint, pass by pass: figure 10 of Kermorgant (2018)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.phases import Phase
from tjscan.laser.profile import Profile

GRID: Final = np.arange(-0.030, 0.030001, 0.25e-3)
"""Places across the joint, metres."""


def section_histories(
    profiles: Iterable[tuple[CrawlCycle, Profile]], length: float, laser_to_torch: float
) -> dict[int, Array]:
    """Median cross-section of the joint after each pass, registered on the joint's centre.

    The laser, ahead of the torch, sees what a pass left on the way back from it and on the way to
    the next one. The paper draws means; a median is not moved by the arc's light.

    Parameters
    ----------
    profiles : iterable of (CrawlCycle, Profile)
        As recorded.
    length : float
        Of the weld, metres: profiles beside it do not count.
    laser_to_torch : float
        How far the laser is ahead of the torch, metres.

    Returns
    -------
    dict of int to ndarray, shape (m,)
        For each number of passes that were welded, height over the hull at each place of `GRID`,
        metres; NaN where nothing was seen.
    """
    heights: dict[int, list[Array]] = {}
    for cycle, profile in profiles:
        ahead = cycle.travel + laser_to_torch
        if not 0 <= ahead <= length or not np.isfinite(cycle.d):
            continue
        welded = cycle.number - (cycle.phase is Phase.WELDING)
        valid = profile.valid
        across, z = profile.x_s[valid] + cycle.d, profile.z_s[valid]
        hull = np.abs(across) > GRID[-1] * 0.6
        if np.count_nonzero(hull) < 2:
            continue
        level = np.polynomial.Polynomial.fit(across[hull], z[hull], 1)
        height = np.interp(GRID, across, level(across) - z, left=np.nan, right=np.nan)
        heights.setdefault(welded, []).append(height)
    with np.errstate(all="ignore"):
        return {number: np.nanmedian(rows, axis=0) for number, rows in sorted(heights.items())}
