"""A look at a groove that is partly filled: profiles become a surface over its first sections."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation, Slerp

from tjscan.core.frames import Array, Mask, array_dataclass, pose, transform_points
from tjscan.planning.path import GrooveStations

COLUMN_STEP: Final = 0.25e-3
"""Between two columns of a surface, metres."""

SMOOTHED_POINTS: Final = 5
"""Neighbouring points of a profile whose median counts: spatter is narrower."""

WIDEST_GAP: Final = 1.5e-3
"""Between two points of a profile, over which its surface is not known, metres."""

DEEPEST_POINT: Final = 0.8e-3
"""Metres that a point may lie below where steel was before, square to it: what lies deeper is the
mirror image of another face."""

COMPARED_PROFILES: Final = 5
"""Neighbouring profiles from whose median a column may not lie lower by that: mirror images are in
other columns of each."""

LEAST_SEEN_SHARE: Final = 0.95
"""Of a section's columns between its toes, for it to count as read."""

LEAST_HEIGHT_SIGMA: Final = 0.02e-3
"""Standard deviation of heights that no look falls below, metres."""

FARTHEST_FACE: Final = 0.1
"""Metres beyond its corners to which a groove's faces are taken to go on."""


@array_dataclass
class SurfaceLook:
    """What a look shows at n stations.

    Parameters
    ----------
    u : ndarray, shape (k,)
        Columns across the groove, metres.
    w : ndarray, shape (n, k)
        Heights, metres.
    sigma : ndarray, shape (n,)
        Standard deviation of the heights, metres.
    read : ndarray of bool, shape (n,)
        Stations at which it was read.
    """

    u: Array
    w: Array
    sigma: Array
    read: Mask


def interpolate_poses(poses: Sequence[Array], step: float) -> Iterator[Array]:
    """Poses along a way from pose to pose, shape (4, 4) each, with the stated ones among them.

    Parameters
    ----------
    poses : sequence of ndarray, shape (4, 4)
        Two or more.
    step : float
        Between two of them at most, metres.
    """
    for a, b in pairwise(poses):
        count = max(1, int(np.ceil(np.linalg.norm(b[:3, 3] - a[:3, 3]) / step)))
        turn = Slerp((0.0, 1.0), Rotation.from_matrix(np.stack((a[:3, :3], b[:3, :3]))))
        for share in np.arange(count) / count:
            yield pose(turn(share).as_matrix(), (1 - share) * a[:3, 3] + share * b[:3, 3])
    yield poses[-1]


def place_in_sections(stations: GrooveStations, points: Array) -> tuple[Array, Array]:
    """Where points are along a groove, and in its sections.

    Parameters
    ----------
    stations : GrooveStations
        Close to each other.
    points : ndarray, shape (k, 3)
        In their frame, metres.

    Returns
    -------
    s : ndarray, shape (k,)
        Metres; NaN for one before the first station or behind the last.
    places : ndarray, shape (k, 2)
        Across and up, metres.
    """
    away = points[:, None] - stations.origin
    along = np.einsum("kni,ni->kn", away, stations.tangent)
    distance = np.einsum("kni,kni->kn", away, away)
    passes = (along[:, :-1] >= 0) & (along[:, 1:] < 0)
    i = np.where(passes, distance[:, :-1], np.inf).argmin(axis=1)
    k = np.arange(len(points))
    share = along[k, i] / (along[k, i] - along[k, i + 1])
    axes = np.stack((stations.across, stations.up), axis=1)
    ends = [np.einsum("ki,kji->kj", away[k, j], axes[j]) for j in (i, i + 1)]
    s = stations.s[i] + share * (stations.s[i + 1] - stations.s[i])
    places = ends[0] + share[:, None] * (ends[1] - ends[0])
    return np.where(passes.any(axis=1), s, np.nan), places


@array_dataclass
class SteelBefore:
    """Where steel was before, at n stations: weld metal only adds to it.

    Parameters
    ----------
    u, w : ndarray, shape (n, k)
        Metres, u growing.
    """

    u: Array
    w: Array

    @classmethod
    def of_corners(cls, stations: GrooveStations) -> SteelBefore:
        """The bare groove: its corners, the leg beyond, and nothing lower than the bevel's top."""
        p3, p4, g, p2 = np.moveaxis(stations.corners, 1, 0)
        far = FARTHEST_FACE * (g - p4) / np.linalg.norm(g - p4, axis=1, keepdims=True)
        beyond = p2 - (FARTHEST_FACE, 0.0)
        nodes = np.stack((beyond, p2, p3, p4, g, g + far), axis=1)
        return cls(nodes[:, :, 0], nodes[:, :, 1])

    def is_below(self, row: int, across: Array, up: Array) -> Mask:
        """Whether points at a station lie too deep to be of steel, shape (k,)."""
        u, w = self.u[row], self.w[row]
        slope = np.diff(w) / np.diff(u)
        at = np.clip(np.searchsorted(u, across) - 1, 0, len(slope) - 1)
        depth = np.interp(across, u, w) - up
        return np.asarray(depth > DEEPEST_POINT * np.hypot(1.0, slope[at]))


def surface_of_profiles(
    stations: GrooveStations,
    profiles: Sequence[Array],
    u: Array,
    toes_u: Array,
    step: float,
    before: SteelBefore,
) -> SurfaceLook:
    """Make a surface of profiles.

    Parameters
    ----------
    stations : GrooveStations
        At which it is wanted.
    profiles : sequence of ndarray, shape (k, 3)
        Points of each profile in their order, in the stations' frame; metres.
    u : ndarray, shape (m,)
        Columns, metres.
    toes_u : ndarray, shape (n, 2)
        Of the finished weld at each station: a station is read if the columns between are.
    step : float
        Between two profiles, metres: farther from any, nothing is known.
    before : SteelBefore
    """
    rows = [_profile_over_columns(stations, points, u, before) for points in profiles]
    at, height = (np.array([row[j] for row in rows]) for j in range(2))
    height[_is_lower_than_neighbours(height, u)] = np.nan
    n, m = len(stations.s), len(u)
    w, seen = np.full((n, m), np.nan), np.zeros((n, m), dtype=bool)
    for j in range(m):
        known = np.isfinite(at[:, j]) & np.isfinite(height[:, j])
        if known.sum() >= 2:
            order = np.argsort(at[known, j])
            places, heights = at[known, j][order], height[known, j][order]
            w[:, j] = np.interp(stations.s, places, heights)
            after = np.clip(np.searchsorted(places, stations.s), 1, len(places) - 1)
            gap = places[after] - places[after - 1]
            outside = np.maximum(places[0] - stations.s, stations.s - places[-1])
            seen[:, j] = (gap < 2.5 * step) & (outside < step)
    between = (u >= toes_u[:, :1]) & (u <= toes_u[:, 1:])
    read = (seen & between).sum(axis=1) >= LEAST_SEEN_SHARE * between.sum(axis=1)
    for row, known_row in zip(w, seen & np.isfinite(w), strict=True):
        if known_row.any():
            row[~known_row] = np.interp(u[~known_row], u[known_row], row[known_row])
    return SurfaceLook(u, np.nan_to_num(w), np.full(n, _height_sigma(height)), read)


def _profile_over_columns(
    stations: GrooveStations, points: Array, u: Array, before: SteelBefore
) -> tuple[Array, Array]:
    """Place along the groove and height of a profile at columns; NaN where it shows nothing."""
    s, places = place_in_sections(stations, points)
    inside = (
        np.isfinite(s) & (places[:, 0] > u[0] - WIDEST_GAP) & (places[:, 0] < u[-1] + WIDEST_GAP)
    )
    s, places = s[inside], places[inside]
    if len(s):
        row = int(np.abs(stations.s - np.median(s)).argmin())
        steel = ~before.is_below(row, *places.T)
        s, places = s[steel], places[steel]
    if len(s) < SMOOTHED_POINTS:
        return np.full(len(u), np.nan), np.full(len(u), np.nan)
    order = np.argsort(places[:, 0], kind="stable")
    s, across, up = s[order], places[order, 0], places[order, 1]
    up = median_filter(up, SMOOTHED_POINTS, mode="nearest")
    after = np.clip(np.searchsorted(across, u), 1, len(across) - 1)
    hidden = across[after] - across[after - 1] > WIDEST_GAP
    hidden |= (u < across[0]) | (u > across[-1])
    return (
        np.where(hidden, np.nan, np.interp(u, across, s)),
        np.where(hidden, np.nan, np.interp(u, across, up)),
    )


def _is_lower_than_neighbours(height: Array, u: Array) -> Mask:
    """Which columns of profiles, shape (p, m), lie far below those of the profiles beside them."""
    half = COMPARED_PROFILES // 2
    padded = np.pad(height, ((half, half), (0, 0)), constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, COMPARED_PROFILES, axis=0)
    with warnings.catch_warnings():  # a column that no profile shows has no median
        warnings.simplefilter("ignore", RuntimeWarning)
        middle = np.nanmedian(windows, axis=2)
    slope = np.gradient(middle, u, axis=1)
    limit = DEEPEST_POINT * np.hypot(1.0, np.nan_to_num(slope))
    return np.asarray(middle - height > limit)


def _height_sigma(height: Array) -> float:
    """Standard deviation of heights, from what each profile differs from its neighbours."""
    off = height[1:-1] - 0.5 * (height[:-2] + height[2:])
    off = np.abs(off[np.isfinite(off)])
    spread = float(1.4826 * np.median(off) / np.sqrt(1.5)) if len(off) else 0.0
    return max(spread, LEAST_HEIGHT_SIGMA)


def points_of_profile(points_s: Array, T_r_s: Array) -> Array:
    """Valid points of a profile, (n, 2) in the laser's frame, in the frame r, shape (k, 3)."""
    known = points_s[np.isfinite(points_s).all(axis=1)]
    return transform_points(
        T_r_s, np.column_stack((known[:, 0], np.zeros(len(known)), known[:, 1]))
    )
