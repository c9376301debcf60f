"""Cross-sections of the joint, pass by pass: figure 10 of Kermorgant (2018)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.phases import Phase
from tjscan.laser.profile import Profile

PLACES_ACROSS: Final = np.arange(-0.030, 0.030001, 0.25e-3)
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
        For each number of passes that were welded, height over the hull at each place of
        `PLACES_ACROSS`, metres; NaN where nothing was seen.
    """
    heights: dict[int, list[Array]] = {}
    for cycle, profile in profiles:
        ahead = cycle.travel + laser_to_torch
        if not 0 <= ahead <= length or not np.isfinite(cycle.d):
            continue
        welded = cycle.number - (cycle.phase is Phase.WELDING)
        height = height_over_hull(profile, cycle.d)
        if height is not None:
            heights.setdefault(welded, []).append(height)
    with np.errstate(all="ignore"):
        return {number: np.nanmedian(rows, axis=0) for number, rows in sorted(heights.items())}


def height_over_hull(profile: Profile, d: float) -> Array | None:
    """Height over the hull at `PLACES_ACROSS`, metres; None if the hull is not seen.

    Parameters
    ----------
    profile : Profile
    d : float
        Laser minus joint, metres.
    """
    valid = profile.valid
    across, z = profile.x_s[valid] + d, profile.z_s[valid]
    sides = (across < -PLACES_ACROSS[-1] * 0.6, across > PLACES_ACROSS[-1] * 0.6)
    if not all(map(np.any, sides)):
        return None
    # A line through the middle of each side, which the light of an arc does not move.
    (x0, z0), (x1, z1) = ((np.median(across[side]), np.median(z[side])) for side in sides)
    level = z0 + (z1 - z0) / (x1 - x0) * (across - x0)
    return np.asarray(np.interp(PLACES_ACROSS, across, level - z, left=np.nan, right=np.nan))
