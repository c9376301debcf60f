"""How uncertain the corners of a fit are: from noise, and because steel is no line, arc or cubic.

Noise alone explains how far an average of many points strays. It does not explain a bevel that
undulates, points beside a corner that leave their side together, or a notch that light between
its faces pulls in. What the residuals show of these counts as an error of the sides' heights at
their corners.
"""

from __future__ import annotations

from math import hypot, sqrt
from statistics import median
from types import ModuleType
from typing import Final

import numpy as np
import scipy  # its parts are loaded at first use

from tjscan.core.frames import Array
from tjscan.groove import kernel
from tjscan.groove.interreflection import (
    SMOOTH_PULLS,
    TRIED_NOTCH_PULLS,
    TRIED_PULL_DECAYS,
    TRIED_PULL_REACHES,
    NotchPull,
    find_pull,
)
from tjscan.groove.refinement import (
    coefficient_covariances,
    prior_shape_means,
    prior_shape_sigmas,
    prior_weights,
    solve_with_prior,
)
from tjscan.groove.reflections import MEETING_REACH, gaps_beside_corners
from tjscan.groove.settings import SideModel
from tjscan.groove.sides import SCALING_LENGTH_POWERS, FittedProfile, GrooveFit
from tjscan.laser.profile import Profile

PATCH_REACH: Final = 0.6e-3
"""Points this near a side, in metres, are of its surface or of what sticks to it."""

FEWEST_PATCH_POINTS: Final = 12
CORNER_POINTS: Final = 3
"""Points that show patches, and points next to each corner that do not."""

ROUGH_SIDE_FACTOR: Final = 1.6
"""Factor over the usual from which a side is rough or patched."""

PATCH_SIGMAS, PATCHED_SHARE = 3.5, 0.15
"""Standard deviations off its side where a point is on a patch, and the share of such points that
makes a side patched: single spatter does not."""

UNSEEN_SIDE_SLOPE: Final = 0.04
"""Slope by which a side may turn if it is not seen: half the angle between two facets that a
bevel may have, and as often it does not."""

PULL_PROBABILITY: Final = 0.5
"""Probability that a notch which looks pulled in by light is, and no fillet."""

FACE_END_SHARE: Final = 0.1
"""A bead's face is no parabola: its ends may lie off one by this share of its height. One that
rises twice as steeply from its toes as a parabola does is off by a seventh."""


def estimate_shape_errors(
    row: Profile, fitted: FittedProfile, model: tuple[SideModel, ...]
) -> tuple[Array, Array]:
    """Estimate what the sides' shapes add to the errors of their corners.

    Parameters
    ----------
    row : Profile
    fitted : FittedProfile
        k sides, whose noise is known.
    model : tuple of SideModel
        What they are like.

    Returns
    -------
    ndarray, shape (k - 1, 2)
        For each corner of the side before and of the side after it: how far the surface is
        likely to be behind the fitted side, in metres.
    ndarray, shape (k - 1, 2)
        Standard deviation about that, beyond what noise explains, in metres.
    """
    shift = np.zeros((len(fitted.corners), 2))
    patches = _patch_sigmas(fitted)
    sigma = np.column_stack((patches[:-1], patches[1:]))
    gaps = gaps_beside_corners(fitted)
    unseen = _unseen_side_shares(fitted, gaps)
    sigma = np.hypot(sigma, UNSEEN_SIDE_SLOPE * np.maximum(gaps - MEETING_REACH, 0.0) * unseen)
    for k, side in enumerate(model):
        if side.bead:
            own = slice(k - 1, k + 1)
            shift[own], pulled = _errors_if_pulled_in(fitted, k, find_pull(row, fitted, k))
            bow = (
                abs(fitted.curves[k].c2) * (fitted.places[k][0] - fitted.places[k - 1][1]) ** 2 / 4
            )
            free = FACE_END_SHARE * bow * np.array(((0, 1), (1, 0)))
            sigma[own] = np.hypot(np.hypot(sigma[own], pulled), free)
    return shift, sigma


def _unseen_side_shares(fitted: FittedProfile, gaps: Array) -> Array:
    """Root of the share of its side that each gap takes, shape (k - 1, 2).

    A knee that a side may have is in the gap with that probability. Wall and leg, which are
    tubes, have none.
    """
    found = np.zeros_like(gaps)
    for k in range(1, len(fitted.curves) - 1):
        length = abs(fitted.places[k][0] - fitted.places[k - 1][1])
        for i, j in ((k - 1, 1), (k, 0)):
            found[i, j] = sqrt(min(gaps[i, j] / max(length, 1e-9), 1.0))
    return found


def _patch_sigmas(fitted: FittedProfile) -> Array:
    """Standard deviation of what lies on each side in patches, such as scale, (k,), metres.

    What is rougher than most sides are, and points that were left out but lie close by, are the
    surface's too. The points next to corners are not asked: they fly.
    """
    k = len(fitted.curves)
    found = np.zeros(k)
    edges = fitted.edges
    # Noise is along the rays: a side that slants shows less of it.
    along = fitted.sigmas / np.array(
        [c.sine_with_ray(m) for c, m in zip(fitted.curves, fitted.middles, strict=True)]
    )
    usual = median(along.tolist())
    for i in range(k):
        inner = fitted.residuals[edges[i] + CORNER_POINTS : edges[i + 1] - CORNER_POINTS]
        close = inner[np.abs(inner) < PATCH_REACH]
        if len(close) < FEWEST_PATCH_POINTS:
            continue
        sigma = float(fitted.sigmas[i])
        patched = float((np.abs(close) > PATCH_SIGMAS * sigma).mean()) > PATCHED_SHARE
        if patched or along[i] > ROUGH_SIDE_FACTOR * usual:
            found[i] = sqrt(float(np.mean(close**2)))
    return found


def _errors_if_pulled_in(fitted: FittedProfile, k: int, pull: NotchPull) -> tuple[Array, Array]:
    """Errors of a bead's heights at its two corners, shape (2, 2), if light may pull it in.

    A fillet of steel looks the same: then the corners are where they are seen.
    """
    shift, sigma = np.zeros((2, 2)), np.zeros((2, 2))
    probability = PULL_PROBABILITY * pull.probability
    for i, (inward, spread) in enumerate(zip(pull.inward, pull.sigma, strict=True)):
        (a, b), (sa, sb) = fitted.curves[k - 1 + i : k + 1 + i], fitted.places[k - 1 + i]
        (ax, az), (bx, bz) = a.tangent_at(sa), b.tangent_at(sb)
        slope = fitted.curves[k].height_and_slope((sb, sa)[i])[1]
        # So much lower the face meets its flank so much farther inward.
        lower = (ax * bz - az * bx) * hypot(1.0, slope)
        square = probability * (spread**2 + inward**2) - (probability * inward) ** 2
        shift[i, 1 - i] = probability * inward * lower
        sigma[i, 1 - i] = sqrt(square) * lower
    return shift, sigma


def corner_estimates(fit: GrooveFit) -> tuple[Array, Array]:
    """Corners corrected for the sides' shapes, and their covariance with both end tangents.

    Each corner X lies on both its sides, so for either ``m · dX = b · dc`` with m the side's
    normal there and b the derivatives of its height by its coefficients c.

    Parameters
    ----------
    fit : GrooveFit
        Of k sides.

    Returns
    -------
    ndarray, shape (k - 1, 2)
        x and z of the corners, in metres: where the sides meet, moved to where the points beside
        them show the surface to be.
    ndarray, shape (2 k, 2 k)
        Of their coordinates and of the angles of the first and the last side's tangents.
    """
    fitted = fit.fitted
    if kernel.compiled is not None:
        return _compiled_estimates(kernel.compiled, fit)
    spread = _coefficient_covariances(fit)
    k = len(fitted.curves)
    jacobian = np.zeros((2 * k, 4 * k))
    powers = [[(1.0, s, s * s, s * s * s) for s in place] for place in fitted.places]
    for i, ((sa, sb), (pa, pb)) in enumerate(zip(fitted.places, powers, strict=True)):
        a, b = fitted.curves[i : i + 2]
        (ax, az), (bx, bz) = a.tangent_at(sa), b.tangent_at(sb)
        # Normals are (tz, -tx); heights count along the chord's, 1 / cos of the slope farther.
        wa = 1.0 / hypot(1.0, a.height_and_slope(sa)[1])
        wb = 1.0 / hypot(1.0, b.height_and_slope(sb)[1])
        det = ax * bz - az * bx
        jacobian[2 * i : 2 * i + 2, 4 * i : 4 * i + 8] = [
            [-bx * wa * p / det for p in pa] + [ax * wb * p / det for p in pb],
            [-bz * wa * p / det for p in pa] + [az * wb * p / det for p in pb],
        ]
    ends = ((0, 0, fitted.places[0][0]), (k - 1, k - 2, fitted.places[-1][1]))
    for angle, (side, corner, s) in enumerate(ends, start=2 * k - 2):
        curve = fitted.curves[side]
        _, slope = curve.height_and_slope(s)
        # A growing slope turns the tangent towards the normal (tz, -tx): against atan2(z, x).
        turned = -1.0 / (1.0 + slope * slope)
        jacobian[angle, 4 * side : 4 * side + 4] = 0.0, turned, 2 * s * turned, 3 * s * s * turned
        bend = turned * (2 * curve.c2 + 6 * s * curve.c3)
        step = bend * np.array((curve.tx, curve.tz))
        jacobian[angle] += step @ jacobian[2 * corner : 2 * corner + 2]
    # Sides are fitted apart from each other.
    parts = jacobian.reshape(2 * k, k, 4).transpose(1, 0, 2)
    covariance = (parts @ spread @ parts.transpose(0, 2, 1)).sum(axis=0)
    shift, sigma = estimate_shape_errors(fit.row, fitted, fit.model.sides)
    corners = fitted.corners.copy()
    for i, j in zip(*sigma.nonzero(), strict=True):
        moves = jacobian[2 * i : 2 * i + 2, 4 * (i + j)]
        corners[i] += shift[i, j] * moves
        own = slice(2 * i, 2 * i + 2)
        covariance[own, own] += sigma[i, j] ** 2 * np.outer(moves, moves)
    return corners, np.asarray(covariance)


def _compiled_estimates(compiled: ModuleType, fit: GrooveFit) -> tuple[Array, Array]:
    """The same by the compiled kernel."""
    row, fitted, k = fit.row, fit.fitted, len(fit.fitted.curves)
    straight = fitted.straight if fitted.straight is not None else np.empty(0)
    corners, covariance = np.empty((k - 1, 2)), np.empty((2 * k, 2 * k))
    sound = compiled.corner_estimates(
        *(row.x_s, row.z_s, np.array(fitted.curves), np.array(fitted.places), fitted.corners),
        *(fitted.along, fitted.residuals, fitted.sigmas, fitted.keep, np.array(fitted.edges)),
        *(fitted.curved, *fitted.equations, fitted.inverse, fitted.weight, fitted.counts),
        *(np.array(fitted.middles), straight),
        *(TRIED_NOTCH_PULLS, TRIED_PULL_REACHES, TRIED_PULL_DECAYS, SMOOTH_PULLS),
        *(kernel.model_values(fit.model.sides), corners, covariance),
        fitted.variance_inflation,
    )
    if not sound:
        raise np.linalg.LinAlgError("the points of a side do not show it")
    return corners, covariance


def _coefficient_covariances(fit: GrooveFit) -> Array:
    """Covariance of the coefficients c0 to c3 of each side, shape (k, 4, 4).

    Whether a side is straight is not certain: what was not chosen, with its own coefficients,
    counts by how likely it is (Bayesian model averaging).
    """
    fitted, sides = fit.fitted, fit.model.sides
    spread, expected = prior_shape_sigmas(sides), prior_shape_means(sides)
    bends = spread[:, 0] > 0
    here = SCALING_LENGTH_POWERS * [(c.c0, c.c1, c.c2, c.c3) for c in fitted.curves]
    total = coefficient_covariances(fitted, fitted.inverse, fitted.weight, spread)
    if fitted.straight is not None:
        other = prior_weights(
            spread, bends & ~fitted.curved, fitted.sigmas, fitted.variance_inflation
        )
        there, inverse = solve_with_prior(fitted.equations, other, expected)
        away = there - here
        odds = np.where(fitted.curved, fitted.straight, -fitted.straight)
        share = np.where(bends, scipy.special.expit(odds), 0.0)[:, None, None]
        total *= 1 - share
        total += share * coefficient_covariances(fitted, inverse, other, spread)
        total += share * away[:, :, None] * away[:, None]
    return np.asarray(total / (SCALING_LENGTH_POWERS[:, None] * SCALING_LENGTH_POWERS))
