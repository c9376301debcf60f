"""How uncertain the corners of a fit are, and the directions of its outer sides."""

from __future__ import annotations

from math import hypot

import numpy as np
import scipy  # its parts are loaded at first use

from tjscan.core.frames import Array
from tjscan.groove.fitted_profile import (
    UNIT_POWERS,
    FittedProfile,
    OrderedProfilePoints,
    estimate_noise_correlation,
    noise_variances,
)
from tjscan.groove.models import GrooveModel, SideModel
from tjscan.groove.noise import NoiseCorrelation, correlated_sums
from tjscan.groove.refinement import (
    prior_shape_means,
    prior_shape_sigmas,
    prior_uncertainty_terms,
    prior_weights,
)
from tjscan.groove.shape import estimate_shape_errors


def corner_covariance(
    row: OrderedProfilePoints, fitted: FittedProfile, model: GrooveModel
) -> Array:
    """Covariance of corners and of both end tangents' angles, shape (2 k, 2 k) for k sides.

    Parameters are those of `corner_estimates`.
    """
    return corner_estimates(row, fitted, model)[1]


def corner_estimates(
    row: OrderedProfilePoints, fitted: FittedProfile, model: GrooveModel
) -> tuple[Array, Array]:
    """Corners corrected for the sides' shapes, and their covariance with both end tangents.

    Each corner X lies on both its sides, so for either ``m · dX = b · dc`` with m the side's
    normal there and b the derivatives of its height by its coefficients c.

    Parameters
    ----------
    row : OrderedProfilePoints
    fitted : FittedProfile
        k sides.
    model : GrooveModel
        What they are like.

    Returns
    -------
    ndarray, shape (k - 1, 2)
        x and z of the corners, in metres: where the sides meet, moved to where the points beside
        them show the surface to be.
    ndarray, shape (2 k, 2 k)
        Of their coordinates and of the angles of the first and the last side's tangents.
    """
    noise = fitted.noise or estimate_noise_correlation(row, fitted)
    spread = _coefficient_covariances(row, fitted, noise, model.sides)
    k = len(fitted.curves)
    jacobian = np.zeros((2 * k, 4 * k))
    for i, place in enumerate(fitted.places):
        (a, b), (sa, sb) = fitted.curves[i : i + 2], place
        (ax, az), (bx, bz) = a.tangent_at(sa), b.tangent_at(sb)
        # Normals are (tz, -tx); heights count along the chord's, 1 / cos of the slope farther.
        wa = 1.0 / hypot(1.0, a.height_and_slope(sa)[1])
        wb = 1.0 / hypot(1.0, b.height_and_slope(sb)[1])
        det = ax * bz - az * bx
        jacobian[2 * i : 2 * i + 2, 4 * i : 4 * i + 8] = [
            [-bx * wa * p / det for p in _powers(sa)] + [ax * wb * p / det for p in _powers(sb)],
            [-bz * wa * p / det for p in _powers(sa)] + [az * wb * p / det for p in _powers(sb)],
        ]
    ends = ((0, 0, fitted.places[0][0]), (k - 1, k - 2, fitted.places[-1][1]))
    for row_, (side, corner, s) in enumerate(ends, start=2 * k - 2):
        curve = fitted.curves[side]
        _, slope = curve.height_and_slope(s)
        # A growing slope turns the tangent towards the normal (tz, -tx): against atan2(z, x).
        turned = -1.0 / (1.0 + slope * slope)
        jacobian[row_, 4 * side : 4 * side + 4] = 0.0, turned, 2 * s * turned, 3 * s * s * turned
        bend = turned * (2 * curve.c2 + 6 * s * curve.c3)
        step = bend * np.array((curve.tx, curve.tz))
        jacobian[row_] += step @ jacobian[2 * corner : 2 * corner + 2]
    # Sides are fitted apart from each other.
    parts = jacobian.reshape(2 * k, k, 4).transpose(1, 0, 2)
    covariance = (parts @ spread @ parts.transpose(0, 2, 1)).sum(axis=0)
    errors = estimate_shape_errors(row, fitted, model.sides)
    corners = fitted.corners.copy()
    for i, j in zip(*errors.sigma.nonzero(), strict=True):
        moves = jacobian[2 * i : 2 * i + 2, 4 * (i + j)]
        corners[i] += errors.shift[i, j] * moves
        own = slice(2 * i, 2 * i + 2)
        covariance[own, own] += errors.sigma[i, j] ** 2 * np.outer(moves, moves)
    return corners, np.asarray(covariance)


def _powers(s: float) -> tuple[float, float, float, float]:
    return 1.0, s, s * s, s * s * s


def _coefficient_covariances(
    row: OrderedProfilePoints,
    fitted: FittedProfile,
    noise: NoiseCorrelation,
    model: tuple[SideModel, ...],
) -> Array:
    """Covariance of the coefficients c0 to c3 of each side, shape (k, 4, 4).

    Noise enters through the points, the unknown bend and twist through the prior: ``inverse
    (sigma² B R Bᵀ + W S W) inverse``. Whether a side is straight is not certain either: what
    was not chosen, with its own coefficients, counts by how likely it is (Bayesian model
    averaging).
    """
    spread, expected = prior_shape_sigmas(model), prior_shape_means(model)
    keep = fitted.keep
    u = fitted.along[keep] / UNIT_POWERS[1]
    basis = np.empty((4, len(u)))
    basis[0], basis[1] = 1.0, u
    np.multiply(u, u, out=basis[2])
    np.multiply(basis[2], u, out=basis[3])
    meat = correlated_sums(noise, basis, fitted.counts, row.columns[keep])
    meat *= noise_variances(fitted, noise)[:, None, None]
    bends = spread[:, 0] > 0
    here = UNIT_POWERS * [(c.c0, c.c1, c.c2, c.c3) for c in fitted.curves]
    total = _sandwich(fitted.inverse, meat, fitted.weight, spread)
    if fitted.straight is not None:
        other = prior_weights(
            spread, bends & ~fitted.curved, fitted.sigmas, noise.variance_inflation
        )
        there, inverse = fitted.equations.solve_with_prior(other, expected)
        away = there - here
        odds = np.where(fitted.curved, fitted.straight, -fitted.straight)
        share = np.where(bends, scipy.special.expit(odds), 0.0)[:, None, None]
        total *= 1 - share
        total += share * _sandwich(inverse, meat, other, spread)
        total += share * away[:, :, None] * away[:, None]
    return np.asarray(total / (UNIT_POWERS[:, None] * UNIT_POWERS))


def _sandwich(inverse: Array, meat: Array, weight: Array, spread: Array) -> Array:
    meat = meat.copy()
    meat[:, (2, 3), (2, 3)] += prior_uncertainty_terms(weight, spread) ** 2
    return np.asarray(inverse @ meat @ inverse)
