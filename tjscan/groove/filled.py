"""A partly filled groove read with what is known of its flanks, point by point.

An earlier scan shows where wall, bevel and leg are. What a weld leaves of each is looked for near
that place; the wall may have moved, for a groove closes as it is welded. What else hangs together
and is not deeper than the bare groove is the weld's surface: no form of it is assumed.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array, array_dataclass
from tjscan.groove.read import order_points
from tjscan.groove.reflections import find_runs
from tjscan.groove.root import HOLLOW_SIGMA_SHARE, WELD_IN_GROOVE
from tjscan.groove.section import GrooveSection, section_in_plane
from tjscan.groove.settings import DEFAULT_SETTINGS, TEE_PARTLY_FILLED, GrooveSettings
from tjscan.groove.sides import (
    LEAST_NOISE,
    OUTLIER_SIGMAS,
    CubicCurve,
    end_of_support,
    intersect_curves,
    select_points,
)
from tjscan.laser.profile import Profile

FACE_MARGIN, FACE_REACH = 0.5e-3, 70e-3
"""Points nearer to a corner, or farther from it, in metres, do not show its face."""

FEWEST_SEEN_ON_FACE: Final = 12

OFFSET_STEP, FIRST_REACH = 0.1e-3, 0.4e-3
"""Steps in which the offset of a face is looked for, and how far from it its points lie at first,
in metres."""

FACE_FIT_ROUNDS, REACH_PER_ROUND = 10, 0.7
"""How often a face is fitted, and by what factor its points come nearer each time."""

STRONGEST_CORRELATION: Final = 0.7
"""Correlation of neighbours from which they have a shape in common, not noise."""

COVERED_TOP_SIGMA: Final = 0.15e-3
"""Standard deviation of the bevel's top along the wall if weld covers it, in metres."""

JUMP_COST: Final = 20.0
"""What it costs that a surface jumps, in points left out. Reflections jump twice."""

LEAST_JUMP, STEEPEST_SURFACE = 0.5e-3, 3.0
"""A surface without a jump goes on by so much along the rays, in metres, and this many times as
far as across them."""

DEEPER_THAN_STEEL, MOST_DEEPER_SHARE = 0.5e-3, 0.2
"""Points that lie deeper in the bare steel, in metres, are reflections; where more than this share
of them do, it is another groove."""

ROUGHNESS_POINTS: Final = 25
"""Neighbours whose roughness counts."""

_MAD_TO_SIGMA: Final = 1.4826


WALL_DOUBT: Final = (1.0e-3, 0.01, 0.15)
BEVEL_DOUBT: Final = (0.2e-3, 0.01, 0.3)
LEG_DOUBT: Final = (0.3e-3, 0.01, 0.3)
"""How far a face may be from where it is known to be, standard deviations: square to it in metres,
of its direction in radians, of its bend in 1/m. A groove closes by 1.5 mm and 0.4 degrees as 25 mm
are welded, and the bevel goes with the wall. An arm comes back to the leg."""


@array_dataclass
class KnownFlanks:
    """What is known of a bare groove, in the frame s of the profile that is read.

    Parameters
    ----------
    corners : ndarray, shape (3, 2)
        x and z of p2, p3 and p4, metres.
    wall, leg : ndarray, shape (2,)
        Unit tangents of the wall at p2, towards the bevel, and of the leg at p4, outwards.
    bends : ndarray, shape (2,)
        Second coefficients of the heights of wall and leg, away from the sensor, 1/m.
    """

    corners: Array
    wall: Array
    leg: Array
    bends: Array

    @classmethod
    def of_points(cls, points: Array, wall: Array, leg: Array) -> KnownFlanks:
        """Those of p1 to p5 of the bare groove, x and z, shape (5, 2), and its tangents."""
        bends = []
        for end, corner, along in ((0, 1, wall), (4, 3, leg)):
            s, d = _parabola(points[corner], along).local_coordinates(points[[end]])
            bends.append(float(d[0] / s[0] ** 2))
        return cls(points[1:4], wall, leg, np.array(bends))


@array_dataclass
class FilledGroove:
    """A partly filled groove as one profile shows it.

    Parameters
    ----------
    section : GrooveSection
        With the weld's toes for p3 and p4, and the area that is left. If the top of the bevel is
        covered, ``absent`` holds p2, which went with the wall.
    points : ndarray, shape (n, 2)
        x and z of all points on steel, from the wall to the leg, metres.
    sigmas : ndarray, shape (n,)
        Standard deviation of each along its ray, metres.
    weld : slice
        Which of the points are of the weld.
    """

    section: GrooveSection
    points: Array
    sigmas: Array
    weld: slice


class _Face(NamedTuple):
    """A face: its curve, covariance of c0, c1 and c2, and the deviation of its points."""

    curve: CubicCurve
    covariance: Array
    sigma: float
    inflation: float

    def covariance_at(self, s: float) -> Array:
        """Covariance of height and slope at s, shape (2, 2)."""
        by = np.array(((1.0, s, s * s), (0.0, 1.0, 2 * s)))
        return np.asarray(by @ self.covariance @ by.T)

    def end_on(self, points: Array) -> int:
        """Index after the last of the points that show it, of a row that begins on it."""
        off = np.abs(self.curve.signed_distances(points))
        return end_of_support(off < OUTLIER_SIGMAS * self.sigma)


def read_filled_groove(
    profile: Profile, known: KnownFlanks, settings: GrooveSettings = DEFAULT_SETTINGS
) -> FilledGroove:
    """Read a groove with weld in it whose flanks are known.

    Parameters
    ----------
    profile : Profile
        In frame s with x_s up the brace.
    known : KnownFlanks
    settings : GrooveSettings

    Raises
    ------
    GrooveNotFound
        If wall or leg is not seen near its place, or more than a few points lie deeper than the
        bare groove.
    """
    row = order_points(profile, settings)
    p2, p3, p4 = known.corners
    wall = _fit_face(row.points, _parabola(p2, known.wall, known.bends[0]), -1, WALL_DOUBT)
    leg = _fit_face(row.points, _parabola(p4, known.leg, known.bends[1]), 1, LEG_DOUBT)
    if wall is None or leg is None:
        raise GrooveNotFound(
            "out of range",
            f"no {'leg' if wall else 'wall'} is seen near where it was known to be: look again "
            "from where the bare groove was scanned",
            row.points,
        )
    top = np.array(wall.curve.point_on_curve(0.0))
    (ax, az), (bx, bz) = known.wall.tolist(), wall.curve.tangent_at(0.0)
    cos, sin = ax * bx + az * bz, ax * bz - az * bx
    down = np.array(((cos, -sin), (sin, cos))) @ (p3 - p2)
    length = float(np.linalg.norm(down))
    bare = _parabola(top, down / length)
    before, within, under = (
        curve.signed_distances(row.points) for curve in (wall.curve, bare, leg.curve)
    )
    deeper = np.maximum(np.minimum(before, within), under) > DEEPER_THAN_STEEL
    if deeper.mean() > MOST_DEEPER_SHARE:
        raise GrooveNotFound(
            "ambiguous",
            f"{deeper.mean():.0%} of the points lie deeper than the bare groove: it is another "
            "one, or the sensor is elsewhere",
            row.points,
        )
    row = _without_reflections(select_points(row, ~deeper))
    bevel = _fit_face(row.points, bare, 1, BEVEL_DOUBT, length)
    return _filled_groove(row, wall, bevel, leg, top + down)


def _parabola(start: Array, along: Array, bend: float = 0.0) -> CubicCurve:
    """A curve that begins along a unit vector."""
    (x, z), (tx, tz) = start.tolist(), along.tolist()
    return CubicCurve(x, z, tx, tz, 0.0, 0.0, bend)


def _fit_face(
    points: Array,
    base: CubicCurve,
    way: int,
    doubt: tuple[float, float, float],
    reach: float = FACE_REACH,
) -> _Face | None:
    """Fit a face near where it is known to be; None if too little of it is seen.

    It lies beyond the middle of its chord, along that or (`way` -1) against it.
    """
    (s, _), d = base.local_coordinates(points), base.signed_distances(points)
    offset, slope, _ = doubt
    most = 3 * (offset + slope * np.abs(s)) + FIRST_REACH
    own = (way * s > FACE_MARGIN) & (way * s < reach) & (np.abs(d) < most)
    s, d = s[own], d[own]
    offsets = np.arange(-3 * offset, 3 * offset, OFFSET_STEP)
    off = np.minimum(((d - offsets[:, None]) / FIRST_REACH) ** 2, 1).sum(axis=1)
    found = np.array((offsets[(off + (offsets / offset) ** 2).argmin()], 0.0, 0.0))
    basis, known = np.vander(s, 3, increasing=True).T, np.diag(np.array(doubt) ** -2)
    sigma, inflation, cut = FIRST_REACH, 1.0, FIRST_REACH
    for _ in range(FACE_FIT_ROUNDS):
        off = d - found @ basis
        near = off[np.abs(off) < cut]
        if len(near) < FEWEST_SEEN_ON_FACE:
            return None
        sigma = max(_MAD_TO_SIGMA * float(np.median(np.abs(near))), LEAST_NOISE)
        together = float(np.clip(near[1:] @ near[:-1] / (near @ near), 0, STRONGEST_CORRELATION))
        inflation = (1 + together) / (1 - together)
        share = np.maximum(1 - (off / cut) ** 2, 0) ** 2
        weighted = basis * share / (sigma**2 * inflation)
        information = weighted @ basis.T + known
        found = np.linalg.solve(information, weighted @ d)
        cut = max(REACH_PER_ROUND * cut, 1.5 * OUTLIER_SIGMAS * sigma)
    c0, c1, c2 = found.tolist()
    curve = base._replace(c0=c0, c1=c1, c2=base.c2 + c2)
    return _Face(curve, np.linalg.inv(information), sigma, inflation)


def _without_reflections(row: Profile) -> Profile:
    """The points of those runs that make one surface: of as many points and as few jumps as can be.

    Exactly, by dynamic programming over the runs.
    """
    points, runs = row.points, find_runs(row)
    first, last = points[runs.first], points[runs.first + runs.count - 1]
    score, before = runs.count.astype(float), np.full(len(runs.count), -1)
    for k in range(1, len(score)):
        across, away = np.abs(first[k] - last[:k]).T
        through = score[:k] - JUMP_COST * (away > LEAST_JUMP + STEEPEST_SURFACE * across)
        best = int(through.argmax())
        if through[best] > 0:
            score[k], before[k] = score[k] + through[best], best
    kept, k = np.zeros(len(score), dtype=np.bool_), int(score.argmax())
    while k >= 0:
        kept[k], k = True, int(before[k])
    return select_points(row, kept.repeat(runs.count))


def _filled_groove(
    row: Profile, wall: _Face, bevel: _Face | None, leg: _Face, root: Array
) -> FilledGroove:
    """Corners, toes and the surface between them, with their uncertainty.

    The root of the bare groove ends the bevel.
    """
    points, covariance = row.points, np.zeros((8, 8))
    met = bevel and intersect_curves(wall.curve, bevel.curve, 0.0)
    s_wall, s_flank = met or (0.0, 0.0)
    flank = bevel if bevel and met else wall
    top, tangent = (
        np.array(value)
        for value in (wall.curve.point_on_curve(s_wall), wall.curve.tangent_at(s_wall))
    )
    by_wall, by_other, other = None, tangent, COVERED_TOP_SIGMA**2
    if flank is bevel:
        # Moved square to itself the wall takes the top along the bevel, and the other way round.
        along = np.array(bevel.curve.tangent_at(s_flank))
        turn = tangent[0] * along[1] - tangent[1] * along[0]
        by_wall, by_other = along / -turn, tangent / turn
        other = bevel.covariance_at(s_flank)[0, 0]
    covariance[:2, :2] = other * np.outer(by_other, by_other)
    _add_face(covariance, (0, 1, 6), wall, s_wall, by_wall)
    # A weld may go on where a face does that ends at its corner.
    inner = np.array((top, root, leg.curve.point_on_curve(0.0)))
    bearings, inner = (-side[:, 0] / side[:, 1] for side in (points, inner))
    at_top, at_root, at_leg = bearings.searchsorted(inner).tolist()
    own = slice(at_top, at_root) if flank is bevel else slice(0, at_top)
    begin = own.start + flank.end_on(points[own])
    stop = len(points) - leg.end_on(points[max(at_leg, begin) :][::-1])
    toe, s_toe = _last_place(flank, points[max(begin - 1, 0)])
    foot, s_foot = _last_place(leg, points[min(stop, len(points) - 1)])
    _add_face(covariance, (2, 3), flank, s_toe)
    _add_face(covariance, (4, 5, 7), leg, s_foot)
    weld = slice(begin, max(begin, stop))
    sigmas = _sigmas_along_rays(row, wall, leg)
    gaps = np.linalg.norm(np.diff(np.vstack((toe, points[weld], foot)), axis=0), axis=1)
    spread = leg.inflation * float(sigmas[weld] ** 2 @ gaps[1:] ** 2)
    spread += HOLLOW_SIGMA_SHARE**2 * float(np.sum(gaps**4))
    section = section_in_plane(
        np.array((points[0], top, toe, foot, points[-1])),
        (wall.curve.tangent_at(s_wall), leg.curve.tangent_at(s_foot)),
        rms=wall.sigma,
        covariance=covariance,
        surface=points[weld],
        area_variance=spread,
        model=TEE_PARTLY_FILLED.name,
        conditions=(WELD_IN_GROOVE,),
        absent=() if flank is bevel else ("p2",),
    )
    return FilledGroove(section, points, sigmas, weld)


def _add_face(
    covariance: Array, index: tuple[int, ...], face: _Face, s: float, shift: Array | None = None
) -> None:
    """Add what a face's height and slope at s do to a corner and, if that is counted, to its angle.

    The corner moves by `shift` as the face moves back by one, by default along its normal.
    """
    (tx, tz), slope = face.curve.tangent_at(s), face.curve.height_and_slope(s)[1]
    by = np.zeros((len(index), 2))
    by[:2, 0] = (tz, -tx) if shift is None else shift
    by[2:, 1] = -1 / (1 + slope**2)
    covariance[np.ix_(index, index)] += by @ face.covariance_at(s) @ by.T


def _last_place(face: _Face, point: Array) -> tuple[Array, float]:
    """Where a face is next to a point."""
    s = face.curve.position_along_chord(*point.tolist())
    return np.array(face.curve.point_on_curve(s)), s


def _sigmas_along_rays(row: Profile, wall: _Face, leg: _Face) -> Array:
    """Standard deviation of each point along its ray, metres: a rough surface is less certain."""
    ends = (wall, -FACE_MARGIN), (leg, FACE_MARGIN)
    usual = min(face.sigma / face.curve.sine_with_ray(s) for face, s in ends)
    bent = np.abs(np.convolve(row.z_s, (-0.5, 1.0, -0.5), "same"))
    bent[[0, -1]] = np.median(bent)
    rough = np.sqrt(np.convolve(bent**2, np.full(ROUGHNESS_POINTS, 1 / ROUGHNESS_POINTS), "same"))
    return usual * np.maximum(rough / max(float(np.median(rough)), LEAST_NOISE), 1.0)
