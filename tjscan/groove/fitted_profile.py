"""A profile's points in order, and sides fitted to them with the corners between."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove.curves import CubicCurve, intersect_curves
from tjscan.groove.noise import NoiseCorrelation, estimate_correlation, noise_share_in_fit
from tjscan.groove.segments import Index

OUTLIER_SIGMAS: Final = 3.3
"""Residuals beyond this many standard deviations are outliers."""

LEAST_NOISE: Final = 4e-6
"""Least standard deviation that a threshold rests on, in metres: shape, not noise."""

UNIT_LENGTH: Final = 0.02
"""Metres: lengths along a side are of this order."""

FIXED_WEIGHT: Final = 1e12
"""Weight of a coefficient that has to be zero."""

UNIT_POWERS: Final = UNIT_LENGTH ** np.arange(4)
"""Metres per unit of s / 20 mm, to the powers of a side's coefficients."""

_IDENTITY_4: Final = np.eye(4)


@dataclass(frozen=True, slots=True, eq=False)
class OrderedProfilePoints:
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
class NormalEquations:
    """Normal equations of the coefficients of k sides, without any prior.

    Parameters
    ----------
    matrix : ndarray, shape (k, 4, 4)
    rhs : ndarray, shape (k, 4)
    """

    matrix: Array
    rhs: Array

    def solve_with_prior(self, weight: Array, expected: Array) -> tuple[Array, Array]:
        """Solve for coefficients (k, 4) and inverses (k, 4, 4), with a prior.

        Parameters
        ----------
        weight : ndarray, shape (k, 4)
            What it adds to the diagonals; a coefficient that has to be zero weighs `FIXED_WEIGHT`.
        expected : ndarray, shape (k, 4)
            Its mean, for the other coefficients.
        """
        inverse = np.linalg.inv(self.matrix + weight[:, :, None] * _IDENTITY_4)
        rhs = self.rhs + np.where(weight < FIXED_WEIGHT, weight * expected, 0.0)
        return (inverse @ rhs[:, :, None])[:, :, 0], np.asarray(inverse, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class FittedProfile:
    """k fitted sides and the corners between them.

    Parameters
    ----------
    curves : tuple of CubicCurve
        From the wall.
    places : tuple of (float, float)
        s of corner i on side i and on side i + 1; k - 1 pairs.
    corners : ndarray, shape (k - 1, 2)
        x and z in metres.
    edges : list of int
        First point of each side, and the number n of points; k + 1.
    along : ndarray, shape (n,)
        Each point's s on its side.
    residuals : ndarray, shape (n,)
        Distance behind it, in metres.
    keep : ndarray of bool, shape (n,)
        Points the fit rests on.
    sigmas : ndarray, shape (k,)
        Standard deviation of each side's residuals, in metres.
    curved : ndarray of bool, shape (k,)
        Which sides are curved.
    equations : NormalEquations
        What the coefficients solve.
    inverse : ndarray, shape (k, 4, 4)
        Inverses of their matrices with the prior, in powers of s / 20 mm.
    weight : ndarray, shape (k, 4)
        What the prior added to their diagonals.
    counts : ndarray, shape (k,)
        Number of points that each side's fit rests on.
    middles : tuple of float
        Mean s of the points that each side's fit rests on.
    noise : NoiseCorrelation, optional
        How the residuals of neighbouring columns correlate.
    straight : ndarray, shape (k,), optional
        Logarithm of the odds that a side is straight.
    """

    curves: tuple[CubicCurve, ...]
    places: tuple[tuple[float, float], ...]
    corners: Array
    edges: list[int]
    along: Array
    residuals: Array
    keep: NDArray[np.bool_]
    sigmas: Array
    curved: NDArray[np.bool_]
    equations: NormalEquations
    inverse: Array
    weight: Array
    counts: Index
    middles: tuple[float, ...]
    noise: NoiseCorrelation | None = None
    straight: Array | None = None

    def kept_along(self, k: int) -> Array:
        """Values of s of the points that the fit of side k rests on."""
        own = self.points_of(k)
        return self.along[own][self.keep[own]]

    def points_of(self, k: int) -> slice:
        """The points of side k among those of the row."""
        return slice(self.edges[k], self.edges[k + 1])

    @property
    def parameter_counts(self) -> Index:
        """Number of coefficients fitted to each side, shape (k,)."""
        return np.asarray(2 + self.curved)

    @property
    def inlier_shares(self) -> Array:
        """Share of each side's points that the fit rests on, shape (k,)."""
        return np.asarray(self.counts / np.diff(self.edges))


def corners_between_sides(
    sides: tuple[CubicCurve, ...], near: Array
) -> tuple[Array, tuple[tuple[float, float], ...]] | None:
    """Intersections of neighbouring sides, shape (k - 1, 2); None where they don't meet.

    Parameters
    ----------
    sides : tuple of CubicCurve
        The k sides.
    near : ndarray, shape (k - 1, 2)
        Where the corners were before, x and z in metres.
    """
    places, corners = [], []
    for (a, b), (x, z) in zip(pairwise(sides), near.tolist(), strict=True):
        place = intersect_curves(a, b, a.position_along_chord(x, z))
        if place is None:
            return None
        places.append(place)
        corners.append(a.points_at(place[0]))
    return np.array(corners), tuple(places)


def points_on_sides(fitted: FittedProfile) -> NDArray[np.bool_]:
    """Points on their sides, shape (n,), with those that a fit left out for what lies beside."""
    close = OUTLIER_SIGMAS * max(float(np.median(fitted.sigmas)), LEAST_NOISE)
    return np.asarray(fitted.keep | (np.abs(fitted.residuals) < close))


def estimate_noise_correlation(
    row: OrderedProfilePoints, fitted: FittedProfile
) -> NoiseCorrelation:
    """Estimate the correlation of the columns' noise from the residuals of all sides.

    Parameters
    ----------
    row : OrderedProfilePoints
    fitted : FittedProfile
    """
    keep = fitted.keep
    scaled = fitted.residuals[keep] / np.maximum(fitted.sigmas, 1e-9).repeat(fitted.counts)
    return estimate_correlation(
        scaled, row.columns[keep], row.count, int(fitted.parameter_counts.sum())
    )


def noise_variances(fitted: FittedProfile, noise: NoiseCorrelation) -> Array:
    """Variance of each side's noise, with what its fit took up, in m², shape (k,)."""
    lost = noise_share_in_fit(fitted.parameter_counts, noise.variance_inflation, fitted.counts)
    return np.asarray(fitted.sigmas**2 / (1 - lost))
