"""The sides of a groove as shallow cubics, the corners where they meet, and fits of both to points.

What the stages of reading hand to each other: a profile's points in order, a polyline to start
from, the sides fitted to the points, and the fit of a groove with what is known of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import hypot, nan
from statistics import median
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove.prior import SectionEvidence
from tjscan.groove.settings import GrooveModel
from tjscan.laser.profile import Profile

Index = NDArray[np.intp]

OUTLIER_SIGMAS: Final = 3.3
"""Residuals beyond this many standard deviations are outliers."""

LEAST_NOISE: Final = 4e-6
"""Least standard deviation that a threshold rests on, in metres: shape, not noise."""

SCALING_LENGTH: Final = 0.02
"""Metres: lengths along a side are of this order."""

FIXED_WEIGHT: Final = 1e12
"""Weight of a coefficient that has to be zero."""

SCALING_LENGTH_POWERS: Final = SCALING_LENGTH ** np.arange(4)
"""Metres per unit of s / 20 mm, to the powers of a side's coefficients."""

SUPPORT_NEIGHBOURS: Final = 4
"""Points on either side of one that show, with it, whether it lies on a side."""

_SUPPORT_WINDOW: Final = np.ones(2 * SUPPORT_NEIGHBOURS + 1)


LEAST_RAY_SINE: Final = 0.2
"""Least sine of the angle between a ray and a flank that shows how far a point moved along it."""

STEEPEST_SLOPE: Final = 1.5
"""Largest slope over its chord that a side may have where it meets its neighbour."""

_FARTHEST_CORNER_DISTANCE: Final = 1.0  # metres along a side: no corner is there
_PARALLEL_SINE: Final = 1e-3  # sine below which two sides do not meet
_SETTLED_NEWTON_STEP: Final = 1e-10  # metres


class CubicCurve(NamedTuple):
    """Cubic curve over a chord: ``centre + s direction + (c0 + c1 s + c2 s² + c3 s³) normal``.

    The direction runs from the wall to the leg, the normal (tz, -tx) away from the sensor.
    """

    cx: float
    cz: float
    tx: float
    tz: float
    c0: float = 0.0
    c1: float = 0.0
    c2: float = 0.0
    c3: float = 0.0

    def local_coordinates(self, points: Array) -> tuple[Array, Array]:
        """Coordinates of points, shape (n, 2), along and away from the chord, (n,) each."""
        x, z = points[:, 0] - self.cx, points[:, 1] - self.cz
        return x * self.tx + z * self.tz, x * self.tz - z * self.tx

    def height_and_slope(self, s: float) -> tuple[float, float]:
        """Height over the chord and slope at s."""
        return (
            self.c0 + s * (self.c1 + s * (self.c2 + s * self.c3)),
            self.c1 + s * (2 * self.c2 + 3 * s * self.c3),
        )

    def signed_distances(self, points: Array) -> Array:
        """Signed distances of points, shape (n, 2), from the curve, positive behind it, (n,)."""
        s, d = self.local_coordinates(points)
        return np.asarray(d - (self.c0 + s * (self.c1 + s * (self.c2 + s * self.c3))))

    def point_on_curve(self, s: float) -> tuple[float, float]:
        """Point of the curve at s."""
        q, _ = self.height_and_slope(s)
        return self.cx + s * self.tx + q * self.tz, self.cz + s * self.tz - q * self.tx

    def tangent_at(self, s: float) -> tuple[float, float]:
        """Unit tangent of the curve at s."""
        _, slope = self.height_and_slope(s)
        scale = 1 / hypot(1.0, slope)
        return (self.tx + slope * self.tz) * scale, (self.tz - slope * self.tx) * scale

    def sine_with_ray(self, s: float) -> float:
        """Sine of the angle between the curve and the ray that hits it at s."""
        x, z = self.point_on_curve(s)
        tx, tz = self.tangent_at(s)
        return max(abs(x * tz - z * tx) / hypot(x, z), LEAST_RAY_SINE)

    def chord_sines_with_rays(self, points: Array) -> Array:
        """Sines of the angles between the chord and the rays to points, shape (n, 2)."""
        square = points @ np.array((self.tz, -self.tx)) / np.linalg.norm(points, axis=1)
        return np.asarray(np.maximum(np.abs(square), LEAST_RAY_SINE))

    def position_along_chord(self, x: float, z: float) -> float:
        """Parameter s of a point, along the chord."""
        return (x - self.cx) * self.tx + (z - self.cz) * self.tz

    def rebased_at_tangent(self, s: float) -> CubicCurve:
        """Nearly the same curve, written over its tangent at s."""
        _, slope = self.height_and_slope(s)
        bend = (self.c2 + 3 * s * self.c3) / hypot(1.0, slope) ** 3
        return CubicCurve(*self.point_on_curve(s), *self.tangent_at(s), 0.0, 0.0, bend, self.c3)


def intersect_curves(a: CubicCurve, b: CubicCurve, start: float) -> tuple[float, float] | None:
    """Intersection of two curves: values of s on `a` and on `b`, by Newton's method from `start`.

    None if they do not meet near enough to the start, or touch so nearly that it does not settle.
    """
    rx, rz = a.cx - b.cx, a.cz - b.cz
    along, away = rx * b.tx + rz * b.tz, rx * b.tz - rz * b.tx
    cos, sin = a.tx * b.tx + a.tz * b.tz, a.tx * b.tz - a.tz * b.tx
    s = start
    for _ in range(12):
        q, dq = a.height_and_slope(s)
        qb, dqb = b.height_and_slope(along + s * cos - q * sin)
        slope = sin + dq * cos - dqb * (cos - dq * sin)
        if abs(slope) < _PARALLEL_SINE:
            return None
        step = (away + s * sin + q * cos - qb) / slope
        s -= step
        if abs(step) < _SETTLED_NEWTON_STEP:
            break
    else:
        return None
    if not abs(s) < _FARTHEST_CORNER_DISTANCE or max(abs(dq), abs(dqb)) > STEEPEST_SLOPE:
        return None
    q, _ = a.height_and_slope(s)
    return s, along + s * cos - q * sin


def end_of_support(support: NDArray[np.bool_]) -> int:
    """Index after the last point around which most points support a side."""
    if not len(support):
        return 0
    near = np.convolve(support, _SUPPORT_WINDOW)[
        SUPPORT_NEIGHBOURS : SUPPORT_NEIGHBOURS + len(support)
    ]
    where = (near > SUPPORT_NEIGHBOURS).nonzero()[0]
    return int(where[-1]) + 1 if len(where) else 0


def select_points(profile: Profile, chosen: Index | NDArray[np.bool_] | slice) -> Profile:
    """Some of a profile's points, by their numbers a mask or a slice."""
    x_s, z_s = profile.x_s[chosen], profile.z_s[chosen]
    return replace(profile, x_s=x_s, z_s=z_s, columns=profile.columns[chosen])


class Polyline(NamedTuple):
    """Curves for the sides of a groove, from wall to leg, before they are fitted to the points.

    Parameters
    ----------
    sides : tuple of CubicCurve
    corners : ndarray, shape (k - 1, 2)
        Where neighbours meet, x and z in metres.
    cost : float
        What all points pay, in outliers.
    """

    sides: tuple[CubicCurve, ...]
    corners: Array
    cost: float


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
    spans : tuple of slice
        The points of each side.
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
    equations : tuple of ndarray
        Normal equations that the coefficients solve, without any prior: matrices, shape
        (k, 4, 4), and right-hand sides, shape (k, 4).
    inverse : ndarray, shape (k, 4, 4)
        Inverses of their matrices with the prior, in powers of s / 20 mm.
    weight : ndarray, shape (k, 4)
        What the prior added to their diagonals.
    counts : ndarray, shape (k,)
        Number of points that each side's fit rests on.
    middles : tuple of float
        Mean s of the points that each side's fit rests on.
    variance_inflation : float
        By how much the correlation of neighbouring columns raises the variance of a mean of many.
    straight : ndarray, shape (k,), optional
        Logarithm of the odds that a side is straight; None if this is not estimated.
    """

    curves: tuple[CubicCurve, ...]
    places: tuple[tuple[float, float], ...]
    corners: Array
    edges: list[int]
    spans: tuple[slice, ...]
    along: Array
    residuals: Array
    keep: NDArray[np.bool_]
    sigmas: Array
    curved: NDArray[np.bool_]
    equations: tuple[Array, Array]
    inverse: Array
    weight: Array
    counts: Index
    middles: tuple[float, ...]
    variance_inflation: float = 1.0
    straight: Array | None = None

    def kept_along(self, k: int) -> Array:
        """Values of s of the points that the fit of side k rests on."""
        own = self.spans[k]
        return self.along[own][self.keep[own]]

    def corner_shift(self, corner: int, side: int) -> Array:
        """How far a corner moves, shape (2,), per metre that one of its sides moves back.

        Parameters
        ----------
        corner : int
            Number of the corner.
        side : int
            Number of the side before it or after it.
        """
        j = side - corner
        own = self.curves[side].tangent_at(self.places[corner][j])
        tx, tz = self.curves[corner + 1 - j].tangent_at(self.places[corner][1 - j])
        return np.array((tx, tz)) / (tx * own[1] - tz * own[0])

    def distances_from_sides(self, points: Array) -> Array:
        """Signed distances of points, shape (n, 2), from all sides, drawn on, shape (k, n)."""
        return np.array([curve.signed_distances(points) for curve in self.curves])

    @property
    def points_on_sides(self) -> NDArray[np.bool_]:
        """Points on their sides, shape (n,), with those left out of a fit for their neighbours."""
        close = OUTLIER_SIGMAS * max(median(self.sigmas.tolist()), LEAST_NOISE)
        return np.asarray(self.keep | (np.abs(self.residuals) < close))


@dataclass(frozen=True, slots=True, eq=False)
class GrooveFit:
    """A groove fitted to a profile, with its cost and what speaks against it.

    Parameters
    ----------
    row : Profile
        Its points from the wall to the leg, on bare steel if a prior was given.
    model : GrooveModel
        The likeliest of the groove's forms; k sides.
    fitted : FittedProfile
        Its sides and corners.
    cost : float
        What all points and sides pay, in outliers.
    objection : str, optional
        Why the points do not support it.
    steel_covariance : float or ndarray, shape (2 k, 2 k)
        What the doubt about scale and light between the faces adds to the covariance of its
        corners and of its outer sides' angles.
    other_readings : float or ndarray, shape (2 k, 2 k)
        What other readings of the points add to it.
    covariance : ndarray, shape (2 k, 2 k), optional
        Of the corners' coordinates and of the angles of the first and the last side, all causes
        together.
    probability : float
        That the groove has this form, not another one.
    evidence : SectionEvidence, optional
        What the profile shows, by itself, of what persists along the groove.
    """

    row: Profile
    model: GrooveModel
    fitted: FittedProfile
    cost: float
    objection: str | None = None
    steel_covariance: Array | float = 0.0
    other_readings: Array | float = 0.0
    covariance: Array | None = None
    probability: float = nan
    evidence: SectionEvidence | None = None


def corners_between_sides(
    sides: tuple[CubicCurve, ...], near: Array
) -> tuple[Array, tuple[tuple[float, float], ...]] | None:
    """Intersections of neighbouring sides, shape (k - 1, 2); None if they do not meet.

    Parameters
    ----------
    sides : tuple of CubicCurve
        The k sides.
    near : ndarray, shape (k - 1, 2)
        The corners before, x and z in metres.
    """
    places, corners = [], []
    for (a, b), (x, z) in zip(pairwise(sides), near.tolist(), strict=True):
        place = intersect_curves(a, b, a.position_along_chord(x, z))
        if place is None:
            return None
        places.append(place)
        corners.append(a.point_on_curve(place[0]))
    return np.array(corners), tuple(places)
