"""Cross-sections of the joint: after each pass, and where a crawl ended, to find it again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from tjscan.core.errors import CrawlStopped
from tjscan.core.frames import Array
from tjscan.crawler.journal import CrawlCycle, is_by_hand
from tjscan.crawler.phases import Phase
from tjscan.crawler.slip_estimator import MOST_SIDEWAYS_SHARE
from tjscan.laser.profile import Profile

PLACES_ACROSS: Final = np.arange(-0.030, 0.030001, 0.25e-3)
"""Places across the joint, metres."""

PROFILES_COMPARED: Final = 10
"""Last profiles that are compared: the median of as many shows no light of the arc."""

FEET_YIELD: Final = 1e-3
"""Metres by which the feet of a vehicle at rest may give way."""

BRAKING_TIME, COASTING_TIME = 0.1, 1.0
"""Seconds for which a vehicle goes on that was stopped, and one whose program was killed: half of
them were not yet on the disk, and the others are its dead-man's."""

HEIGHT_CHANGE, CHANGED_SHARE = 0.3e-3, 0.1
"""Another place, or another joint, is off by more metres in more than this share of the section:
five times the noise of one point of the paper's sensor."""

MOST_UNEVENNESS_WHEN_FILLED, WIDEST_LIGHT = 2e-3, 6e-3
"""Metres off the hull, more than crown and high-low, by which a filled joint may be; and how far
its level places may be from one another: the light of an arc is not as wide as a groove."""

FARTHEST_NEIGHBOURS: Final = 2e-3
"""Metres between neighbouring points of one surface, at most."""


@dataclass(frozen=True, slots=True, eq=False)
class LastView:
    """The joint as the laser last saw it.

    Parameters
    ----------
    d : float
        Laser minus joint, metres.
    section : ndarray, shape (m,)
        Height over the hull at each place of `PLACES_ACROSS`, metres.
    way : float
        By which the vehicle may have gone on since, metres.
    """

    d: float
    section: Array
    way: float

    @classmethod
    def of_recording(cls, cycles: Sequence[CrawlCycle], *, stopped: bool) -> Self | None:
        """What a recording ends with; None if the joint was not seen any more.

        Parameters
        ----------
        cycles : sequence of CrawlCycle
            In which it crawled, not driven by hand.
        stopped : bool
            Whether it ends with a stop; else the program was killed.
        """
        read = [cycle for cycle in cycles if cycle.was_read]
        seen = [(cycle.d, cycle.profile) for cycle in read if cycle.profile is not None]
        section = median_section(seen)
        if not read or section is None:
            return None
        last = cycles[-1]
        way = abs(last.travel - read[-1].travel)
        way += abs(last.state.odometry.speed) * (BRAKING_TIME if stopped else COASTING_TIME)
        return cls(read[-1].d, section, way)

    def check(self, seen: Sequence[tuple[float, Profile]]) -> None:
        """Check that the vehicle was not moved.

        Parameters
        ----------
        seen : sequence of (float, Profile)
            What the laser shows now: laser minus joint, metres, and the profile.

        Raises
        ------
        CrawlStopped
            If the joint is elsewhere in the laser's line, or looks different.
        """
        aside = float(np.median([d for d, _ in seen])) - self.d
        if abs(aside) > FEET_YIELD + MOST_SIDEWAYS_SHARE * self.way:
            raise _moved_error(f"the laser is {1e3 * abs(aside):.1f} mm aside of where it was")
        section = median_section(seen)
        if section is None:
            return
        known = np.isfinite(section) & np.isfinite(self.section)
        off = np.abs(section - self.section)[known] > HEIGHT_CHANGE
        if np.mean(off) > CHANGED_SHARE:
            raise _moved_error("the joint looks different from the place where the crawl ended")


def median_section(seen: Sequence[tuple[float, Profile]]) -> Array | None:
    """Median of the last sections of the joint; None if none shows the hull."""
    heights = [height_over_hull(profile, d) for d, profile in seen[-PROFILES_COMPARED:]]
    rows = [height for height in heights if height is not None]
    if not rows:
        return None
    return _median_of_seen(rows)


def _median_of_seen(rows: Sequence[Array]) -> Array:
    with np.errstate(all="ignore"):
        return np.asarray(np.nanmedian(rows, axis=0))


def _moved_error(evidence: str) -> CrawlStopped:
    return CrawlStopped(
        "moved",
        f"{evidence}: the vehicle was moved since, and its place along the joint is not known. "
        "Set it back, or state the place of the torch with --place",
    )


def section_histories(
    profiles: Iterable[tuple[CrawlCycle, Profile]], length: float, laser_to_torch: float
) -> dict[int, Array]:
    """Median cross-section of the joint after each pass: figure 10 of Kermorgant (2018).

    All are registered on the joint's centre.

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
        `PLACES_ACROSS`, metres; NaN if nothing was seen.
    """
    heights: dict[int, list[Array]] = {}
    d = np.nan
    for cycle, profile in profiles:
        # A filled joint is not read: the vehicle is about as far aside as where it last was.
        d = cycle.d if cycle.was_read or is_by_hand(cycle.phase, cycle.commanded) else d
        if not 0 <= cycle.travel + laser_to_torch <= length or np.isnan(d):
            continue
        welded = cycle.number - (cycle.phase is Phase.WELDING)
        height = height_over_hull(profile, d)
        if height is not None:
            heights.setdefault(welded, []).append(height)
    return {number: _median_of_seen(rows) for number, rows in sorted(heights.items())}


def shows_filled_joint(profile: Profile) -> bool:
    """Whether a profile shows even steel from plate to plate, but for the light of an arc."""
    height = height_over_hull(profile, 0.0)
    if height is None:
        return False
    # Between points that are far apart nothing shows how high the steel is.
    across = np.sort(profile.x_s[profile.valid])
    behind = across.searchsorted(PLACES_ACROSS).clip(1, len(across) - 1)
    seen = across[behind] - across[behind - 1] < FARTHEST_NEIGHBOURS
    level = PLACES_ACROSS[seen & (np.abs(height) < MOST_UNEVENNESS_WHEN_FILLED)]
    ends = PLACES_ACROSS[[0, -1]]
    gaps = np.diff(np.concatenate((ends[:1], level, ends[1:])))
    return float(gaps.max()) < WIDEST_LIGHT


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
