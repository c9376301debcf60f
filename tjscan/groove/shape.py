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

from dataclasses import dataclass
from itertools import combinations
from math import hypot, sqrt
from statistics import median
from types import ModuleType
from typing import Final

import numpy as np
import scipy  # its parts are loaded at first use

from tjscan.core.frames import Array
from tjscan.groove import kernel
from tjscan.groove.refinement import (
    coefficient_covariances,
    prior_weights,
    side_priors,
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


TRIED_NOTCH_PULLS: Final = 1e-3 * np.array(
    (0.1, 0.15, 0.2, 0.3, 0.4, 0.55, 0.75, 1.0, 1.3, 1.6, 2.0)
)
TRIED_PULL_REACHES: Final = 1e-3 * np.array((3.0, 4.0, 5.0))
TRIED_PULL_DECAYS: Final = 1e-3 * np.array((0.7, 1.0, 1.4))
"""How far a notch may be pulled in, and how far up its flanks that may be seen, if it ends there,
or over which length it decays, in metres."""

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

LEAST_TURN_SINE: Final = 0.15
"""Least sine of the turn between a flank and a face that have a corner."""


@dataclass(frozen=True, slots=True, eq=False)
class NotchPull:
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

SMOOTH_PULLS: Final = TRIED_NOTCH_PULLS[:, None] <= STEEPEST_PULL * np.concatenate(
    (TRIED_PULL_REACHES * 2 / np.pi, TRIED_PULL_DECAYS * 2)
)


@dataclass(frozen=True, slots=True, eq=False)
class _Flank:
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

    @property
    def square(self) -> float:
        """Sine of the angle between flank and ray."""
        (x, z), (tx, tz) = self.corner, self.along
        return abs(x * tz - z * tx) / hypot(x, z)

    def intersections_with_line(self, x: float, z: float, tx: float, tz: float) -> Array | None:
        """Where a line meets the flank, inward of the corner, for each of the pulls, (p,).

        None if the two are nearly parallel.
        """
        (cx, cz), (fx, fz) = self.corner, self.along
        cross = fx * tz - fz * tx
        if abs(cross) < LEAST_TURN_SINE:
            return None
        met = (x - cx) * tz - (z - cz) * tx
        return np.asarray((met + TRIED_NOTCH_PULLS * (cx / cz * tz - tx)) / cross)


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
    face, places = fitted.curves[k], (fitted.places[k - 1][1], fitted.places[k][0])
    limits = OUTLIER_SIGMAS * np.maximum(fitted.sigmas, LEAST_NOISE)
    flat = float(limits[k])
    sag = -face.c2 * (places[1] - places[0]) ** 2 / 4
    limits[k] = max(flat, FACE_BLUNTNESS * abs(sag))
    ends = (k - 1, fitted.places[k - 1][0], 1.0), (k + 1, fitted.places[k][1], -1.0)
    bounds = [fitted.curves[i].point_on_curve(s - w * NOTCH_REGION_LENGTH) for i, s, w in ends]
    tangents = -row.x_s / row.z_s
    a, b = tangents.searchsorted([-x / z for x, z in bounds]).tolist()
    points = row.points[a:b]
    flanks = [_build_flank(fitted.curves[i], s, w, points, float(limits[i])) for i, s, w in ends]
    sides = np.arange(len(limits)).repeat(np.diff(fitted.edges))[a:b]
    now = float(np.minimum((fitted.residuals[a:b] / limits[sides]) ** 2, 1).sum())
    found = [_pull_costs(face, places, float(limits[k]), flanks, points, tangents[a:b])]
    if sag > flat:
        found += [
            _pull_costs(line, (0.0, 0.0), flat, flanks, points, tangents[a:b])
            for line in _propose_flatter_faces(points[sides == k])
        ]
    known = [pair for pair in found if pair is not None]
    if not known:
        return NO_PULL
    costs = np.array([cost for cost, _ in known])
    inward = np.array([corners for _, corners in known])[:, :, :, None]
    inflation = fitted.variance_inflation
    weight = np.exp((now - costs) * OUTLIER_SIGMAS**2 / 2 / inflation) * SMOOTH_PULLS
    total = float(weight.sum())
    odds = PULL_PRIOR_ODDS * total / (len(known) * np.count_nonzero(SMOOTH_PULLS))
    if odds < 1e-4:
        return NO_PULL
    share = weight[:, None] / total
    mean = (share * inward).sum(axis=(0, 2, 3))
    square = (share * inward**2).sum(axis=(0, 2, 3))
    return NotchPull(odds / (1 + odds), mean, np.sqrt(np.maximum(square - mean**2, 0)))


def _build_flank(curve: CubicCurve, s: float, sign: float, points: Array, limit: float) -> _Flank:
    x, z = curve.point_on_curve(s)
    tx, tz = curve.tangent_at(s)
    tx, tz = sign * tx, sign * tz
    px, pz = points.T
    across = tx * pz - tz * px
    with np.errstate(divide="ignore"):
        inward = (z * px - x * pz) / across
    return _Flank((x, z), (tx, tz), limit, inward, curve.signed_distances(points))


def _propose_flatter_faces(points: Array) -> list[CubicCurve]:
    """Straight faces through pairs of a face's points, shape (n, 2)."""
    if len(points) < FEWEST_FACE_POINTS:
        return []
    chosen = points[
        np.rint(np.multiply(FACE_POINT_SHARES, len(points) - 1)).astype(np.intp)
    ].tolist()
    found = []
    for (ax, az), (bx, bz) in combinations(chosen, 2):
        length = hypot(bx - ax, bz - az)
        found.append(CubicCurve(ax, az, (bx - ax) / length, (bz - az) / length))
    return found


def _pull_costs(
    face: CubicCurve,
    places: tuple[float, float],
    limit: float,
    flanks: list[_Flank],
    points: Array,
    tangents: Array,
) -> tuple[Array, Array] | None:
    """What the points pay for each pull and reach, (p, r), and both flanks' corners, (2, p)."""
    corners, bearings = [], []
    for flank, s in zip(flanks, places, strict=True):
        met = flank.intersections_with_line(*face.point_on_curve(s), *face.tangent_at(s))
        if met is None:
            return None
        (cx, cz), (tx, tz) = flank.corner, flank.along
        corners.append(met)
        bearings.append(-(cx + met * tx) / (cz + met * tz))
    before, after = (tangents < bearings[0][:, None]), (tangents >= bearings[1][:, None])
    own = np.minimum((face.signed_distances(points) / limit) ** 2, 1)
    total = (own * ~(before | after)).sum(axis=1)[:, None]
    for flank, met, on in zip(flanks, corners, (before, after), strict=True):
        away = (met[:, None] - flank.inward)[:, None]
        pull = TRIED_NOTCH_PULLS[:, None, None] * _shares_of_pull(away)
        fuzzy = (PULL_SHAPE_SIGMA * OUTLIER_SIGMAS / flank.limit * pull) ** 2
        away = ((flank.behind + flank.square * pull) / flank.limit) ** 2
        pays = np.minimum(away / (1 + fuzzy), 1) + np.log1p(fuzzy) / OUTLIER_SIGMAS**2
        total = total + (pays * on[:, None]).sum(axis=2)
    return np.where((bearings[0] < bearings[1])[:, None], total, np.inf), np.array(corners)


def _shares_of_pull(away: Array) -> Array:
    """Share of a pull, (..., r, n), at distances (..., 1, n) from its notch, each reach and decay.

    A raised cosine ends at its reach; a hyperbolic secant decays.
    """
    ends = 0.5 + 0.5 * np.cos(np.pi * np.minimum(away / TRIED_PULL_REACHES[:, None], 1))
    decays = 1 / np.cosh(np.minimum(np.abs(away / TRIED_PULL_DECAYS[:, None]), 50.0))
    return np.concatenate((ends, decays), axis=-2)


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
    spread, expected, *_ = side_priors(sides)
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
