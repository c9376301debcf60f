"""Curves that may be sides of a groove: straight pieces, each grown over those that continue it.

In ``(u, y) = (-x / z, 1 / z)`` a line of the plane is a line and a ray is vertical. So what noise
and reflections do to a point changes its y alone, sums over points give a line's squared error,
and the best of all divisions into pieces follows by dynamic programming over small blocks.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove import kernel
from tjscan.groove.reflections import PointRuns
from tjscan.groove.settings import FACE_BLUNTNESS, WELD_ROUGHNESS
from tjscan.groove.sides import LEAST_NOISE, CubicCurve, Index
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

# A bevel cut by flame is rough; a leg is a pipe cut aslant, which is no parabola.
CANDIDATE_KINDS: Final = np.array(
    (
        (0.7, 0.03e-3, 7, 0.12e-3),
        (5, 0.1e-3, 7, 0),
        (100, 0.14e-3, 4, 0),
        (30, 0, 0, WELD_ROUGHNESS),
    )
)
STRAIGHT_KIND, BENT_KIND, BEAD_KIND, WELD_KIND = range(4)
"""Kinds of candidates: walls and bevels; legs; faces of a root; welds that fill the groove."""

KIND_BENDS, _KIND_UNEVENNESS, _KIND_SEED_POINTS, _KIND_REACHES = CANDIDATE_KINDS.T
"""Of each kind: standard deviation of how it bends, in 1/m; how far the steel itself leaves a
parabola, in metres; fewest points of a piece from which it grows, or none; and how far the points
of neighbouring pieces lie off one rough curve through all of them, in metres, or zero."""

MOST_CANDIDATES: Final = 48
"""Most candidates of a kind; the ones of most points are kept."""

MOST_RANGE_PIECES: Final = 48
"""Most pieces of a range."""

MOST_GROWTH_ROUNDS: Final = 8

CONTINUING_SIGMAS: Final = 2.8
"""A piece continues a curve if it is off by no more standard deviations."""

SURE_PREDICTION, LIKELY_PREDICTION = 0.12e-3, 0.5e-3
"""Standard deviations of a prediction, in metres, by which every piece that continues a curve is
taken, and by which the best of them is."""

ROUGH_REACH_SIGMAS: Final = 2.0
"""How far the points of a rough side lie off it, in standard deviations of its residuals."""

LEAST_PIVOT: Final = 1e-18
"""Least weighted square of the spread of points, in m⁴: less is rounding."""


class ProjectivePoints(NamedTuple):
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


class Pieces(NamedTuple):
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
    u, y, z, noise = points
    first, stop = _divide_runs_in_blocks(runs, len(u))
    # What each point adds to the moments of its piece.
    powers = np.vander(u, 5, increasing=True).T
    sums = running_sums(z**4 * np.vstack((powers, y * powers[:3], y * y)))
    through = running_sums(sums[:, stop] - sums[:, first])
    costs = _costs_of_lines(through, 2 * NOISE_INFLATION * (noise**2 + LEAST_UNEVENNESS**2))
    count, longest = len(first), costs.shape[1]
    # What the first j blocks cost at least, after as many that never are.
    least = np.concatenate((np.full(longest, np.inf), np.zeros(count + 1)))
    best_start = [0]
    for j, row in enumerate(costs, 1):
        total = least[j : j + longest] + row
        i = int(total.argmin())
        least[longest + j] = total[i]
        best_start.append(max(j - longest + i, 0))  # if all costs are endless
    edges = [count]
    while edges[0]:
        edges.insert(0, best_start[edges[0]])
    moments = np.diff(through[:, edges])
    w, a, b, c, d = moments[[0, 1, 2, 5, 6]]
    middle = a / w
    spread = np.sqrt(np.maximum(b / w - middle**2, 1e-18))
    slope = (d - a * c / w) / (w * spread**2)
    # Two places as far from the middle as the points are: they represent all of them.
    away = spread[:, None] * (-1.0, 1.0)
    probes, heights = middle[:, None] + away, (c / w)[:, None] + slope[:, None] * away
    # Points on one ray show no surface.
    seen = spread > LEAST_BEARING_SPREAD
    start, end = first[edges[:-1]], stop[np.array(edges[1:]) - 1]
    return Pieces(*(value[seen] for value in (start, end, moments.T, probes, heights)))


def running_sums(values: Array) -> Array:
    """Sums of the first 0, 1, 2 … values of each row, shape (m, n) to (m, n + 1)."""
    return np.pad(values.cumsum(axis=1), ((0, 0), (1, 0)))


def _divide_runs_in_blocks(runs: PointRuns, points: int) -> tuple[Index, Index]:
    """First point of each block, and the one after its last."""
    size = max(POINTS_PER_BLOCK, points // MOST_BLOCKS)
    long = runs.count >= min(FEWEST_RUN_POINTS, int(runs.count.max()))
    blocks = np.maximum(runs.count[long] // size, 1)
    start, count, begin, own = np.array(
        (runs.first[long], runs.count[long], blocks.cumsum() - blocks, blocks)
    ).repeat(blocks, axis=1)
    step = np.arange(len(own)) - begin
    return start + step * count // own, start + (step + 1) * count // own


def _costs_of_lines(through: Array, variance: float) -> Array:
    """What a line costs, in nats, at [j - 1, l] if its points are blocks j - longest + l to j.

    `variance` is twice that of a point, in m², inflated by correlation.
    """
    sums = through[[0, 1, 2, 5, 6, 8]]
    before = np.pad(sums[:, :-1], ((0, 0), (LONGEST_PIECE_BLOCKS - 1, 0)))
    starts = np.lib.stride_tricks.sliding_window_view(before, LONGEST_PIECE_BLOCKS, axis=1)
    w, a, b, c, d, e = sums[:, 1:, None] - starts
    d -= a * c / w
    e -= c * c / w + d * d / np.fmax(b - a * a / w, 1e-15)
    # As the compiled loops: no cost is NaN.
    return np.asarray(np.fmax(e, 0) / variance + PIECE_COST)


class CandidateSides(NamedTuple):
    """K curves ``y = a + b u + c u²`` that may be sides.

    Parameters
    ----------
    kind : ndarray of int, shape (K,)
        Which of `CANDIDATE_KINDS`.
    roughness : ndarray, shape (K,)
        Root mean square of its points' distances, in metres.
    coefficients : ndarray, shape (K, 3)
        a, b and c.
    first, last : ndarray, shape (K,)
        Where its pieces begin and end, u.
    """

    kind: Index
    roughness: Array
    coefficients: Array
    first: Array
    last: Array

    def heights_and_slopes(self, u: Array) -> tuple[Array, Array]:
        """Y and dy/du at places u, shape (K, ...)."""
        a, b, c = self.coefficients.T.reshape(3, -1, *[1] * (u.ndim - 1))
        return a + u * (b + u * c), b + 2 * u * c

    @property
    def steepness(self) -> Array:
        """Of its middle, shape (K,): a difference of y times z, over this, is square to it."""
        u = 0.5 * (self.first + self.last)
        y, slope = self.heights_and_slopes(u)
        return np.hypot(u * slope - y, slope)

    def scaled_distances(self, points: ProjectivePoints, reach: Array | float) -> Array:
        """Distances of points behind each curve, about, over a reach each, shape (K, n)."""
        u, y, z = points.u, points.y, points.z
        weights = np.column_stack((self.coefficients, np.ones(len(self.kind))))
        weights /= (self.steepness * reach)[:, None]
        return np.asarray(weights @ np.array((z, z * u, z * u**2, -z * y)))

    def reaches(self, tolerance: float) -> Array:
        """How far points may lie off each, shape (K,): rough welds and high beads reach farther."""
        u = np.array((self.first, 0.5 * (self.first + self.last), self.last)).T
        y, _ = self.heights_and_slopes(u)
        bow = np.abs(y[:, 1] - 0.5 * (y[:, 0] + y[:, 2])) / (y[:, 1] * self.steepness)
        farthest = np.where(self.kind == BEAD_KIND, FACE_BLUNTNESS * bow, 0.0)
        farthest[self.kind == WELD_KIND] = WELD_ROUGHNESS
        return np.maximum(np.minimum(ROUGH_REACH_SIGMAS * self.roughness, farthest), tolerance)

    def as_curves(self) -> list[CubicCurve]:
        """Each over its tangent in the middle."""
        u = 0.5 * (self.first + self.last)
        a, b, c = self.coefficients.T
        y, slope = a + u * (b + u * c), b + 2 * u * c
        along, zero = u * slope - y, np.zeros(len(u))
        steep = np.hypot(along, slope)
        tangents, bends = (along / steep, -slope / steep), -c * (y / steep) ** 3
        values = np.array((-u / y, 1 / y, *tangents, zero, zero, bends, zero))
        return list(map(CubicCurve._make, values.T.tolist()))


def propose_candidates(points: ProjectivePoints, pieces: Pieces) -> CandidateSides:
    """Curves through pieces that continue each other, and through neighbours that are rough.

    Parameters
    ----------
    points : ProjectivePoints
    pieces : Pieces
        Of these points.
    """
    variance = NOISE_INFLATION * points.noise**2
    if kernel.compiled is not None:
        n = len(CANDIDATE_KINDS) * MOST_CANDIDATES
        kind, coefficients = np.empty(n, dtype=np.intp), np.empty((n, 3))
        roughness, begins, ends = np.empty((3, n))
        m = kernel.compiled.propose_candidates(
            *(points.u, pieces.first, pieces.stop, pieces.moments, pieces.probes, pieces.heights),
            *(CANDIDATE_KINDS, kind, roughness, coefficients, begins, ends, variance),
        )
        return CandidateSides(kind[:m], roughness[:m], coefficients[:m], begins[:m], ends[:m])
    # Each set of pieces once for each kind, the ones of most points first.
    every = np.concatenate((_grow_seeds(pieces, variance), _best_ranges(pieces, variance)))
    every = np.unique(every, axis=0)
    counts = pieces.stop - pieces.first
    every = every[np.lexsort((-(every[:, 1:] @ counts), every[:, 0]))]
    places = np.arange(len(every)) - every[:, 0].searchsorted(every[:, 0])
    every = every[places < MOST_CANDIDATES]
    kinds, member = every[:, 0].astype(np.intp), every[:, 1:].astype(np.bool_)
    sums = member @ pieces.moments
    coefficients, _ = _fit_sums(sums, KIND_BENDS[kinds], variance)
    roughness = np.sqrt(_squared_errors(sums, coefficients) / (member @ counts))
    last = member.shape[1] - 1 - member[:, ::-1].argmax(axis=1)
    begins, ends = pieces.first[member.argmax(axis=1)], pieces.stop[last] - 1
    return CandidateSides(kinds, roughness, coefficients, points.u[begins], points.u[ends])


def _grow_seeds(pieces: Pieces, variance: float) -> NDArray[np.uint8]:
    """Kind, and which pieces continue one that is a seed, with it, shape (m, 1 + P)."""
    points = pieces.stop - pieces.first
    least, count = _KIND_SEED_POINTS[:, None], len(points)
    kind, seed = ((points >= least) & (least > 0)).nonzero()
    member = np.eye(count, dtype=np.bool_)[seed]
    # The first place of each piece, then the second of each.
    probes, heights = pieces.probes.T.ravel(), pieces.heights.T.ravel()
    steep, _ = _steepness_and_height(pieces.moments[seed])
    powers = np.vander(probes, 3, increasing=True).T
    pairs = (powers[:, None] * powers).reshape(9, -1)
    # What a difference of y is square to the curve, in metres.
    scale = 1 / (heights * steep[:, None])
    own = 2 * variance / np.tile(points, 2) * (heights**2 * scale) ** 2
    own += _KIND_UNEVENNESS[kind][:, None] ** 2
    growing = np.arange(len(seed))
    for _ in range(MOST_GROWTH_ROUNDS):
        now, bends = member[growing], KIND_BENDS[kind[growing]]
        coefficients, inverse = _fit_sums(now @ pieces.moments, bends, variance)
        off = ((coefficients @ powers - heights) * scale[growing]) ** 2
        doubt = variance * np.maximum(inverse.reshape(-1, 9) @ pairs, 0.0) * scale[growing] ** 2
        score = off / (doubt + own[growing])
        score, off, doubt = (np.maximum(v[:, :count], v[:, count:]) for v in (score, off, doubt))
        fits = (score < CONTINUING_SIGMAS**2) & ~now
        added = fits & (doubt < SURE_PREDICTION**2)
        likely = fits & (np.maximum(doubt, off) < LIKELY_PREDICTION**2)
        best = np.where(likely, score * doubt, np.inf).argmin(axis=1)
        alone = np.flatnonzero(likely.any(axis=1) & ~added.any(axis=1))
        added[alone, best[alone]] = True
        member[growing] |= added
        growing = growing[added.any(axis=1)]
        if not len(growing):
            break
    return np.column_stack((kind.astype(np.uint8), member))


def _best_ranges(pieces: Pieces, variance: float) -> NDArray[np.uint8]:
    """Kind, and which neighbouring pieces one rough curve explains best, shape (m, 1 + P).

    Of all ranges that begin, or end, at the same piece each explains most.
    """
    count = len(pieces.first)
    start, stop = np.triu_indices(count + 1, 1)
    start, stop = np.array((start, stop))[:, stop - start <= MOST_RANGE_PIECES]
    through = running_sums(pieces.moments.T).T
    sums = through[stop] - through[start]
    points = np.concatenate(([0], (pieces.stop - pieces.first).cumsum()))
    index, found = np.arange(count), []
    for kind in np.flatnonzero(_KIND_REACHES):
        coefficients, _ = _fit_sums(sums, KIND_BENDS[kind], variance)
        gain = np.full((count, count + 1), -np.inf)
        gain[start, stop] = points[stop] - points[start]
        gain[start, stop] -= _squared_errors(sums, coefficients) / _KIND_REACHES[kind] ** 2
        best = (gain == gain.max(axis=0)) & (gain == gain.max(axis=1)[:, None]) & (gain > 0)
        a, b = (place[:, None] for place in best.nonzero())
        own = np.full_like(a, kind, dtype=np.uint8)
        found.append(np.concatenate((own, (a <= index) & (index < b)), axis=1))
    return np.concatenate(found)


def _steepness_and_height(sums: Array) -> tuple[Array, Array]:
    """How steep the line through some points is, and its height y, from their moments, (m,)."""
    w, a, b, c, d = sums.T[[0, 1, 2, 5, 6]]
    u, y = a / w, c / w
    slope = (d - u * c) / np.maximum(b - u * a, 1e-18)
    return np.hypot(u * slope - y, slope), y


def _fit_sums(sums: Array, bend: Array | float, variance: float) -> tuple[Array, Array]:
    """Fit parabolas to points of given moments, shape (K, 9).

    Coefficients, shape (K, 3), and inverse normal matrices, shape (K, 3, 3).
    """
    steep, height = _steepness_and_height(sums)
    w, a, b, c, d = sums.T[:5]
    # A bend of c2 metres per square metre is c2 (steep / y)³ in (u, y).
    d = d + variance * (height / steep) ** 6 / bend**2
    # Matrices are L D Lᵀ in closed form. Points on nearly one ray show no bend.
    slope, square = a / w, b / w
    first = np.maximum(b - slope * a, LEAST_PIVOT)
    turn = (c - square * a) / first
    second = np.maximum(d - square * b - turn * turn * first, LEAST_PIVOT)
    one, none = np.ones_like(w), np.zeros_like(w)
    rows = (one, none, none), (-slope, one, none), (turn * slope - square, -turn, one)
    half = (np.array(rows) / np.sqrt(np.array((w, first, second)))[:, None]).transpose(2, 0, 1)
    inverse = half.transpose(0, 2, 1) @ half
    return (inverse @ sums[:, 5:8, None])[..., 0], inverse


def _squared_errors(sums: Array, coefficients: Array) -> Array:
    """Squared errors of parabolas square to them, shape (K,), in m²."""
    steep, height = _steepness_and_height(sums)
    error = sums[:, 8] - (coefficients * sums[:, 5:8]).sum(axis=1)
    return np.asarray(np.maximum(error, 0.0) * (height / steep) ** 2)
