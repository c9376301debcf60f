"""The long sides of a profile: many short windows vote, the best stretches are kept.

A robust search in the manner of MSAC, but over a fixed set of windows instead of random pairs,
so that the same profile always gives the same answer. Every window's line is judged by the best
*stretch* of points it explains: a point on the stretch counts by its distance, an outlier within
the stretch costs a little, and points before and after it do not count. A few slightly curved
segments come out: the long sides of the groove, and whatever reflections look alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove.settings import SearchBudget
from tjscan.groove.sides import Index

THINNED_POINT_COUNT: Final = 107
"""About how many points judge a window: noise is correlated over more than what is skipped."""

CURVATURE_SPREAD: Final = 3.0
"""Standard deviation of a side's curvature coefficient, 1/m: pipes of a radius of 170 mm."""

LEAST_SEGMENT_GAIN: Final = 1.0
"""What a segment has to add to those before it, in points of the thinned row."""

WIDE_GAP: Final = 10
"""Points without support that may divide a segment into two sides."""


@dataclass(frozen=True, slots=True, eq=False)
class CurvedSegments:
    """m slightly curved segments: ``centre + s direction + (c0 + c1 s + c2 s²) normal``.

    Directions go from the wall to the leg; the normal points away from the sensor.

    Parameters
    ----------
    centre, direction : ndarray, shape (m, 2)
        A point and the unit direction of the chord, x and z in the sensor plane, metres.
    curve : ndarray, shape (m, 3)
        Coefficients c0, c1, c2.
    first, last : ndarray, shape (m,)
        First and last point of the stretch, both inclusive.
    score : ndarray, shape (m,)
        What the stretch explains, in points.
    """

    centre: Array
    direction: Array
    curve: Array
    first: Index
    last: Index
    score: Array

    def __len__(self) -> int:
        return len(self.centre)

    def select_segments(self, which: Index) -> CurvedSegments:
        """Select segments by their indices `which`."""
        return CurvedSegments(*(getattr(self, name)[which] for name in self.__slots__))

    def local_coordinates(self, points: Array) -> tuple[Array, Array]:
        """Coordinates of points, shape (n, 2), along and away from each chord, (m, n) each."""
        t = self.direction
        s = t @ points.T - (t * self.centre).sum(axis=1)[:, None]
        return s, self.distances_from_chords(points)

    def distances_from_chords(self, points: Array) -> Array:
        """Distances of points, shape (n, 2), behind each chord, (m, n)."""
        n = normals_of_directions(self.direction)
        return np.asarray(n @ points.T - (n * self.centre).sum(axis=1)[:, None])

    def points_within(self, count: int) -> NDArray[np.bool_]:
        """Which of `count` points lie within each segment's stretch, shape (m, count)."""
        index = np.arange(count)
        return np.asarray((self.first[:, None] <= index) & (index <= self.last[:, None]))


def normals_of_directions(directions: Array) -> Array:
    """Unit normals, shape (..., 2), on the far side of directions that go from wall to leg."""
    found = np.empty_like(directions)
    found[..., 0] = directions[..., 1]
    np.negative(directions[..., 0], out=found[..., 1])
    return found


def find_segments(points: Array, tolerance: float, budget: SearchBudget) -> CurvedSegments:
    """Find the long segments in a row of points, by falling score.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        x and z in metres, ordered from wall to leg.
    tolerance : float
        Distance from a segment at which a point stops supporting it, in metres.
    budget : SearchBudget

    Returns
    -------
    CurvedSegments
        Their stretches and scores count all n points.
    """
    step = max(1, round(len(points) / THINNED_POINT_COUNT))
    row = points[::step]
    segments = _fit_windows(points, tolerance, budget.windows)
    if not len(segments):
        return segments
    segments, gain = _find_best_stretches(segments, row, tolerance, budget.gap_cost)
    segments = _select_greedily(segments, gain, budget.kept)
    for _ in range(budget.refits):
        segments, gain = _find_best_stretches(
            _refit_parabolas(segments, row, tolerance), row, tolerance, budget.gap_cost
        )
    segments = _select_distinct(segments, gain, budget.kept)
    return replace(
        segments,
        first=segments.first * step,
        last=np.minimum(segments.last * step + step, len(points)) - 1,
        score=segments.score * step,
    )


def add_halves_at_gaps(segments: CurvedSegments, points: Array, tolerance: float) -> CurvedSegments:
    """Add both halves of segments with a wide gap: two plates may lie in one line."""
    s, d = segments.local_coordinates(points)
    c0, c1, c2 = segments.curve.T[:, :, None]
    good = (np.abs(d - (c0 + s * (c1 + s * c2))) < tolerance) & segments.points_within(len(points))
    parts = [segments]
    for k in range(len(segments)):
        on = np.flatnonzero(good[k])
        gaps = np.diff(on)
        if len(gaps) and gaps.max() > WIDE_GAP:
            cut = int(gaps.argmax()) + 1
            for half in (on[:cut], on[cut:]):
                one = segments.select_segments(np.array([k]))
                score = np.array([float(len(half))])
                parts.append(replace(one, first=half[:1], last=half[-1:], score=score))
    return CurvedSegments(
        *(np.concatenate([getattr(p, n) for p in parts]) for n in CurvedSegments.__slots__)
    )


def _fit_windows(points: Array, tolerance: float, windows: tuple[int, ...]) -> CurvedSegments:
    """Total least-squares lines through windows of several lengths, where they fit well.

    A window inside a longer one that fits has nothing to add.
    """
    n = len(points)
    origin = points[n // 2]
    terms, sums = np.empty((5, n)), np.zeros((5, n + 1))
    np.subtract(points.T, origin[:, None], out=terms[:2])
    np.multiply(terms[0], terms[:2], out=terms[2:4])
    np.multiply(terms[1], terms[1], out=terms[4])
    np.cumsum(terms, axis=1, out=sums[:, 1:])
    counts = [len(range(0, n - k + 1, k // 2)) for k in windows]
    count = np.repeat(windows, counts)
    first = np.concatenate([np.arange(m) for m in counts]) * (count // 2)
    last = first + count
    mx, mz, xx, xz, zz = (sums.take(last, axis=1) - sums.take(first, axis=1)) / count
    xx, xz, zz = xx - mx * mx, xz - mx * mz, zz - mz * mz
    # The smaller eigenvalue of the scatter: mean square distance from the best line.
    half, apart = 0.5 * (xx + zz), np.hypot(0.5 * (xx - zz), xz)
    good = half - apart < (tolerance / 2) ** 2
    new = good.copy()
    ends = np.cumsum(counts)
    for k in range(1, len(windows)):
        longer = np.zeros(counts[k] // 2 + 2, dtype=bool)
        above = good[ends[k - 1] - counts[k - 1] : ends[k - 1]]
        longer[1 : len(above) + 1] = above[: len(longer) - 1]
        # Windows start at every half of their length: j lies in the longer ones j // 2 and,
        # if even, the one before.
        j = np.arange(counts[k])
        mine = slice(ends[k] - counts[k], ends[k])
        covered = longer[j // 2 + 1] | (longer[j // 2] & (j % 2 == 0))
        new[mine] &= ~covered
        good[mine] |= covered
    mx, mz, xx, xz, zz = np.array((mx, mz, xx, xz, zz))[:, new]
    first, last = first[new], last[new]
    angle = 0.5 * np.arctan2(2 * xz, xx - zz)
    m = len(first)
    direction = np.array((np.cos(angle), np.sin(angle))).T
    chord = points.T[:, last - 1] - points.T[:, first]
    along = chord[0] * direction[:, 0] + chord[1] * direction[:, 1]
    direction[along < 0] *= -1
    nothing = np.zeros(m, dtype=np.intp)
    centre = np.array((mx + origin[0], mz + origin[1])).T
    return CurvedSegments(centre, direction, np.zeros((m, 3)), nothing, nothing, np.zeros(m))


def _find_best_stretches(
    segments: CurvedSegments, row: Array, tolerance: float, gap_cost: float
) -> tuple[CurvedSegments, Array]:
    """Give each segment the stretch of the row of the highest total gain (Kadane's algorithm).

    Returns the gains of all points too, shape (m, n): one on the segment, `-gap_cost` off it.
    """
    if segments.curve.any():
        s, d = segments.local_coordinates(row)
        c0, c1, c2 = segments.curve.T[:, :, None]
        d -= c0 + s * (c1 + s * c2)
    else:
        d = segments.distances_from_chords(row)
    gain = d * d
    gain *= -1 / tolerance**2
    gain += 1
    np.maximum(gain, -gap_cost, out=gain)
    total = gain.cumsum(axis=1)
    lowest = np.minimum.accumulate(total, axis=1)
    np.minimum(lowest, 0, out=lowest)
    rows = np.arange(len(gain))
    last = (total - lowest).argmax(axis=1)
    below = lowest[rows, last]
    first = np.where(below < 0, (total == below[:, None]).argmax(axis=1) + 1, 0)
    first = np.minimum(first, last)
    score = total[rows, last] - below
    return replace(segments, first=first, last=last, score=score), gain


def _select_greedily(segments: CurvedSegments, gain: Array, most: int) -> CurvedSegments:
    """Keep the segments that explain most of what those before them left over.

    Lines along a curved side are many and each is the best somewhere: they must not crowd out
    a short side.
    """
    left = np.maximum(gain, 0)
    left *= segments.points_within(gain.shape[1])
    every = np.ones(gain.shape[1])
    chosen: list[int] = []
    while len(chosen) < most:
        worth = left @ every
        best = int(worth.argmax())
        if chosen and worth[best] < LEAST_SEGMENT_GAIN:
            break
        chosen.append(best)
        left *= left[best] <= 0
    return segments.select_segments(np.array(chosen, dtype=np.intp))


def _select_distinct(segments: CurvedSegments, gain: Array, most: int) -> CurvedSegments:
    """Keep the segments that explain some point better than all others."""
    over = segments.points_within(gain.shape[1]) & (gain > 0)
    winners = (over * segments.score[:, None]).argmax(axis=0)
    winners = np.flatnonzero(np.bincount(winners, minlength=len(segments)))
    best = winners[np.argsort(-segments.score[winners], kind="stable")[:most]]
    return segments.select_segments(best)


def _refit_parabolas(segments: CurvedSegments, row: Array, tolerance: float) -> CurvedSegments:
    """Least-squares parabola through the supporting points of every segment."""
    s, d = segments.local_coordinates(row)
    c0, c1, c2 = segments.curve.T[:, :, None]
    w = (np.abs(d - (c0 + s * (c1 + s * c2))) < tolerance) & segments.points_within(len(row))
    powers = np.empty((5, *s.shape))
    powers[0] = w
    for k in range(4):
        np.multiply(powers[k], s, out=powers[k + 1])
    m = powers.sum(axis=2)
    b = (powers[:3] * d).sum(axis=2)
    # A pipe's side is nearly straight: a short stretch is taken for straight until it shows more.
    prior = (tolerance / 2 / CURVATURE_SPREAD) ** 2
    a = np.array(
        [[m[0] + 1e-9, m[1], m[2]], [m[1], m[2] + 1e-15, m[3]], [m[2], m[3], m[4] + prior]]
    )
    scale = np.array([1.0, 1e2, 1e4])  # centimetres: keeps the matrix well conditioned
    a *= scale[:, None, None] * scale[:, None]
    solved = np.linalg.solve(a.transpose(2, 0, 1), (b * scale[:, None]).T[:, :, None])
    return replace(segments, curve=solved[:, :, 0] * scale)
