"""Curves that may be sides of a groove: every piece grown over the pieces that continue it."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove import kernel
from tjscan.groove.pieces import NOISE_INFLATION, Pieces, ProjectivePoints
from tjscan.groove.settings import FACE_BLUNTNESS, WELD_ROUGHNESS
from tjscan.groove.sides import CubicCurve, Index


@dataclass(frozen=True, slots=True)
class CandidateKind:
    """Prior knowledge of a candidate side.

    Parameters
    ----------
    bend : float
        Standard deviation of how it bends, in 1/m.
    unevenness : float
        How far the steel itself leaves a parabola, in metres.
    seed_points : int
        Fewest points of a piece from which it grows; none for a kind that does not grow.
    range_reach : float
        How far the points of neighbouring pieces lie off one rough curve through all of them, in
        metres; zero for a kind that is never rough.
    """

    bend: float
    unevenness: float = 0.0
    seed_points: int = 0
    range_reach: float = 0.0


# A bevel cut by flame is rough; a leg is a pipe cut aslant, which is no parabola.
CANDIDATE_KINDS: Final = (
    CandidateKind(0.7, 0.03e-3, 7, 0.12e-3),
    CandidateKind(5.0, 0.1e-3, 7),
    CandidateKind(100.0, 0.14e-3, 4),
    CandidateKind(30.0, range_reach=WELD_ROUGHNESS),
)
STRAIGHT_KIND, BENT_KIND, BEAD_KIND, WELD_KIND = range(len(CANDIDATE_KINDS))
"""Kinds of candidates: walls and bevels; legs; faces of a root; welds that fill the groove."""

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

_KIND_TABLE: Final = np.array([astuple(kind) for kind in CANDIDATE_KINDS])
_KIND_BENDS, _KIND_UNEVENNESS, _KIND_SEED_POINTS = _KIND_TABLE.T[:3]

LEAST_PIVOT: Final = 1e-18
"""Least weighted square of the spread of points, in m⁴: less is rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class CandidateSides:
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

    def as_curves(self, chain: list[int]) -> tuple[CubicCurve, ...]:
        """Some of them, each over its tangent in the middle."""
        u = 0.5 * (self.first + self.last)[chain]
        a, b, c = self.coefficients[chain].T
        y, slope = a + u * (b + u * c), b + 2 * u * c
        along = u * slope - y
        steep = np.hypot(along, slope)
        zero = np.zeros(len(chain))
        values = -u / y, 1 / y, along / steep, -slope / steep, zero, zero, -c * (y / steep) ** 3
        return tuple(CubicCurve(*curve) for curve in np.transpose(values).tolist())


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
            *(_KIND_TABLE, kind, roughness, coefficients, begins, ends, variance),
        )
        return CandidateSides(kind[:m], roughness[:m], coefficients[:m], begins[:m], ends[:m])
    counts = pieces.stop - pieces.first
    # Each set of pieces once for each kind, the ones of most points first.
    every = np.concatenate([_grow_seeds(pieces, variance), _best_ranges(pieces, variance)])
    once = sorted({row.tobytes() for row in every})
    every = np.frombuffer(b"".join(once), dtype=np.uint8).reshape(len(once), -1)
    every = every[np.lexsort((-(every[:, 1:] @ counts), every[:, 0]))]
    places = np.arange(len(every)) - every[:, 0].searchsorted(every[:, 0])
    every = every[places < MOST_CANDIDATES]
    kinds, member = every[:, 0].astype(np.intp), every[:, 1:].astype(np.bool_)
    sums = member @ pieces.moments
    coefficients, _ = _fit_sums(sums, _KIND_BENDS[kinds], variance)
    error = _squared_errors(sums, coefficients)
    first = member.argmax(axis=1)
    last = member.shape[1] - 1 - member[:, ::-1].argmax(axis=1)
    return CandidateSides(
        kinds,
        np.sqrt(error / (member @ counts)),
        coefficients,
        points.u[pieces.first[first]],
        points.u[pieces.stop[last] - 1],
    )


def _grow_seeds(pieces: Pieces, variance: float) -> NDArray[np.uint8]:
    """Kind, and which pieces continue one that is a seed, with it, shape (m, 1 + P)."""
    points = pieces.stop - pieces.first
    least = _KIND_SEED_POINTS[:, None]
    kind, seed = ((points >= least) & (least > 0)).nonzero()
    count = len(points)
    member = np.zeros((len(seed), count), dtype=np.bool_)
    member[np.arange(len(seed)), seed] = True
    # The first place of each piece, then the second of each.
    probes, heights = pieces.probes.T.ravel(), pieces.heights.T.ravel()
    steep, _ = _steepness_and_height(pieces.moments[seed])
    powers = np.array((np.ones_like(probes), probes, probes**2))
    pairs = (powers[:, None] * powers[None]).reshape(9, -1)
    # What a difference of y is square to the curve, in metres.
    scale = 1 / (heights * steep[:, None])
    own = 2 * variance / np.tile(points, 2) * (heights**2 * scale) ** 2
    own += _KIND_UNEVENNESS[kind][:, None] ** 2
    growing = np.arange(len(seed))
    for _ in range(MOST_GROWTH_ROUNDS):
        now = member[growing]
        coefficients, inverse = _fit_sums(
            now @ pieces.moments, _KIND_BENDS[kind[growing]], variance
        )
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
    through = np.concatenate((np.zeros((1, 9)), pieces.moments.cumsum(axis=0)))
    sums = through[stop] - through[start]
    points = np.concatenate(([0], (pieces.stop - pieces.first).cumsum()))
    index, found = np.arange(count), []
    for kind, known in enumerate(CANDIDATE_KINDS):
        if not known.range_reach:
            continue
        coefficients, _ = _fit_sums(sums, known.bend, variance)
        gain = np.full((count, count + 1), -np.inf)
        gain[start, stop] = points[stop] - points[start]
        gain[start, stop] -= _squared_errors(sums, coefficients) / known.range_reach**2
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
