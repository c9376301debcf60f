"""How uncertain the corners of a fit are: from noise, and because steel is no line, arc or cubic.

Noise alone explains how far an average of many points strays. It does not explain a bevel that
undulates, points beside a corner that leave their side together, or a notch that light between
its faces pulls in. What the residuals show of these counts as an error of the sides' heights at
their corners.

Light between the faces moves a notch's bottom and the nearest parts of its flanks towards the
sensor, along the rays, and fades smoothly up the flanks. So a corner is still seen in its own
direction, but too near: it is where that ray meets the flank, drawn on from where nothing pulls it.
How well a pull explains the points about a notch shows how likely it is.
"""

from __future__ import annotations

from itertools import combinations
from math import hypot, sqrt
from statistics import median
from typing import Final, NamedTuple

import numpy as np
import scipy  # its parts are loaded at first use

from tjscan.core.frames import Array
from tjscan.groove import kernel
from tjscan.groove.prior import TRIED_NOTCH_PULLS
from tjscan.groove.refinement import (
    coefficient_covariances,
    model_values,
    prior_weights,
    solve_with_prior,
)
from tjscan.groove.reflections import MEETING_REACH, gaps_beside_corners
from tjscan.groove.settings import FACE_BLUNTNESS, SideModel
from tjscan.groove.sides import (
    LEAST_NOISE,
    OUTLIER_SIGMAS,
    SCALING_LENGTH_POWERS,
    CubicCurve,
    FittedProfile,
    GrooveFit,
)
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


TRIED_PULL_REACHES: Final = 1e-3 * np.array((3.0, 4.0, 5.0))
TRIED_PULL_DECAYS: Final = 1e-3 * np.array((0.7, 1.0, 1.4))
"""How far up its flanks a notch that is pulled in may be seen to be, if it ends there, or over
which length that decays, in metres."""

STEEPEST_PULL: Final = 0.8
"""A pull is smooth: it grows by no greater share of the way along its flank."""

PULL_PRIOR_ODDS: Final = 0.5
"""Odds that a notch is pulled in, before its points are looked at."""

PULL_SHAPE_SIGMA: Final = 0.1
"""A pull may differ from what is tried by this share, one standard deviation."""

NOTCH_REGION_LENGTH: Final = 8e-3
"""Points this near a corner are looked at, in metres along its flank."""

FACE_POINT_SHARES: Final = (0.15, 0.35, 0.5, 0.65, 0.85)
FEWEST_FACE_POINTS: Final = 8
"""Where, as shares of its points, those lie that propose flatter faces; fewest points for that."""

LEAST_LIKELIHOOD: Final = 1e-12
"""Of a pull over that of none: less is none."""

LEAST_TURN_SINE: Final = 0.15
"""Least sine of the turn between a flank and a face that have a corner."""


class NotchPull(NamedTuple):
    """How likely a notch is pulled in, and where its corners are if it is.

    Parameters
    ----------
    probability : float
    inward, sigma : ndarray, shape (2,)
        How far each corner then is inward of the fitted one, along its flank, and the standard
        deviation of that, in metres.
    """

    probability: float
    inward: Array
    sigma: Array


NO_PULL: Final = NotchPull(0.0, np.zeros(2), np.zeros(2))

PULL_WEIGHTS: Final = np.where(
    TRIED_NOTCH_PULLS[:, None]
    <= STEEPEST_PULL * np.concatenate((TRIED_PULL_REACHES * 2 / np.pi, TRIED_PULL_DECAYS * 2)),
    1.0,
    0.0,
)
"""Of each tried pull with each reach and decay: those that are smooth weigh alike, so that smaller
ones, which are tried more densely, are likelier. By the millimetre alike, corners of a scanned yard
joint were a fifth farther off."""


class _Flank(NamedTuple):
    """A flank of a notch, with the n points about it.

    Parameters
    ----------
    corner, along : tuple of float
        The fitted corner and the tangent there, inward.
    limit : float
        Bound of its points' noise, in metres.
    inward : ndarray, shape (n,)
        Where each point's ray meets the flank, inward of the corner, in metres.
    behind : ndarray, shape (n,)
        How far each point lies behind the flank, in metres.
    """

    corner: tuple[float, float]
    along: tuple[float, float]
    limit: float
    inward: Array
    behind: Array


def find_pull(row: Profile, fitted: FittedProfile, k: int) -> NotchPull:
    """Estimate whether the notch whose bottom is side k of a fit is pulled in, and how far.

    Parameters
    ----------
    row : Profile
    fitted : FittedProfile
        Whose noise is known.
    k : int
        Number of a side between two others.
    """
    weight, inward = _weigh_pulls(row, fitted, k)
    total = float(weight.sum())
    odds = PULL_PRIOR_ODDS * total / (max(len(weight), 1) * float(PULL_WEIGHTS.sum()))
    if odds < 1e-4:
        return NO_PULL
    share = weight[:, None] / total
    mean, square = (np.sum(share * inward**power, axis=(0, 2, 3)) for power in (1, 2))
    return NotchPull(odds / (1 + odds), mean, np.sqrt(np.maximum(square - mean**2, 0)))


def pull_log_likelihoods(row: Profile, fitted: FittedProfile, k: int) -> Array:
    """Log-likelihood of no pull, zero, and of each of `TRIED_NOTCH_PULLS`, shape (1 + p,).

    For the parameters see `find_pull`.
    """
    weight, _ = _weigh_pulls(row, fitted, k)
    ways = max(len(weight), 1) * PULL_WEIGHTS.sum(axis=1)
    likely = np.maximum(weight.sum(axis=(0, 2)) / ways, LEAST_LIKELIHOOD)
    return np.asarray(np.log(np.append(1.0, likely)))


def _weigh_pulls(row: Profile, fitted: FittedProfile, k: int) -> tuple[Array, Array]:
    """Likelihood over that of no pull, (f, p, r), for f faces, and both corners, (f, 2, p, 1)."""
    face, places = fitted.curves[k], (fitted.places[k - 1][1], fitted.places[k][0])
    limits = OUTLIER_SIGMAS * np.maximum(fitted.sigmas, LEAST_NOISE)
    flat = float(limits[k])
    sag = -face.c2 * (places[1] - places[0]) ** 2 / 4
    limits[k] = max(flat, FACE_BLUNTNESS * abs(sag))
    ends = (k - 1, fitted.places[k - 1][0], 1.0), (k + 1, fitted.places[k][1], -1.0)
    bounds = [fitted.curves[i].point_on_curve(s - w * NOTCH_REGION_LENGTH) for i, s, w in ends]
    bearings = -row.x_s / row.z_s
    near = slice(*bearings.searchsorted([-x / z for x, z in bounds]).tolist())
    points, bearings = row.points[near], bearings[near]
    flanks = [_build_flank(fitted.curves[i], s, w, points, float(limits[i])) for i, s, w in ends]
    sides = np.arange(len(limits)).repeat(np.diff(fitted.edges))[near]
    now = float(np.minimum((fitted.residuals[near] / limits[sides]) ** 2, 1).sum())
    faces = [(face, places, float(limits[k]))]
    own = points[sides == k]
    if sag > flat and len(own) >= FEWEST_FACE_POINTS:
        # Straight faces through pairs of its points are flatter.
        chosen = np.rint(np.multiply(FACE_POINT_SHARES, len(own) - 1)).astype(np.intp)
        for (ax, az), (bx, bz) in combinations(own[chosen].tolist(), 2):
            length = hypot(bx - ax, bz - az)
            line = CubicCurve(ax, az, (bx - ax) / length, (bz - az) / length)
            faces.append((line, (0.0, 0.0), flat))
    found = [_pull_costs(*one, flanks, points, bearings) for one in faces]
    known = [pair for pair in found if pair is not None]
    costs = np.array([cost for cost, _ in known]).reshape(-1, *PULL_WEIGHTS.shape)
    inward = np.array([corners for _, corners in known]).reshape(-1, 2, len(PULL_WEIGHTS), 1)
    explained = (now - costs) * OUTLIER_SIGMAS**2 / 2 / fitted.variance_inflation
    return np.asarray(np.exp(explained) * PULL_WEIGHTS), inward


def _build_flank(curve: CubicCurve, s: float, sign: float, points: Array, limit: float) -> _Flank:
    (x, z), (ax, az), (px, pz) = curve.point_on_curve(s), curve.tangent_at(s), points.T
    with np.errstate(divide="ignore"):
        inward = sign * (z * px - x * pz) / (ax * pz - az * px)
    return _Flank((x, z), (sign * ax, sign * az), limit, inward, curve.signed_distances(points))


def _pull_costs(
    face: CubicCurve,
    places: tuple[float, float],
    limit: float,
    flanks: list[_Flank],
    points: Array,
    bearings: Array,
) -> tuple[Array, Array] | None:
    """What the points pay for each pull and reach, (p, r), and both flanks' corners, (2, p).

    None if a flank and the face are nearly parallel.
    """
    corners, ends = [], []
    for flank, s in zip(flanks, places, strict=True):
        (x, z), (tx, tz) = face.point_on_curve(s), face.tangent_at(s)
        (cx, cz), (fx, fz) = flank.corner, flank.along
        cross = fx * tz - fz * tx
        if abs(cross) < LEAST_TURN_SINE:
            return None
        met = (x - cx) * tz - (z - cz) * tx + TRIED_NOTCH_PULLS * (cx / cz * tz - tx)
        corners.append(met / cross)
        ends.append(-(cx + corners[-1] * fx) / (cz + corners[-1] * fz))
    before, after = (bearings < ends[0][:, None]), (bearings >= ends[1][:, None])
    own = np.minimum((face.signed_distances(points) / limit) ** 2, 1)
    total = (own * ~(before | after)).sum(axis=1)[:, None]
    for flank, met, on in zip(flanks, corners, (before, after), strict=True):
        (x, z), (tx, tz) = flank.corner, flank.along
        square = abs(x * tz - z * tx) / hypot(x, z)  # to the rays
        away = (met[:, None] - flank.inward)[:, None]
        pull = TRIED_NOTCH_PULLS[:, None, None] * _shares_of_pull(away)
        fuzzy = (PULL_SHAPE_SIGMA * OUTLIER_SIGMAS / flank.limit * pull) ** 2
        away = ((flank.behind + square * pull) / flank.limit) ** 2
        pays = np.minimum(away / (1 + fuzzy), 1) + np.log1p(fuzzy) / OUTLIER_SIGMAS**2
        total = total + (pays * on[:, None]).sum(axis=2)
    return np.where((ends[0] < ends[1])[:, None], total, np.inf), np.array(corners)


def _shares_of_pull(away: Array) -> Array:
    """Share of a pull, (..., r, n), at distances (..., 1, n) from its notch, each reach and decay.

    A raised cosine ends at its reach; a hyperbolic secant decays.
    """
    ends = 0.5 + 0.5 * np.cos(np.pi * np.minimum(away / TRIED_PULL_REACHES[:, None], 1))
    decays = 1 / np.cosh(np.minimum(np.abs(away / TRIED_PULL_DECAYS[:, None]), 50.0))
    return np.concatenate((ends, decays), axis=-2)


def _shape_sigmas(fitted: FittedProfile, model: tuple[SideModel, ...]) -> Array:
    """What the sides' shapes add to their heights at their corners, shape (k - 1, 2), metres.

    Standard deviations beyond what noise explains, of the side before each corner and of the side
    after it.
    """
    patches, gaps = _patch_sigmas(fitted), gaps_beside_corners(fitted)
    sigma = np.column_stack((patches[:-1], patches[1:]))
    # Wall and leg, which are tubes, have no knee.
    for k, side in enumerate(model[1:-1], 1):
        length = abs(fitted.places[k][0] - fitted.places[k - 1][1])
        bow = FACE_END_SHARE * abs(fitted.curves[k].c2) * length**2 / 4 if side.bead else 0.0
        for place in ((k - 1, 1), (k, 0)):
            # It is in the gap with the probability of the share of its side that this takes.
            unseen = sqrt(min(gaps[place] / max(length, 1e-9), 1.0))
            turned = UNSEEN_SIDE_SLOPE * max(gaps[place] - MEETING_REACH, 0.0) * unseen
            sigma[place] = hypot(sigma[place], turned, bow)
    return sigma


def _patch_sigmas(fitted: FittedProfile) -> Array:
    """Standard deviation of what lies on each side in patches, such as scale, (k,), metres.

    What is rougher than most sides are, and points that were left out but lie close by, are the
    surface's too. The points next to corners are not asked: they fly.
    """
    found = np.zeros(len(fitted.curves))
    # Noise is along the rays: a side that slants shows less of it.
    middles = zip(fitted.curves, fitted.middles, strict=True)
    along = fitted.sigmas / np.array([c.sine_with_ray(m) for c, m in middles])
    usual = median(along.tolist())
    for i, (own, sigma) in enumerate(zip(fitted.spans, fitted.sigmas.tolist(), strict=True)):
        inner = np.abs(fitted.residuals[own.start + CORNER_POINTS : own.stop - CORNER_POINTS])
        close = inner[inner < PATCH_REACH]
        if len(close) < FEWEST_PATCH_POINTS:
            continue
        patched = float((close > PATCH_SIGMAS * sigma).mean()) > PATCHED_SHARE
        if patched or along[i] > ROUGH_SIDE_FACTOR * usual:
            found[i] = sqrt(float(np.mean(close**2)))
    return found


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
    row, fitted, sides, k = fit.row, fit.fitted, fit.model.sides, len(fit.fitted.curves)
    corners, covariance = fitted.corners.copy(), np.empty((2 * k, 2 * k))
    if kernel.compiled is not None:
        straight = fitted.straight if fitted.straight is not None else np.empty(0)
        if not kernel.compiled.corner_estimates(
            *(row.x_s, row.z_s, np.array(fitted.curves), np.array(fitted.places), fitted.corners),
            *(fitted.along, fitted.residuals, fitted.sigmas, fitted.keep, np.array(fitted.edges)),
            *(fitted.curved, *fitted.equations, fitted.inverse, fitted.weight, fitted.counts),
            *(np.array(fitted.middles), straight),
            *(TRIED_NOTCH_PULLS, TRIED_PULL_REACHES, TRIED_PULL_DECAYS, PULL_WEIGHTS),
            *(model_values(sides), corners, covariance, fitted.variance_inflation),
        ):
            raise np.linalg.LinAlgError("the points of a side do not show it")
        return corners, covariance
    jacobian = np.zeros((2 * k, 4 * k))
    for i, places in enumerate(fitted.places):
        for j, s in enumerate(places, i):
            # Heights count along the chord's normal, 1 / cos of the slope farther.
            moved = fitted.corner_shift(i, j) / hypot(1.0, fitted.curves[j].height_and_slope(s)[1])
            jacobian[2 * i : 2 * i + 2, 4 * j : 4 * j + 4] = np.outer(moved, (1, s, s * s, s**3))
    ends = ((0, 0, fitted.places[0][0]), (k - 1, k - 2, fitted.places[-1][1]))
    for angle, (side, corner, s) in enumerate(ends, start=2 * k - 2):
        curve = fitted.curves[side]
        # A growing slope turns the tangent towards the normal (tz, -tx): against atan2(z, x).
        turned = -1.0 / (1.0 + curve.height_and_slope(s)[1] ** 2)
        jacobian[angle, 4 * side : 4 * side + 4] = 0.0, turned, 2 * s * turned, 3 * s * s * turned
        bend = turned * (2 * curve.c2 + 6 * s * curve.c3)
        step = bend * np.array((curve.tx, curve.tz))
        jacobian[angle] += step @ jacobian[2 * corner : 2 * corner + 2]
    # Sides are fitted apart from each other.
    parts = jacobian.reshape(2 * k, k, 4).transpose(1, 0, 2)
    covariance = (parts @ _coefficient_covariances(fit) @ parts.transpose(0, 2, 1)).sum(axis=0)
    for (i, j), sigma in np.ndenumerate(_shape_sigmas(fitted, sides)):
        own, moves = slice(2 * i, 2 * i + 2), jacobian[2 * i : 2 * i + 2, 4 * (i + j)]
        covariance[own, own] += sigma**2 * np.outer(moves, moves)
    for bead in (j for j, side in enumerate(sides) if side.bead):
        pull = find_pull(row, fitted, bead)
        # A fillet of steel looks the same: then the corners are where they are seen.
        likely = PULL_PROBABILITY * pull.probability
        for i, flank in ((0, bead - 1), (1, bead + 1)):
            corner, inward = bead - 1 + i, float(pull.inward[i])
            way = (1 - 2 * i) * np.array(fitted.curves[flank].tangent_at(fitted.places[corner][i]))
            corners[corner] += likely * inward * way
            variance = likely * (pull.sigma[i] ** 2 + inward**2) - (likely * inward) ** 2
            own = slice(2 * corner, 2 * corner + 2)
            covariance[own, own] += variance * np.outer(way, way)
    return corners, np.asarray(covariance)


def _coefficient_covariances(fit: GrooveFit) -> Array:
    """Covariance of the coefficients c0 to c3 of each side, shape (k, 4, 4).

    Whether a side is straight is not certain: what was not chosen, with its own coefficients,
    counts by how likely it is (Bayesian model averaging).
    """
    fitted = fit.fitted
    values = model_values(fit.model.sides)
    spread, expected = values[:, :2], values[:, 2]
    bends = spread[:, 0] > 0
    total = coefficient_covariances(fitted, fitted.inverse, fitted.weight, spread)
    if fitted.straight is not None:
        other = prior_weights(
            spread, bends & ~fitted.curved, fitted.sigmas, fitted.variance_inflation
        )
        there, inverse = solve_with_prior(fitted.equations, other, expected)
        away = there - SCALING_LENGTH_POWERS * [curve[4:] for curve in fitted.curves]
        odds = np.where(fitted.curved, fitted.straight, -fitted.straight)
        share = np.where(bends, scipy.special.expit(odds), 0.0)[:, None, None]
        total *= 1 - share
        total += share * coefficient_covariances(fitted, inverse, other, spread)
        total += share * away[:, :, None] * away[:, None]
    return np.asarray(total / np.multiply.outer(SCALING_LENGTH_POWERS, SCALING_LENGTH_POWERS))
