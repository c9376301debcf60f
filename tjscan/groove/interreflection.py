"""Whether light between the faces of a notch pulls it in, and where its corners are if it does.

Such light moves a notch's bottom and the nearest parts of its flanks towards the sensor, along
the rays, and fades smoothly up the flanks. So a corner is still seen in its own direction, but
too near: it is where that ray meets the flank, drawn on from where nothing pulls it. The bottom
shows nothing of it. The flanks do: their points leave them, or the bottom's face is bent to go
over into them. How well a pull explains the points about a notch shows how likely it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import hypot, inf, sqrt
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.settings import FACE_BLUNTNESS, GrooveModel
from tjscan.groove.sides import LEAST_NOISE, OUTLIER_SIGMAS, CubicCurve, FittedProfile
from tjscan.laser.profile import Profile

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


PULL_REACH: Final = 4e-3
"""Distance from a notch in metres within which points are pulled in: real profiles
show 3 to 5 mm."""

PULL_RELATIVE_SIGMA: Final = 0.15
"""Share of itself by which a pull is uncertain, for its reach is."""

FEWEST_PULLED_POINTS: Final = 4
"""Points about a notch that show a pull."""


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


def closeness_to_notch(points: Array, notch: Array) -> Array:
    """Share of the pull that points take, shape (n,): a raised cosine of their distance.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
    notch : ndarray, shape (m, 2)
        Its corners, x and z in metres.
    """
    away = np.linalg.norm(points[:, None] - notch, axis=2).min(axis=1)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * np.minimum(away / PULL_REACH, 1.0)))


def estimate_pull(row: Profile, fitted: FittedProfile, model: GrooveModel) -> tuple[float, float]:
    """Estimate a pull from the flanks of a root with a face: weighted least squares.

    Parameters
    ----------
    row : Profile
        Its points may differ from the fit's.
    fitted : FittedProfile
    model : GrooveModel
        Whose last side but one is the root's face.

    Returns
    -------
    float, float
        In metres, and its standard deviation, infinite where nothing shows it. It may come out
        negative.
    """
    closeness = closeness_to_notch(row.points, fitted.corners[-2:])
    value, information = 0.0, 0.0
    last = len(fitted.curves) - 1
    for k in (last - 2, last):
        own, side = fitted.spans[k], model.sides[k]
        curve = fitted.curves[k].rebased_at_tangent(fitted.middles[k])
        points = row.points[own]
        s, d = curve.local_coordinates(points)
        pull = -closeness[own] * curve.chord_sines_with_rays(points)
        close = closeness[own] > 0
        off = d - (curve.c0 + s * (curve.c1 + s * (curve.c2 + s * curve.c3)))
        sigma = max(float(fitted.sigmas[k]), LEAST_NOISE)
        used = fitted.keep[own] | (close & (np.abs(off) < 2 * OUTLIER_SIGMAS * sigma))
        if np.count_nonzero(close & used) < FEWEST_PULLED_POINTS:
            continue
        expected = curve.c2 if side.expected_bend is None and side.bend > 1 else side.expected_bend
        basis = np.stack([s[used] ** p for p in range(4)])
        g, y = pull[used], d[used] - (expected or 0.0) * basis[2]
        variance = sigma**2 * fitted.variance_inflation
        known = np.zeros(4)
        known[2:] = variance / np.maximum((side.bend, side.twist), 1e-3) ** 2
        taken = np.linalg.solve(basis @ basis.T + np.diag(known), basis @ np.column_stack((g, y)))
        left = g - taken[:, 0] @ basis
        value += float(left @ y) / variance
        information += float(left @ g) / variance
    if information <= 0:
        return 0.0, inf
    return value / information, 1 / sqrt(information)
