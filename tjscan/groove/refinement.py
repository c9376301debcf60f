"""From a hypothesis to the most likely outline: sides straight or curved, corners, covariance."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import log
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.frames import Array
from tjscan.groove.curves import Curve, Fit, fit, meet
from tjscan.groove.noise import Correlation, correlation, covariances
from tjscan.groove.segments import Index

CUT: Final = 3.3
"""Residuals beyond this many standard deviations are outliers."""

LEAST_NOISE: Final = 4e-6
"""Least standard deviation that a threshold rests on, in metres: shape, not noise."""

SHADOW: Final = 0.7
"""Behind the surface by more, in standard deviations, and next to a run of outliers: a ghost."""

SHADOW_RUN: Final = 3

SETTLED: Final = 1e-7
"""Corners that move less from one round to the next are final, in metres."""

MOST_ROUNDS: Final = 8

_TO_SIGMA: Final = 1.4826  # of the median absolute deviation of Gaussian noise


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """A profile's points, ordered from the wall to the leg.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        x and z in metres.
    tangents : ndarray, shape (n,)
        Their bearings from the sensor, rising.
    columns : ndarray of int, shape (n,)
        The sensor's column of each.
    count : int
        Columns of the sensor.
    """

    points: Array
    tangents: Array
    columns: Index
    count: int


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Fitted sides and the corners between them.

    Parameters
    ----------
    fits : tuple of Fit
        k sides, from the wall.
    edges : tuple of int
        Points ``edges[i]`` up to ``edges[i + 1]`` belong to side i; k + 1 numbers.
    places : tuple of (float, float)
        s of corner i on side i and on side i + 1; k - 1 pairs.
    corners : ndarray, shape (k - 1, 2)
    sigmas : tuple of float
        Standard deviation of the residuals of each side, in metres.
    """

    fits: tuple[Fit, ...]
    edges: tuple[int, ...]
    places: tuple[tuple[float, float], ...]
    corners: Array
    sigmas: tuple[float, ...]


def refine(row: Row, sides: list[Curve], curved: list[bool], tolerance: float) -> Outline | None:
    """Fit all sides to the points that their corners leave them, over and over until it settles.

    A side that may be curved starts as a parabola and stays one if that is the likelier model
    by the Bayesian information criterion, counting correlated points as fewer.

    Parameters
    ----------
    row : Row
    sides : list of Curve
        A hypothesis, from the wall.
    curved : list of bool
        Which sides may be curved.
    tolerance : float
        Distance from the hypothesis within which points belong to it, in metres.
    """
    degrees = [2 if c else 1 for c in curved]
    limits = [tolerance] * len(sides)
    outline = None
    decided = False
    for round_ in range(MOST_ROUNDS):
        last = outline
        outline = _round(row, sides, degrees, limits)
        if outline is None:
            return None
        sides = [f.curve for f in outline.fits]
        limits = [min(max(CUT * s, CUT * LEAST_NOISE), tolerance) for s in outline.sigmas]
        moved = np.inf if last is None else float(np.abs(outline.corners - last.corners).max())
        if decided and moved < SETTLED:
            break
        if not decided and ((moved < 0.2 * tolerance and round_ >= 2) or round_ == MOST_ROUNDS - 3):
            decided = True
            degrees = _evidence(row, outline, degrees)
    return outline


def _round(row: Row, sides: list[Curve], degrees: list[int], limits: list[float]) -> Outline | None:
    """Corners, who owns which point, outliers, fits, corners again."""
    met = _corners(sides)
    if met is None:
        return None
    corners, _ = met
    edges = [0, *np.searchsorted(row.tangents, -corners[:, 0] / corners[:, 1]), len(row.points)]
    fits, sigmas = [], []
    for k, side in enumerate(sides):
        own = slice(int(edges[k]), int(edges[k + 1]))
        points = row.points[own]
        if len(points) < 3:
            return None
        residuals = side.distances(points)
        keep = _unshadowed(residuals, np.abs(residuals) < limits[k], limits[k] / CUT)
        fitted = fit(points, keep, side, degrees[k])
        if fitted is None:
            return None
        fits.append(fitted)
        sigmas.append(_TO_SIGMA * float(np.median(np.abs(fitted.residuals[keep]))))
    met = _corners([f.curve for f in fits])
    if met is None:
        return None
    pooled = float(np.average(sigmas, weights=[np.count_nonzero(f.keep) for f in fits]))
    # A side of few points can't tell its own noise well: lean on the others by 20 points.
    shared = [
        (np.count_nonzero(f.keep) * s + 20 * pooled) / (np.count_nonzero(f.keep) + 20)
        for f, s in zip(fits, sigmas, strict=True)
    ]
    return Outline(tuple(fits), tuple(int(e) for e in edges), met[1], met[0], tuple(shared))


def _corners(sides: list[Curve]) -> tuple[Array, tuple[tuple[float, float], ...]] | None:
    """Where neighbours meet, shape (k - 1, 2), and where on both."""
    places, corners = [], []
    for a, b in pairwise(sides):
        place = meet(a, b, a.along(b.cx, b.cz))
        if place is None:
            return None
        places.append(place)
        corners.append(a.at(place[0]))
    return np.array(corners), tuple(places)


def _unshadowed(residuals: Array, keep: NDArray[np.bool_], sigma: float) -> NDArray[np.bool_]:
    """Drop points that lead over from the surface to a run of reflections behind it."""
    out = ~keep
    if np.count_nonzero(out) < SHADOW_RUN:
        return keep
    behind = np.concatenate(([0], residuals > SHADOW * sigma, [0])).astype(np.int8)
    bounds = np.flatnonzero(np.diff(behind))
    first, last = bounds[::2], bounds[1::2]
    outliers = np.concatenate(([0], np.cumsum(out)))
    ghost = outliers[last] - outliers[first] >= SHADOW_RUN
    keep = keep.copy()
    for a, b in zip(first[ghost], last[ghost], strict=True):
        keep[a:b] = False
    return keep


def noise_of(row: Row, outline: Outline) -> Correlation:
    """Correlation of the noise, pooled over all sides."""
    scaled, columns = [], []
    for k, f in enumerate(outline.fits):
        scaled.append(f.residuals[f.keep] / max(outline.sigmas[k], 1e-9))
        columns.append(row.columns[outline.edges[k] : outline.edges[k + 1]][f.keep])
    return correlation(np.concatenate(scaled), np.concatenate(columns), row.count)


def coefficient_covariances(row: Row, outline: Outline, noise: Correlation) -> list[Array]:
    """Covariance of the coefficients of each side."""
    fits = outline.fits
    columns = [
        row.columns[outline.edges[k] : outline.edges[k + 1]][f.keep] for k, f in enumerate(fits)
    ]
    bases = [f.basis[:, f.keep] for f in fits]
    return covariances(noise, bases, [f.inverse for f in fits], list(outline.sigmas), columns)


def _evidence(row: Row, outline: Outline, degrees: list[int]) -> list[int]:
    """Degree of each side by the Bayesian information criterion."""
    noise = noise_of(row, outline)
    spread = coefficient_covariances(row, outline, noise)
    chosen = []
    for f, degree, cov in zip(outline.fits, degrees, spread, strict=True):
        if degree == 1:
            chosen.append(1)
            continue
        effective = max(np.count_nonzero(f.keep) / noise.inflation, 3.0)
        chosen.append(2 if f.curve.c2**2 > cov[2, 2] * log(effective) else 1)
    return chosen
