"""Where a joint is whose edges are welded over: a profile laid on one taken there before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, hypot, isfinite, isnan, nan, sin, sqrt, tau
from statistics import median
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

LEAST_SEEN_SHARE_OF_SIDE, LARGEST_SHARE_OF_HIDDEN_SIDE = 0.13, 0.3
"""Share of what each side of a reference shows of its place across that must be left: a bead laid
since hides much of a bevel, but over another joint only the places where outlines cross agree. And
up to which a side counts as hidden: where a bead's outline crosses it, it agrees by chance, by up
to 1 mm wrong, and alike over the length of a reference."""

EDGE_SLOPE, BEVEL_SLOPE, EDGE_HALF_WIDTH, LEAST_COVER = 0.3, 0.8, 1e-3, 0.2e-3
"""Slope from which a reference is no plate, and from which no bead's toe; and metres to both sides
of a place at its edge or inside of it where a bead that hides the edge stands over the plate by so
many metres: no joint that is merely narrower does."""

DEPTH_OF_EDGE: Final = 1e-3
"""Below the plate, metres, down to which a bevel shows where its edge is by its slope."""

LEAST_SEEN_SHARE_OF_ONE_SIDE, LEAST_SEEN_SHARE_OF_EDGE = 0.5, 0.9
"""Shares that must be left if a bead covers the edge of the other side, and one alone shows where
the joint is: of what that side shows, or of the points about its edge, if a bevel ends there. Where
both edges are welded over, or over another joint, outlines cross anywhere else."""

LARGEST_CHANGE_ALONG: Final = 0.3e-3
"""Metres by which what slopes in a reference may change along the length that it is of, as a
standard deviation, if one side alone shows where the joint is. Where a bead ends it changes by
more, and all points of a side are off alike, however many agree."""

LEAST_CLOSING, UNKNOWN_CLOSING = 0.02e-3, 0.1e-3
"""Metres by which a pass closes the joint, as a standard deviation: no less than the edges are
read to, and before a pass has shown it."""

DEEPER_SIGMAS, FARTHEST_DEEPER = 4.0, 6e-3
"""Standard deviations and metres between which a point lies deeper than the reference as another
joint's would: the arc's light is anywhere, mostly farther."""

STRAY_DEPTH: Final = 0.5e-3
"""Metres from a reference by which a point of its own profiles counts as no farther: spatter."""

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
    lone_sigma : float
        Standard deviation of this placement alone, where that of the centre is of what it adds to
        those before it, in metres; else 0.
    """

    centre: float
    hull_z: float
    roll: float
    centre_sigma: float
    shared_sigma: float = 0.0
    lone_sigma: float = 0.0

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
    change : ndarray, shape (n,)
        Of the depth for each metre along the joint.
    noise : ndarray, shape (n,)
        Standard deviation of the depths, with their changes along the joint, in metres.
    wander : ndarray, shape (2,)
        By how much the left and the right side go to and fro across the joint from one profile to
        the next, as a standard deviation, metres: a bead's toe does.
    centre_sigma : float
        Standard deviation of the centre that the reference was taken with, in metres.
    width : float
        Between the top edges when they were last read here, in metres; NaN if they never were.
    closing : float
        By how much the joint may have closed since, as a standard deviation, in metres: by as much
        as the pass before it closed it, for each pass closes it less.
    """

    across: Array
    depth: Array
    slope: Array
    change: Array
    noise: Array
    wander: Array
    centre_sigma: float
    width: float
    closing: float

    @classmethod
    def from_profiles(
        cls,
        profiles: Sequence[Profile],
        placements: Sequence[JointPlacement],
        noise: float,
        before: ReferenceProfile | None = None,
        beyond: Array | float = 0.0,
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
        before : ReferenceProfile, optional
            What the joint looked like here a pass before.
        beyond : float or ndarray, shape (k,), optional
            How far beyond the place along the joint each is, in metres.
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
        # A bead rises and falls along the joint, and more than elsewhere where it ends.
        counts = [len(part[0]) for part in parts]
        along = np.repeat(np.broadcast_to(beyond, len(parts)), counts)
        change = np.interp(across, REFERENCE_PITCH * cells, _changes_along(index, along, level))
        change = _convolve_padded(change, np.full(SLOPE_POINTS, 1 / SLOPE_POINTS))
        level -= along * np.interp(u, across, change)
        middle = _medians_by_index(index, level)
        spread = MAD_TO_SIGMA * _medians_by_index(index, np.abs(level - middle[index]))
        depth, spread = (np.interp(across, REFERENCE_PITCH * cells, v) for v in (middle, spread))
        variance = _convolve_padded(spread**2, np.full(SLOPE_POINTS, 1 / SLOPE_POINTS))
        # A median of independent values is less certain than their mean.
        own = noise**2 * min(0.5 * np.pi / len(placements), 1.0)
        changes = np.maximum(variance - noise**2, 0.0)
        slope, centre_sigma = _smoothed_slope(depth), _sigma_of_mean(placements)
        # What each profile shows of either side is laid on the reference for itself.
        side = 2 * np.repeat(np.arange(len(parts)), counts) + (u > 0)
        lever = np.interp(u, across, slope)
        off = np.clip(level - middle[index], -STRAY_DEPTH, STRAY_DEPTH)
        information = np.bincount(side, lever**2, 2 * len(parts)) + 1e-12
        moved = np.bincount(side, lever * off, 2 * len(parts)) / information
        steps = np.diff(moved.reshape(-1, 2), axis=0) ** 2 / 2
        expected = np.reshape(noise**2 / information, (-1, 2)).mean(axis=0)
        wander = np.sqrt(np.maximum(steps.mean(axis=0) - expected, 0.0))
        rough = np.sqrt(own + changes)
        width, closing = _width_and_closing(placements, before)
        return cls(across, depth, slope, change, rough, wander, centre_sigma, width, closing)

    def seen_from(self, beyond: float) -> ReferenceProfile:
        """What it looked like so many metres beyond its place."""
        return replace(self, depth=self.depth + beyond * self.change)


def _width_and_closing(
    placements: Sequence[JointPlacement], before: ReferenceProfile | None
) -> tuple[float, float]:
    """Width between the edges, and by how much it may be less after the next pass, metres."""
    widths = [one.width for one in placements if isfinite(one.width)]
    width = median(widths) if widths else nan
    if before is None or isnan(before.width):
        return width, UNKNOWN_CLOSING
    if isnan(width):
        return before.width, before.closing
    return width, max(before.width - width, LEAST_CLOSING)


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


def _changes_along(index: NDArray[np.intp], along: Array, values: Array) -> Array:
    """Change of the values of each index for each metre along; 0 where one half is not seen."""
    middles = np.full((2, 2, index.max() + 1), np.nan)
    for half, middle in zip((along < 0, along > 0), middles, strict=True):
        seen, part = np.unique(index[half], return_inverse=True)
        if len(seen):
            middle[:, seen] = [_medians_by_index(part, v[half]) for v in (along, values)]
    step, rise = middles[1] - middles[0]
    return np.asarray(np.nan_to_num(rise / step))


def _medians_by_index(index: NDArray[np.intp], values: Array) -> Array:
    """Median of the values of each index, which all occur."""
    order = np.lexsort((values, index))
    first = np.searchsorted(index[order], np.arange(index.max() + 1))
    count = np.bincount(index)
    return np.asarray(values[order][first + count // 2])


def register_profile(
    t: Array,
    z: Array,
    reference: ReferenceProfile,
    start: JointPlacement,
    noise: float,
    *,
    by_one_side: bool = False,
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
    by_one_side : bool, optional
        Whether points of a side that a bead hides were left out.

    Returns
    -------
    JointPlacement and float, or None
        Its standard deviation is that of independent noise and of the reference's; and the share
        of the points that lie on the reference. None if too few do, if the reference is of where
        a bead ended, if one side of the joint no longer shows where it is and no bead covers its
        edge, or if steel is gone that the reference shows.
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
    c, s = cos(roll), sin(roll)
    centre, hull_z = float(c * place[0] + s * place[1]), float(c * place[1] - s * place[0])
    if not by_one_side:
        hidden = _side_hidden(reference, (u, deep - place[1], slope, spread), away, weight)
        if hidden is None:
            return None
        if hidden:
            # Where the bead's outline crosses the reference its points seem to lie on it.
            left = hidden * u > _edge_of(reference, hidden) + EDGE_HALF_WIDTH
            left |= hidden * u < 0
            found = replace(start, centre=centre, hull_z=hull_z, roll=roll)
            return register_profile(t[left], z[left], reference, found, noise, by_one_side=True)
    moves = np.array((c, s, hull_z))
    # What differs from the reference by more than noise makes the centre less certain, too.
    excess = max(float(weight @ (away / spread) ** 2) / float(weight.sum()), 1.0)
    moves = np.linalg.solve(information, moves)
    variance = excess * float(moves @ information @ moves)
    for side, sigma in zip((u < 0, u > 0), reference.wander, strict=True):
        variance += (sigma * float(moves @ (weighted[side].T @ slope[side]))) ** 2
    # By one side half the width tells where the middle is.
    shared = hypot(reference.centre_sigma, by_one_side * reference.closing / 2)
    found = JointPlacement(
        centre=centre,
        hull_z=hull_z,
        roll=roll,
        centre_sigma=hypot(sqrt(max(variance, 0.0)), shared),
        shared_sigma=shared,
    )
    return found, 1 - share


def _side_hidden(
    reference: ReferenceProfile, points: tuple[Array, ...], away: Array, weight: Array
) -> int | None:
    """The side that a bead hides: -1 or 1, or 0 if both show where the joint is; None if none does.

    Parameters
    ----------
    reference : ReferenceProfile
    points : tuple of ndarray, shape (n,)
        Places of a profile's points from the joint's centre, and into the hull, metres; slope of
        the reference there, and standard deviation of its height over the reference, metres.
    away, weight : ndarray, shape (n,)
        How much deeper than the reference each is, metres, and the probability that it is on it.
    """
    u, depth, slope, spread = points
    information = (slope / spread) ** 2
    seen: list[float] = []
    for outward in (-1, 1):
        side = outward * u > 0
        total = max(float(information[side].sum()), 1e-12)
        seen.append(float(weight[side] @ information[side]) / total)
        if seen[-1] < LEAST_SEEN_SHARE_OF_SIDE and not _is_covered(
            outward * u[side], depth[side], reference, outward
        ):
            return None
        deeper = (away[side] > DEEPER_SIGMAS * spread[side]) & (away[side] < FARTHEST_DEEPER)
        if information[side] @ deeper > MOST_DEEPER_SHARE * total:
            return None
    if min(seen) > LARGEST_SHARE_OF_HIDDEN_SIDE:
        return 0
    hidden = -1 if seen[0] < seen[1] else 1
    edge = np.abs(-hidden * u - _edge_of(reference, -hidden)) < EDGE_HALF_WIDTH
    is_shown = max(seen) > LEAST_SEEN_SHARE_OF_ONE_SIDE or (
        max(seen) > LEAST_SEEN_SHARE_OF_SIDE
        and np.sum(weight[edge]) > LEAST_SEEN_SHARE_OF_EDGE * np.count_nonzero(edge)
        and np.abs(slope[edge]).max() > BEVEL_SLOPE
    )
    changes = np.median(reference.noise[np.abs(reference.slope) > EDGE_SLOPE])
    return hidden if is_shown and changes < LARGEST_CHANGE_ALONG else None


def _is_covered(out: Array, depth: Array, reference: ReferenceProfile, outward: int) -> bool:
    """Whether a bead hides the edge of a reference's side, though plate is seen beyond it.

    It stands over the plate about the edge, or inside of it; or it is flush, and then falls gently.
    A joint that is merely narrower shows its plate there, and then its bevel. Each side counts from
    its own plate.

    Parameters
    ----------
    out, depth : ndarray, shape (n,)
        Points of that side of a profile: outward from the joint's centre, and into the hull,
        metres.
    reference : ReferenceProfile
    outward : int
        -1 for the left side, 1 for the right one.
    """
    edge = _edge_of(reference, outward)
    plate = reference.depth[outward * reference.across > edge + EDGE_HALF_WIDTH]
    beyond = out > edge + EDGE_HALF_WIDTH
    if not (edge > 0 and len(plate) and beyond.any()):
        return False
    over = np.median(plate) - depth
    inward = np.arange(edge, 0.0, -EDGE_HALF_WIDTH)
    windows = np.abs(out - inward[:, None]) < EDGE_HALF_WIDTH
    heights = np.array([np.median(over[near]) for near in windows if near.any()])
    falls = -np.diff(heights)[heights[:-1] > -DEPTH_OF_EDGE] / EDGE_HALF_WIDTH
    is_bead = heights[:4].max() > LEAST_COVER or max(falls, default=np.inf) < BEVEL_SLOPE
    is_on_plate = np.abs(over[beyond]) < LEAST_COVER
    return bool(is_bead and np.mean(is_on_plate) > LEAST_SEEN_SHARE_OF_ONE_SIDE)


def _edge_of(reference: ReferenceProfile, outward: int) -> float:
    """Metres outward from the joint's centre to where a side of a reference ends to slope."""
    slopes = np.abs(reference.slope) > EDGE_SLOPE
    return float((outward * reference.across[slopes]).max(initial=0.0))
