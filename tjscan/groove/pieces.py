"""A profile in pieces: the most probable division of its points into straight lines.

In ``(u, y) = (-x / z, 1 / z)`` a line of the plane is a line and a ray is vertical. So what noise
and reflections do to a point changes its y alone, sums over points give a line's squared error,
and the best of all divisions follows by dynamic programming over small blocks of points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove import kernel
from tjscan.groove.reflections import PointRuns
from tjscan.groove.sides import LEAST_NOISE, Index
from tjscan.laser.profile import Profile

POINTS_PER_BLOCK: Final = 3
"""Points of a block, which is not divided; more if a profile has more points."""

MOST_BLOCKS: Final = 220
"""About how many blocks a profile has at most."""

LONGEST_PIECE_BLOCKS: Final = 48
"""Longer pieces are divided: what they show together their candidate shows."""

FEWEST_RUN_POINTS: Final = 3
"""Shorter runs of points that jump off the surface are in no piece."""

LEAST_BEARING_SPREAD: Final = 1e-6
"""Standard deviation of u of the points of a piece, at least."""

PIECE_COST: Final = 7.0
"""What a piece costs, in nats: BIC's penalty for a line and its end among some 200 blocks."""

NOISE_INFLATION: Final = 2.0
"""By how much correlation raises the variance of a mean before it is estimated."""

LEAST_UNEVENNESS: Final = 0.01e-3
"""How far the steel of a straight piece leaves its line, in metres."""

NOISE_LAGS: Final = (1, 4)
"""Points between those whose second differences show the noise."""

QUIET_QUANTILE: Final = 0.25
"""The quietest points show the noise: rims of reflections and patches make the others."""

LEAST_DIFFERENCE: Final = 1e-8  # metres: less is rounding of numbers
QUIET_QUANTILE_OF_NORMAL: Final = 0.3186  # of the size of a normal variable of variance 1


@dataclass(frozen=True, slots=True, eq=False)
class ProjectivePoints:
    """The n points of a row in (u, y); a difference of y times z² is one of depth, in metres.

    Parameters
    ----------
    u, y : ndarray, shape (n,)
        -x / z, rising, and 1 / z, in 1/m.
    z : ndarray, shape (n,)
        Depth, in metres.
    noise : float
        Standard deviation of a point's depth, in metres.
    """

    u: Array
    y: Array
    z: Array
    noise: float


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """P straight pieces of a profile.

    Parameters
    ----------
    first, stop : ndarray of int, shape (P,)
        First point of each, and the one after its last.
    moments : ndarray, shape (P, 9)
        Sums of z⁴ times 1, u … u⁴, y, u y, u² y and y² over its points.
    probes, heights : ndarray, shape (P, 2)
        Two places u that represent its points, and y of its line there.
    """

    first: Index
    stop: Index
    moments: Array
    probes: Array
    heights: Array


def project_points(row: Profile, largest_noise: float) -> ProjectivePoints:
    """Points in (u, y), and their noise, from second differences of the quietest points.

    Parameters
    ----------
    row : Profile
    largest_noise : float
        In metres; what is rougher is shape.
    """
    z = row.z_s
    if kernel.compiled is not None:
        u, y, work = np.empty((3, len(z)))
        noise = kernel.compiled.project_points(row.x_s, z, u, y, work, largest_noise)
        return ProjectivePoints(u, y, z, noise)
    u, y = -row.x_s / z, 1 / z
    sigmas = [LEAST_NOISE]
    for lag in NOISE_LAGS:
        before, own, after = slice(-2 * lag), slice(lag, -lag), slice(2 * lag, None)
        share = (u[own] - u[before]) / np.maximum(u[after] - u[before], 1e-9)
        off = np.abs(y[own] - (1 - share) * y[before] - share * y[after]) * z[own] ** 2
        size = off / np.sqrt(1 + share**2 + (1 - share) ** 2)
        # A sensor that rounds shows no difference if it is finer than its steps.
        size = size[size > LEAST_DIFFERENCE]
        if len(size):
            shares = np.linspace(0, 1, len(size))
            quiet = np.interp(QUIET_QUANTILE, shares, np.sort(size))
            sigmas.append(float(quiet) / QUIET_QUANTILE_OF_NORMAL)
    return ProjectivePoints(u, y, z, min(max(sigmas), largest_noise))


def find_pieces(points: ProjectivePoints, runs: PointRuns) -> Pieces:
    """Divide a profile into the straight pieces that together explain it best.

    Parameters
    ----------
    points : ProjectivePoints
    runs : PointRuns
        Of the same points; no piece goes on where neighbours jump.
    """
    if kernel.compiled is not None:
        n = len(points.u)
        found = *np.empty((2, n), dtype=np.intp), *map(np.empty, ((n, 9), (n, 2), (n, 2)))
        count = kernel.compiled.find_pieces(
            *(points.u, points.y, points.z, runs.first, runs.count, *found, points.noise)
        )
        return Pieces(*(value[:count] for value in found))
    first, stop = _divide_runs_in_blocks(runs, len(points.u))
    # What each point adds to the moments of its piece.
    terms = np.empty((9, len(points.u)))
    np.square(points.z**2, out=terms[0])
    for k in range(4):
        np.multiply(terms[k], points.u, out=terms[k + 1])
    np.multiply(terms[:3], points.y, out=terms[5:8])
    np.multiply(terms[5], points.y, out=terms[8])
    sums = np.zeros((9, len(points.u) + 1))
    np.cumsum(terms, axis=1, out=sums[:, 1:])
    sums = np.array(sums[:, stop] - sums[:, first])
    through = np.concatenate((np.zeros((9, 1)), sums.cumsum(axis=1)), axis=1)
    costs = _costs_of_lines(through, 2 * NOISE_INFLATION * (points.noise**2 + LEAST_UNEVENNESS**2))
    count, longest = len(first), costs.shape[1]
    # What the first j blocks cost at least, after as many that never are.
    least = np.concatenate((np.full(longest, np.inf), np.zeros(count + 1)))
    best_start = [0] * (count + 1)
    for j, row in enumerate(costs, 1):
        total = least[j : j + longest] + row
        i = int(total.argmin())
        least[longest + j] = total[i]
        best_start[j] = max(j - longest + i, 0)  # if all costs are endless
    bounds = [count]
    while bounds[-1]:
        bounds.append(best_start[bounds[-1]])
    edges = np.array(bounds[::-1])
    moments = through[:, edges[1:]] - through[:, edges[:-1]]
    w, a, b, c, d = moments[[0, 1, 2, 5, 6]]
    middle = a / w
    spread = np.sqrt(np.maximum(b / w - middle**2, 1e-18))
    slope = (d - a * c / w) / (w * spread**2)
    # Two places as far from the middle as the points are: they represent all of them.
    probes = middle[:, None] + spread[:, None] * np.array((-1.0, 1.0))
    heights = (c / w)[:, None] + slope[:, None] * (probes - middle[:, None])
    # Points on one ray show no surface.
    seen = spread > LEAST_BEARING_SPREAD
    start, end = first[edges[:-1]], stop[edges[1:] - 1]
    return Pieces(*(value[seen] for value in (start, end, moments.T, probes, heights)))


def _divide_runs_in_blocks(runs: PointRuns, points: int) -> tuple[Index, Index]:
    """First point of each block, and the one after its last."""
    size = max(POINTS_PER_BLOCK, points // MOST_BLOCKS)
    long = runs.count >= min(FEWEST_RUN_POINTS, int(runs.count.max()))
    start, count = runs.first[long], runs.count[long]
    blocks = np.maximum(count // size, 1)
    ends = blocks.cumsum()
    step = np.arange(ends[-1]) - (ends - blocks).repeat(blocks)
    start, count, blocks = (v.repeat(blocks) for v in (start, count, blocks))
    return start + step * count // blocks, start + (step + 1) * count // blocks


def _costs_of_lines(through: Array, variance: float) -> Array:
    """What a line costs, in nats, at [j - 1, l] if its points are blocks j - longest + l to j.

    `variance` is twice that of a point, in m², inflated by correlation.
    """
    sums = through[[0, 1, 2, 5, 6, 8]]
    before = np.pad(sums[:, :-1], ((0, 0), (LONGEST_PIECE_BLOCKS - 1, 0)))
    starts = np.lib.stride_tricks.sliding_window_view(before, LONGEST_PIECE_BLOCKS, axis=1)
    w, a, b, c, d, e = sums[:, 1:, None] - starts
    a /= w
    b -= a * a * w
    np.fmax(b, 1e-15, out=b)
    d -= a * c
    e -= c * c / w + d * d / b
    np.fmax(e, 0, out=e)  # as the compiled loops: no cost is NaN
    e /= variance
    e += PIECE_COST
    return np.asarray(e)
