"""The laser line on a ball: an arc, robustly fitted, with its errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import chdtri

from tjscan.calibration.fits.consensus import (
    MAX_SCATTER_RATIO,
    OUTLIER_SIGMAS,
    SCORED_POINTS,
    InlierMask,
    best_hypothesis,
    evenly_spaced_indices,
    inlier_scatter,
    refit_and_trim,
    sample_index_sets,
)
from tjscan.calibration.fits.line import distances_from_line
from tjscan.calibration.noise import NoiseModel
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, frozen_arrays
from tjscan.laser.profile import Profile

MIN_POINTS: Final = 20
"""An arc has at least so many points."""
MIN_INLIER_SHARE: Final = 0.15
"""At least this share of a profile's points lies on the arc: a ball fills less of it than a
board does."""
MIN_ARC_ANGLE: Final = float(np.radians(30.0))
"""Radians; on a shorter arc radius and centre hardly come apart."""
MAX_RADIUS: Final = 1.0
"""Metres; a larger circle is a straight line."""
STRAIGHT_PROBABILITY: Final = 1e-6
"""Probability to take a straight line for an arc: most profiles are of straight things."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class CircleFit:
    """A circle fitted to the arc of points in a profile, frame s.

    Parameters
    ----------
    centre_s : ndarray, shape (3,)
        y = 0, in metres.
    radius : float
        Metres.
    covariance : ndarray, shape (3, 3)
        Of centre x, centre z and radius, square metres.
    scatter : float
        RMS distance of its points from it, in metres.
    inlier : ndarray of bool, shape (columns,)
        Which columns of the profile lie on the arc.
    """

    centre_s: Array
    radius: float
    covariance: Array
    scatter: float
    inlier: NDArray[np.bool_]

    @property
    def point_count(self) -> int:
        """Number of points on the arc."""
        return int(self.inlier.sum())


def fit_dominant_circle(
    profile: Profile, noise: NoiseModel, largest: float = MAX_RADIUS
) -> CircleFit:
    """Fit the circle that most points of a profile lie on.

    Parameters
    ----------
    profile : Profile
        Of a ball.
    noise : NoiseModel
        States the range noise of a point.
    largest : float
        Largest radius to accept, metres.

    Raises
    ------
    CalibrationRefused
        If too few points lie on one circle, or their arc is too short.
    """
    valid = profile.valid
    points = np.column_stack((profile.x_s[valid], profile.z_s[valid]))
    if len(points) < MIN_POINTS:
        raise CalibrationRefused(
            "no arc seen",
            f"the profile holds {len(points)} points, an arc needs {MIN_POINTS}; bring the ball "
            "into the sensor's range",
        )
    inlier = _start(points, noise.range, largest)
    if inlier.sum() >= MIN_POINTS:
        inlier = refit_and_trim(
            lambda m: _distances(points, _algebraic(points[m])), inlier, noise.range
        )
    if inlier.sum() < max(MIN_POINTS, MIN_INLIER_SHARE * len(points)):
        raise CalibrationRefused(
            "no arc seen",
            f"only {inlier.sum()} of {len(points)} points lie on one circle within "
            f"{1e3 * OUTLIER_SIGMAS * MAX_SCATTER_RATIO * noise.range:.2f} mm; "
            "let the line cross the ball nearer to "
            "its middle",
        )
    _check_curved(points, inlier, noise)
    return _describe(points, inlier, valid, noise, largest)


def _check_curved(points: Array, inlier: InlierMask, noise: NoiseModel) -> None:
    """Refuse points that a straight line explains as well, by the ratio of the likelihoods.

    All points from one end of the arc to the other count, and those that are no part of either
    curve cost the same: an arc that was picked out of a line has left the line's points out.
    """
    at = np.flatnonzero(inlier)
    span = points[at[0] : at[-1] + 1]
    off_circle = _distances(span, _algebraic(points[inlier]))
    sigma = inlier_scatter(off_circle, noise.range)
    straight = refit_and_trim(
        lambda m: distances_from_line(span, m), np.ones(len(span), dtype=bool), sigma
    )
    off_line = distances_from_line(span, straight)
    costs = [
        np.minimum((off / sigma) ** 2, OUTLIER_SIGMAS**2).sum() for off in (off_circle, off_line)
    ]
    # Neighbours err alike: n points count as fewer. The circle has one more unknown.
    gain = (costs[1] - costs[0]) / noise.mean_variance_inflation
    if gain < float(chdtri(1, STRAIGHT_PROBABILITY)):
        raise CalibrationRefused(
            "no arc seen",
            f"{len(span)} points lie on a straight line as well as on a circle; let the line cross "
            "the ball nearer to its middle",
        )


def _start(points: Array, sigma: float, largest: float) -> InlierMask:
    """Points close to the circle through three of them that most of them are close to."""
    tolerance = 2 * OUTLIER_SIGMAS * sigma
    triple = points[sample_index_sets(len(points), 3)]
    # Circumcentre: both chords from the first point are bisected.
    chord = triple[:, 1:] - triple[:, :1]
    half = 0.5 * np.einsum("kij,kij->ki", chord, chord)
    twice_area = chord[:, 0, 0] * chord[:, 1, 1] - chord[:, 0, 1] * chord[:, 1, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (half[:, 0] * chord[:, 1, 1] - half[:, 1] * chord[:, 0, 1]) / twice_area
        z = (half[:, 1] * chord[:, 0, 0] - half[:, 0] * chord[:, 1, 0]) / twice_area
    radius = np.hypot(x, z)
    round_enough = radius <= largest
    if not round_enough.any():
        return np.zeros(len(points), dtype=bool)
    circles = np.column_stack((triple[:, 0] + np.column_stack((x, z)), radius))[round_enough]
    few = points[evenly_spaced_indices(len(points), SCORED_POINTS)]
    away = np.linalg.norm(few[None] - circles[:, None, :2], axis=2) - circles[:, 2:]
    return np.abs(_distances(points, circles[best_hypothesis(away, tolerance)])) < tolerance


def _distances(points: Array, circle: Array) -> Array:
    """Signed distances of points from a circle (x, z, radius)."""
    return np.asarray(np.hypot(*(points - circle[:2]).T) - circle[2])


def _algebraic(points: Array) -> Array:
    """Circle (x, z, radius) by linear least squares (Kåsa 1976): a start, and quick."""
    middle = points.mean(axis=0)
    p = points - middle
    A = np.column_stack((2 * p, np.ones(len(p))))
    (x, z, c), *_ = np.linalg.lstsq(A, np.einsum("ij,ij->i", p, p), rcond=None)
    return np.array((x + middle[0], z + middle[1], np.sqrt(c + x * x + z * z)))


def _describe(
    points: Array, inlier: InlierMask, valid: InlierMask, noise: NoiseModel, largest: float
) -> CircleFit:
    kept = points[inlier]

    def jacobian(circle: Array) -> Array:
        away = circle[:2] - kept
        return np.column_stack((away / np.hypot(*away.T)[:, None], -np.ones(len(kept))))

    def residuals(circle: Array) -> Array:
        return _distances(kept, circle)

    found = least_squares(residuals, _algebraic(kept), jacobian, method="lm")
    circle = found.x
    towards = (kept - circle[:2]) @ -np.array((0.0, 1.0))
    angle = np.arctan2(kept[:, 0] - circle[0], towards)  # zero on the sensor's side
    if circle[2] > largest or np.ptp(angle) < MIN_ARC_ANGLE:
        raise CalibrationRefused(
            "no arc seen",
            f"the arc spans {np.degrees(np.ptp(angle)):.0f}° of a circle of "
            f"{1e3 * circle[2]:.1f} mm, too little to fix its centre; "
            f"{np.degrees(MIN_ARC_ANGLE):.0f}° are needed",
        )
    J = jacobian(circle)
    scatter = float(np.sqrt(found.fun @ found.fun / (len(kept) - 3)))
    # Range errors act along z; steep flanks of the ball move less. Taking them as square to the
    # arc everywhere is on the safe side.
    covariance = (
        noise.mean_variance_inflation
        * max(noise.range, scatter) ** 2
        * np.asarray(np.linalg.inv(J.T @ J))
    )
    columns = np.zeros(len(valid), dtype=bool)
    columns[np.flatnonzero(valid)[inlier]] = True
    centre = np.array((circle[0], 0.0, circle[1]))
    return CircleFit(centre, float(circle[2]), covariance, scatter, columns)
