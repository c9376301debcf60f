"""Curves that may be sides of a groove: every piece grown over the pieces that continue it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.pieces import Pieces, ProjectivePoints
from tjscan.groove.settings import SideModel
from tjscan.groove.sides import CubicCurve, Index

SIDE_BENDS: Final = np.array((0.7, 5.0, 100.0, 30.0))
"""Standard deviations of how a candidate bends, in 1/m: nearly straight, a leg, a bead, a weld."""

FEWEST_SEED_POINTS: Final = (7, 7, 4)
"""Points of a piece from which a candidate of each bend grows."""

MOST_GROWTH_ROUNDS: Final = 8

CONTINUING_SIGMAS: Final = 2.8
"""A piece continues a curve if it is off by no more standard deviations."""

SURE_PREDICTION, LEAST_PREDICTION = 0.12e-3, 0.5e-3
"""Standard deviations of a prediction, in metres, by which every piece that continues a curve is
taken, and by which the best of them is."""

SIDE_UNEVENNESS: Final = (0.03e-3, 0.1e-3, 0.14e-3)
"""How far the steel itself leaves a parabola, in metres, by the bend."""

ROUGH_REACHES: Final = ((0, 0.12e-3), (3, 0.5e-3))
"""Kinds of sides that may be rough, as a cut by flame or beads side by side are, and how far their
points lie off them, in metres."""

_HANKEL: Final = np.add.outer(np.arange(3), np.arange(3))


@dataclass(frozen=True, slots=True, eq=False)
class CandidateSides:
    """K curves ``y = a + b u + c u²`` that may be sides.

    Parameters
    ----------
    kind : ndarray of int, shape (K,)
        Which of `SIDE_BENDS`.
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

    def distances(self, points: ProjectivePoints) -> Array:
        """Distances of points behind each curve, about, in metres, shape (K, n)."""
        powers = np.array((np.ones_like(points.u), points.u, points.u**2))
        off = self.coefficients @ powers
        off -= points.y
        off *= points.z
        off /= self.steepness[:, None]
        return np.asarray(off)

    def bows(self) -> Array:
        """How far each leaves its chord in the middle, in metres, shape (K,)."""
        u = np.array((self.first, 0.5 * (self.first + self.last), self.last)).T
        y, _ = self.heights_and_slopes(u)
        sag = y[:, 1] - 0.5 * (y[:, 0] + y[:, 2])
        return np.asarray(np.abs(sag) / y[:, 1] / self.steepness)

    def as_curve(self, k: int) -> CubicCurve:
        """One of them over its tangent in the middle."""
        u = 0.5 * (self.first[k] + self.last[k])
        a, b, c = self.coefficients[k].tolist()
        y, slope = a + u * (b + u * c), b + 2 * u * c
        steep = float(np.hypot(u * slope - y, slope))
        direction = (u * slope - y) / steep, -slope / steep
        return CubicCurve(-u / y, 1 / y, *direction, 0.0, 0.0, float(-c * y**3 / steep**3))


def kinds_of_side(side: SideModel) -> tuple[int, ...]:
    """Which of `SIDE_BENDS` a side may have; the face of a bead may as well be straight."""
    if side.bead:
        return (3,) if side.roughness else (0, 2)
    return (int(side.bend > 2 * SIDE_BENDS[0]),)


def grow_candidates(points: ProjectivePoints, pieces: Pieces, inflation: float) -> CandidateSides:
    """Grow every piece over those that continue it, under each prior of its bend.

    Parameters
    ----------
    points : ProjectivePoints
    pieces : Pieces
        Of these points.
    inflation : float
        By how much correlation raises the variance of a mean of the noise.
    """
    counts = pieces.stop - pieces.first
    seeds = [np.flatnonzero(counts >= fewest) for fewest in FEWEST_SEED_POINTS]
    kind = np.arange(len(seeds)).repeat([len(s) for s in seeds])
    seed = np.concatenate(seeds)
    member = np.zeros((len(seed), len(counts)), dtype=np.bool_)
    member[np.arange(len(seed)), seed] = True
    variance = inflation * points.noise**2
    # What is known of the bend, from the seed: the curve's own does not change much.
    probes, heights = pieces.probes.ravel(), pieces.heights.ravel()
    steep, height = _steepness(pieces.moments[seed])
    prior = variance * (height / steep) ** 6 / SIDE_BENDS[kind] ** 2
    powers = np.array((np.ones_like(probes), probes, probes**2))
    pairs = (powers[:, None] * powers[None]).reshape(9, -1)
    unevenness = np.array(SIDE_UNEVENNESS)[kind, None] ** 2
    own = 2 * variance / counts.repeat(2) * (heights / steep[:, None]) ** 2 + unevenness
    growing = np.arange(len(seed))
    for _ in range(MOST_GROWTH_ROUNDS):
        now, slope = member[growing], steep[growing, None]
        coefficients, inverse = _fit_sums(now @ pieces.moments, prior[growing])
        off = np.abs(coefficients @ powers - heights) / (heights * slope)
        doubt = variance * np.maximum(inverse.reshape(-1, 9) @ pairs, 0.0) / (heights * slope) ** 2
        score = off**2 / (doubt + own[growing])
        score, off, doubt = (v.reshape(*now.shape, 2).max(axis=2) for v in (score, off, doubt))
        fits = (score < CONTINUING_SIGMAS**2) & ~now
        added = fits & (doubt < SURE_PREDICTION**2)
        likely = fits & (doubt < LEAST_PREDICTION**2) & (off < LEAST_PREDICTION)
        best = np.where(likely, score * doubt, np.inf).argmin(axis=1)
        alone = np.flatnonzero(likely.any(axis=1) & ~added.any(axis=1))
        added[alone, best[alone]] = True
        member[growing] |= added
        growing = growing[added.any(axis=1)]
        if not len(growing):
            break
    rough = [(k, m) for k, reach in ROUGH_REACHES for m in _best_ranges(pieces, k, reach, variance)]
    if rough:
        kind = np.concatenate((kind, [k for k, _ in rough]))
        member = np.concatenate((member, [m for _, m in rough]))
    distinct = list(
        {(k, m.tobytes()): i for i, (k, m) in enumerate(zip(kind, member, strict=True))}.values()
    )
    kind, member = kind[distinct], member[distinct]
    sums = member @ pieces.moments
    steep, height = _steepness(sums)
    coefficients, _ = _fit_sums(sums, variance * (height / steep) ** 6 / SIDE_BENDS[kind] ** 2)
    first = member.argmax(axis=1)
    last = member.shape[1] - 1 - member[:, ::-1].argmax(axis=1)
    u = points.u
    error = sums[:, 8] - (coefficients * sums[:, 5:8]).sum(axis=1)
    roughness = np.sqrt(np.maximum(error, 0) / (member @ counts)) * height / steep
    return CandidateSides(
        kind, roughness, coefficients, u[pieces.first[first]], u[pieces.stop[last] - 1]
    )


def _best_ranges(pieces: Pieces, kind: int, reach: float, variance: float) -> Array:
    """Neighbouring pieces that one rough curve explains best, shape (m, P).

    Of all ranges that begin, or end, at the same piece each explains most.
    """
    count = len(pieces.first)
    start, stop = np.triu_indices(count + 1, 1)
    index = np.arange(count)
    member = (start[:, None] <= index) & (index < stop[:, None])
    through = np.concatenate((np.zeros((1, 9)), pieces.moments.cumsum(axis=0)))
    sums = through[stop] - through[start]
    steep, height = _steepness(sums)
    prior = variance * (height / steep) ** 6 / SIDE_BENDS[kind] ** 2
    coefficients, _ = _fit_sums(sums, prior)
    error = sums[:, 8] - (coefficients * sums[:, 5:8]).sum(axis=1)
    points = member @ (pieces.stop - pieces.first)
    gain = np.full((count, count + 1), -np.inf)
    gain[start, stop] = points - error * (height / steep / reach) ** 2
    best = (gain == gain.max(axis=0)) & (gain == gain.max(axis=1)[:, None]) & (gain > 0)
    return member[best[start, stop]]


def _steepness(sums: Array) -> tuple[Array, Array]:
    """How steep the line through some points is, and its height y, from their moments, (m,)."""
    w, a, b, c, d = sums.T[[0, 1, 2, 5, 6]]
    u, y = a / w, c / w
    slope = (d - u * c) / np.maximum(b - u * a, 1e-18)
    return np.hypot(u * slope - y, slope), y


def _fit_sums(sums: Array, prior: Array) -> tuple[Array, Array]:
    """Coefficients, shape (K, 3), and inverse normal matrices, shape (K, 3, 3)."""
    normal = sums[:, _HANKEL]
    normal[:, 2, 2] += prior
    inverse = np.linalg.inv(normal)
    return (inverse @ sums[:, 5:8, None])[..., 0], inverse
