"""Where a joint is whose edges are welded over: a profile laid on one taken there before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, nan, sin, sqrt, tau
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array, frozen_arrays
from tjscan.core.robust import MAD_TO_SIGMA
from tjscan.crawler.joint_tracking.edge_lines import (
    CAPTURE_SIGMAS,
    DEPTH_OF_FIELD,
    LEAST_BACKGROUND,
    MOST_BACKGROUND,
)
from tjscan.laser.profile import Profile

REFERENCE_PITCH: Final = 0.25e-3
"""Distance of a reference's points, in metres: about the pitch of the sensor's columns."""

SLOPE_POINTS: Final = 7
"""Points over which a reference's slope is taken: its noise must not look like shape."""

MOST_REGISTRATION_ROUNDS: Final = 8
SETTLED_SHIFT: Final = 1e-6
"""Most rounds after the first wide ones, and the move, in metres, from which a fit is final."""

FEWEST_ON_REFERENCE: Final = 40
"""Points that must lie on the reference."""

LEAST_SEEN_SHARE_OF_SIDE: Final = 0.1
"""Share of what each side of a reference shows of its place across that must be left: a bead laid
since hides much of a bevel, but over another joint only the places where outlines cross agree."""

EDGE_SLOPE, EDGE_HALF_WIDTH, LEAST_COVER = 0.3, 1e-3, 0.3e-3
"""Slope from which a reference is a bevel, and metres to both sides of its edge in which a bead
over it stands over the hull by so many metres: no joint that is merely narrower does."""

LEAST_SEEN_SHARE_OF_ONE_SIDE, LEAST_SEEN_SHARE_OF_EDGE = 0.5, 0.9
"""Shares that must be left if a bead covers the edge of the other side, and one alone shows where
the joint is: of what that side shows, or of the points about its edge. Where both edges are welded
over, or over another joint, outlines cross anywhere else."""

LARGEST_CHANGE_ALONG: Final = 0.3e-3
"""Metres by which a reference's bevels may change over the length that it holds for, as a standard
deviation, if one side alone shows where the joint is. At the end of a bead they change by more, and
all points of a side are off alike there, however many agree."""

DEEPER_SIGMAS, FARTHEST_DEEPER = 4.0, 6e-3
"""Standard deviations and metres between which a point lies deeper than the reference as another
joint's would: the arc's light is anywhere, mostly farther."""

MOST_DEEPER_SHARE: Final = 0.2
"""Share of what a side shows that may be deeper: a pass adds steel and takes none away."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointPlacement:
    """Place of a joint in a profile.

    Parameters
    ----------
    centre, hull_z : float
        x_s and z_s of the middle between its top edges, in metres.
    roll : float
        Of the sensor about the forward axis against the hull, in radians, positive if its
        right side is nearer to it.
    centre_sigma : float
        Standard deviation of the centre, in metres.
    shared_sigma : float
        The part of it that all placements on the same reference have in common, in metres.
    """

    centre: float
    hull_z: float
    roll: float
    centre_sigma: float
    shared_sigma: float = 0.0

    @property
    def width(self) -> float:
        """Between the joint's top edges, in metres; NaN if these were not read."""
        return nan

    def joint_coordinates(self, x: Array, z: Array) -> tuple[Array, Array]:
        """Points of a profile, across the joint from its centre and into the hull, in metres."""
        c, s = cos(self.roll), sin(self.roll)
        dx, dz = x - self.centre, z - self.hull_z
        return c * dx - s * dz, s * dx + c * dz


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class ReferenceProfile:
    """What the joint looked like at one place: depth below the hull at even steps across.

    Parameters
    ----------
    across : ndarray, shape (n,)
        From the joint's centre, rising, in metres.
    depth : ndarray, shape (n,)
        Into the hull, in metres.
    slope : ndarray, shape (n,)
        Of the depth.
    noise : ndarray, shape (n,)
        Standard deviation of the depths, with their changes along the joint, in metres.
    centre_sigma : float
        Standard deviation of the centre that the reference was taken with, in metres.
    """

    across: Array
    depth: Array
    slope: Array
    noise: Array
    centre_sigma: float

    @classmethod
    def from_profiles(
        cls, profiles: Sequence[Profile], placements: Sequence[JointPlacement], noise: float
    ) -> ReferenceProfile:
        """Take the median of some profiles of one place.

        Parameters
        ----------
        profiles : sequence of Profile
            Ten or so, taken over the few millimetres along the joint for which the reference
            holds: fewer keep their noise and their arc light.
        placements : sequence of JointPlacement
            Where the joint was read in each.
        noise : float
            Standard deviation of one profile's z, in metres.
        """
        parts = [
            placement.joint_coordinates(profile.x_s[profile.valid], profile.z_s[profile.valid])
            for profile, placement in zip(profiles, placements, strict=True)
        ]
        u, h = (np.concatenate(part) for part in zip(*parts, strict=True))
        cells, index = np.unique(np.round(u / REFERENCE_PITCH).astype(np.intp), return_inverse=True)
        across = REFERENCE_PITCH * np.arange(cells[0], cells[-1] + 1)
        depth = np.interp(across, REFERENCE_PITCH * cells, _medians_by_index(index, h))
        # Within a cell of a steep side depth changes, too.
        aside = u - REFERENCE_PITCH * cells[index]
        level = h - aside * np.interp(u, across, _smoothed_slope(depth))
        middle = _medians_by_index(index, level)
        spread = MAD_TO_SIGMA * _medians_by_index(index, np.abs(level - middle[index]))
        depth, spread = (np.interp(across, REFERENCE_PITCH * cells, v) for v in (middle, spread))
        variance = _convolve_padded(spread**2, np.full(SLOPE_POINTS, 1 / SLOPE_POINTS))
        # A median of independent values is less certain than their mean.
        own = noise**2 * min(0.5 * np.pi / len(placements), 1.0)
        changes = np.maximum(variance - noise**2, 0.0)
        centre_sigma = _sigma_of_mean(placements)
        return cls(across, depth, _smoothed_slope(depth), np.sqrt(own + changes), centre_sigma)


def _sigma_of_mean(placements: Sequence[JointPlacement]) -> float:
    """Standard deviation of the mean of some centres, in metres; what they share stays."""
    total, shared = np.array([(p.centre_sigma, p.shared_sigma) for p in placements]).T
    own = float(np.sum(total**2 - shared**2)) / len(placements) ** 2
    return sqrt(max(own, 0.0) + float(np.mean(shared)) ** 2)


def _smoothed_slope(depth: Array) -> Array:
    """Slope of depths at even steps: of the line through the points about each."""
    window = np.arange(SLOPE_POINTS) - SLOPE_POINTS // 2
    return _convolve_padded(depth, -window / (REFERENCE_PITCH * (window @ window)))


def _convolve_padded(values: Array, window: Array) -> Array:
    padded = np.pad(values, len(window) // 2, mode="edge")
    return np.convolve(padded, window, mode="valid")


def _medians_by_index(index: NDArray[np.intp], values: Array) -> Array:
    """Median of the values of each index, which all occur."""
    order = np.lexsort((values, index))
    first = np.searchsorted(index[order], np.arange(index.max() + 1))
    count = np.bincount(index)
    return np.asarray(values[order][first + count // 2])


def register_profile(
    t: Array, z: Array, reference: ReferenceProfile, start: JointPlacement, noise: float
) -> tuple[JointPlacement, float] | None:
    """Lay a profile on a reference.

    Parameters
    ----------
    t, z : ndarray, shape (n,)
        x over z, and z in metres.
    reference : ReferenceProfile
    start : JointPlacement
        Where the joint was last.
    noise : float
        Standard deviation of z, in metres.

    Returns
    -------
    JointPlacement and float, or None
        Its standard deviation is that of independent noise and of the reference's; and the share
        of the points that lie on the reference. None if too few do, if one side of the
        joint no longer shows where it is and no bead covers its edge, or if steel is gone that the
        reference shows.
    """
    x = t * z
    roll = start.roll
    c, s = cos(roll), sin(roll)
    # The joint's centre in axes along and square to the hull.
    place = np.array((c * start.centre - s * start.hull_z, s * start.centre + c * start.hull_z))
    share = 0.1
    information = np.zeros((3, 3))
    for k in range(len(CAPTURE_SIGMAS) + MOST_REGISTRATION_ROUNDS):
        sigma = max(CAPTURE_SIGMAS[k], noise) if k < len(CAPTURE_SIGMAS) else noise
        c, s = cos(roll), sin(roll)
        level, deep = c * x - s * z, s * x + c * z
        u = level - place[0]
        slope = np.interp(u, reference.across, reference.slope)
        away = deep - place[1] - np.interp(u, reference.across, reference.depth)
        rough = np.interp(u, reference.across, reference.noise)
        spread = np.hypot(sigma * (s * t + c - slope * (c * t - s)), rough)
        odds = share / (1 - share) * sqrt(tau) * spread / DEPTH_OF_FIELD
        bell = np.exp(-0.5 * np.minimum((away / spread) ** 2, 100.0))
        weight = bell / (bell + odds)
        weight[(u < reference.across[0]) | (u > reference.across[-1])] = 0.0
        if weight.sum() < FEWEST_ON_REFERENCE:
            return None
        share = min(max(1 - float(weight.mean()), LEAST_BACKGROUND), MOST_BACKGROUND)
        jacobian = np.stack((slope, -np.ones_like(u), level + slope * deep), axis=1)
        weighted = jacobian * (weight / spread**2)[:, None]
        information = weighted.T @ jacobian
        try:
            step = np.linalg.solve(information, -(weighted.T @ away))
        except np.linalg.LinAlgError:
            return None
        place += step[:2]
        roll += float(step[2])
        if k >= len(CAPTURE_SIGMAS) and np.abs(step[:2]).max() < SETTLED_SHIFT:
            break
    shift_information = (slope / spread) ** 2
    seen = []
    for side in (u < 0, u > 0):
        side_total = shift_information[side].sum()
        seen.append(weight[side] @ shift_information[side] / max(side_total, 1e-12))
        if seen[-1] < LEAST_SEEN_SHARE_OF_SIDE:
            over_edge = (place[1] - deep)[side & _is_near_edge(u, reference)]
            if not (len(over_edge) and np.median(over_edge) > LEAST_COVER):
                return None
        deeper = (away[side] > DEEPER_SIGMAS * spread[side]) & (away[side] < FARTHEST_DEEPER)
        if shift_information[side] @ deeper > MOST_DEEPER_SHARE * side_total:
            return None
    if min(seen) < LEAST_SEEN_SHARE_OF_SIDE:
        changes = reference.noise[np.abs(reference.slope) > EDGE_SLOPE]
        is_steady = len(changes) > 0 and np.median(changes) < LARGEST_CHANGE_ALONG
        shown = weight[_is_near_edge(u, reference) & ((u > 0) == (seen[1] > seen[0]))]
        is_shown = max(seen) > LEAST_SEEN_SHARE_OF_ONE_SIDE or (
            max(seen) > LEAST_SEEN_SHARE_OF_SIDE
            and np.sum(shown) > LEAST_SEEN_SHARE_OF_EDGE * len(shown)
        )
        if not (is_shown and is_steady):
            return None
    c, s = cos(roll), sin(roll)
    centre, hull_z = float(c * place[0] + s * place[1]), float(c * place[1] - s * place[0])
    moves = np.array((c, s, hull_z))
    # What differs from the reference by more than noise makes the centre less certain, too.
    excess = max(float(weight @ (away / spread) ** 2) / float(weight.sum()), 1.0)
    variance = excess * float(moves @ np.linalg.solve(information, moves))
    found = JointPlacement(
        centre=centre,
        hull_z=hull_z,
        roll=roll,
        centre_sigma=sqrt(max(variance, 0.0) + reference.centre_sigma**2),
        shared_sigma=reference.centre_sigma,
    )
    return found, 1 - share


def _is_near_edge(u: Array, reference: ReferenceProfile) -> NDArray[np.bool_]:
    """Which places across from the joint's centre, in metres, are near a reference's top edges."""
    bevels = reference.across[np.abs(reference.slope) > EDGE_SLOPE]
    edges = [bevels.min(initial=0.0), bevels.max(initial=0.0)]
    return np.asarray(np.abs(np.subtract.outer(u, edges)).min(axis=1) < EDGE_HALF_WIDTH)
