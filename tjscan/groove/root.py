"""What is at the root of a fitted tee: a bead, a tack, an opening, or nothing that is seen."""

from __future__ import annotations

from dataclasses import replace
from math import hypot, sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove.reflections import (
    LEAST_REFLECTION_DISTANCE,
    MEETING_REACH,
    find_runs,
    gaps_beside_corners,
    reflection_probability,
    without_seam_cap,
)
from tjscan.groove.section import TACK_WELD, GrooveSection, section_in_plane
from tjscan.groove.settings import TEE_PARTLY_FILLED
from tjscan.groove.sides import (
    LEAST_NOISE,
    OUTLIER_SIGMAS,
    CubicCurve,
    FittedProfile,
    GrooveFit,
    end_of_support,
    intersect_curves,
    select_points,
)
from tjscan.laser.profile import Profile

OPEN_ROOT: Final = "open root"
WELD_IN_ROOT: Final = "weld in the root"
WELD_IN_GROOVE: Final = "weld in the groove"
ROOT_NOT_SEEN: Final = "root not seen"
SEAM_BESIDE: Final = "seam weld beside"

TACK_RATIO, TACK_HEIGHT = 0.165, 1.45e-3
"""Height of a tack over its chord: a share of it, and metres. A pass that is in a groove wets
both faces and is lower; a root bead that bulges is smaller."""

CONVEX_WELD_RATIO: Final = 0.06
"""Height over its chord, as a share of it, from which a face is convex weld metal."""

LEAST_OPENING: Final = 0.8e-3
"""Distance between the end of a bevel and the leg that makes an open root, in metres."""

POINTS_AFTER_BEVEL: Final = 40
FEWEST_POINTS_UNDER_BEVEL: Final = 2
"""Of so many points after the end of a bevel, so many must lie on the leg under it where a root
is open."""

BURIED_DEPTH_IN_CHORDS: Final = 0.5
"""Distance along bevel or leg from a tack's toe to the corner under it, in chords of the tack."""

LEAST_UNSEEN_SIGMA: Final = 0.5e-3
"""Least standard deviation, in metres along its side, of a corner that is not seen."""

PROBABILITY_OF_NO_FACE: Final = 0.5
"""Probability that a root which is not seen has no face: as likely as not."""

FARTHEST_ROOT_DISTANCE: Final = 20e-3
"""Metres along bevel or leg in which the root is."""

FACE_HEIGHT_SAMPLES: Final = 21
"""Points by which a face's height over its chord is found."""

_FACE_SHARES: Final = np.linspace(0.0, 1.0, FACE_HEIGHT_SAMPLES)

MOST_HIDDEN_SHARE: Final = 0.5
"""Share of a weld, or of a bevel beside it, that one hole may hide."""

HOLLOW_SIGMA_SHARE: Final = 0.1
"""Standard deviation of the area between a face and its chord, as a share of it: no bead is a
parabola."""


TOE_REACH: Final = 2.5e-3
"""Points of a weld this near its toe, in metres, show how it meets the flank."""

FEWEST_TOE_POINTS: Final = 4

LEAST_TOE_SIGMA: Final = 0.03e-3
"""Least standard deviation of a toe along its flank, in metres: no bead begins as a line."""

UNSEEN_TOE_SIGMA: Final = 5e-3
"""The same if too few points show it."""

SURFACE_REACH: Final = 1.5e-3
"""Points this near a fitted weld, in metres, are of its surface: beads leave it by a millimetre."""


def read_root(fit: GrooveFit, covariance: Array, tolerance: float) -> GrooveSection:
    """Read the section of a fitted tee: its corners p2, p3 and p4, and what is found at its root.

    Parameters
    ----------
    fit : GrooveFit
        Of any form of a tee, of k sides.
    covariance : ndarray, shape (2 k, 2 k)
        Of its corners and of the angles of wall and leg.
    tolerance : float
        Distance within which a point lies on a side, in metres.
    """
    bare = without_seam_cap(fit.fitted)
    seam = () if bare is fit.fitted else (SEAM_BESIDE,)
    fit = replace(fit, fitted=bare) if seam else fit
    if fit.model.name == TEE_PARTLY_FILLED.name:
        section = _section_over_weld(fit, covariance)
    elif fit.model.sides[-2].bead:
        section = _section_with_face(fit, covariance)
    else:
        section = _section_without_face(fit, covariance, tolerance)
    return replace(section, conditions=section.conditions + seam)


def _section_with_corners(
    fit: GrooveFit,
    corners: Array,
    covariance: Array,
    places: tuple[float, float],
    **found: Any,
) -> GrooveSection:
    """Section with given corners p2, p3 and p4, x and z, shape (3, 2), in metres.

    Parameters
    ----------
    covariance : ndarray, shape (8, 8)
        Of the coordinates of p2, p3, p4, and of the angles of wall and leg.
    places : tuple of float
        s of p2 on the wall and of p4 on the leg.
    **found
        What else `section_in_plane` takes.
    """
    fitted = fit.fitted
    wall, leg = fitted.curves[0], fitted.curves[-1]
    begin = wall.point_on_curve(float(fitted.kept_along(0).min()))
    end = leg.point_on_curve(float(fitted.kept_along(len(fitted.curves) - 1).max()))
    return section_in_plane(
        np.vstack((begin, corners, end)),
        (wall.tangent_at(places[0]), leg.tangent_at(places[1])),
        rms=float(np.sqrt(np.mean(fitted.residuals[fitted.keep] ** 2))),
        covariance=covariance,
        **{"model_probability": fit.probability, **found},
        model=fit.model.name,
        evidence=fit.evidence,
    )


def _section_with_face(fit: GrooveFit, covariance: Array) -> GrooveSection:
    """p2 is the first corner, p3 and p4 are the last ones."""
    fitted, k = fit.fitted, 2 * len(fit.fitted.corners)
    index = [0, 1, *range(k - 4, k + 2)]
    bow, chord, hollow = _shape_of_face(fitted)
    spread = covariance[np.ix_(index, index)]
    conditions: tuple[str, ...] = (WELD_IN_ROOT,) if bow > CONVEX_WELD_RATIO * chord else ()
    absent: tuple[str, ...] = ()
    if _is_tack(bow, chord):
        conditions, absent = (TACK_WELD,), ("p3", "p4")
        for k, side, s in ((2, -3, fitted.places[-2][0]), (4, -1, fitted.places[-1][1])):
            spread[k : k + 2, k : k + 2] += _covariance_along_side(
                fitted.curves[side], s, BURIED_DEPTH_IN_CHORDS * chord, 0.0
            )
    # The area is that over the face, which bulges or sags, not that over its chord.
    return _section_with_corners(
        fit,
        fitted.corners[[0, -2, -1]],
        spread,
        (fitted.places[0][0], fitted.places[-1][1]),
        area_variance=(HOLLOW_SIGMA_SHARE * hollow) ** 2,
        hollow=hollow,
        conditions=conditions,
        absent=absent,
    )


def _section_over_weld(fit: GrooveFit, covariance: Array) -> GrooveSection:
    """p3 and p4 are the toes of the weld, which bounds the area that is left."""
    fitted, weld = fit.fitted, len(fit.fitted.curves) - 2
    height = _height_sigmas(fitted)
    total = _covariance_of_top_and_angles(covariance - fit.other_readings) + fit.other_readings
    toes = [(flank, *_find_toe(fit, flank)) for flank in (weld - 1, weld + 1)]
    points = [fitted.curves[flank].point_on_curve(s) for flank, s, *_ in toes]
    corners, places = np.array((fitted.corners[0], *points)), [s for _, s, *_ in toes]
    for k, (flank, s, sigma, _) in zip((2, 4), toes, strict=True):
        total[k : k + 2, k : k + 2] += _covariance_along_side(
            fitted.curves[flank], s, sigma, height[flank]
        )
    surface = _weld_surface(fit, slice(toes[0][-1], toes[1][-1] + 1))
    chord = corners[2] - corners[1]
    width = float(np.linalg.norm(chord))
    above = (surface - corners[1]) @ (-chord[1], chord[0]) / width
    if _is_tack(float(above.max(initial=0.0)), width):
        return _section_with_face(fit, covariance)
    line = np.vstack((corners[1], surface, corners[2]))
    own = np.array([fitted.places[0][1], places[0], *fitted.kept_along(weld - 1)])
    for name, along in (("bevel", own), ("weld", line @ chord)):
        if np.diff(np.sort(along)).max() > MOST_HIDDEN_SHARE * np.ptp(along):
            raise GrooveNotFound(
                "ambiguous",
                f"too little is seen of the {name}. Look at the groove more squarely.",
                fit.row.points,
            )
    # Over a hole the surface may rise or sag.
    holes = np.linalg.norm(np.diff(line, axis=0), axis=1)
    return _section_with_corners(
        fit,
        corners,
        total,
        (fitted.places[0][0], places[1]),
        surface=surface,
        area_variance=HOLLOW_SIGMA_SHARE**2 * float(np.sum(holes**4)),
        conditions=(WELD_IN_GROOVE,),
    )


def _find_toe(fit: GrooveFit, flank: int) -> tuple[float, float, int]:
    """Find where a weld meets one of its flanks.

    Parameters
    ----------
    fit : GrooveFit
        Whose last side but one is the weld.
    flank : int
        Number of the side before or after it.

    Returns
    -------
    s, sigma : float
        Of the toe along the flank, and its standard deviation, in metres.
    first : int
        The first point of the weld as seen from the flank.
    """
    row, fitted = fit.row, fit.fitted
    weld, n = len(fitted.curves) - 2, len(fit.row.points)
    curve, order = fitted.curves[flank], 1 if flank < weld else -1
    # From the far end of the flank to the middle of the weld.
    own, far = fitted.spans[weld], fitted.spans[flank]
    reach = (far.start if order > 0 else far.stop), (own.start + own.stop) // 2
    points = row.points[slice(*reach)] if order > 0 else row.points[slice(*reach[::-1])][::-1]
    limit = OUTLIER_SIGMAS * max(float(fitted.sigmas[flank]), LEAST_NOISE)
    end = max(end_of_support(np.abs(curve.signed_distances(points)) < limit), 1)
    last = points[end - 1]
    beside = points[end:][np.linalg.norm(points[end:] - last, axis=1) < TOE_REACH]
    start = curve.position_along_chord(*last.tolist())
    first = reach[0] + end if order > 0 else reach[0] - 1 - end
    first = min(max(first, 0), n - 1)
    if len(beside) >= FEWEST_TOE_POINTS:
        centre = beside.mean(axis=0)
        spread, axes = np.linalg.eigh(np.cov(beside.T))
        direction = axes[:, 1] * np.sign(axes[:, 1] @ (beside[-1] - beside[0]))
        line = CubicCurve(*centre.tolist(), *direction.tolist())
        met = intersect_curves(curve, line, start)
        if met is not None and abs(met[0] - start) < TOE_REACH:
            tangent = np.array(curve.tangent_at(met[0]))
            sine = abs(float(tangent[0] * direction[1] - tangent[1] * direction[0]))
            share = 4 * min(fitted.variance_inflation / len(beside), 1.0)
            sigma = sqrt(share * max(spread[0], 0.0)) / sine + LEAST_TOE_SIGMA
            # If the flank ends well before, an undercut or a hole hides the toe.
            gap = float(gaps_beside_corners(fitted)[-1 - (order > 0), int(order < 0)])
            return met[0], sigma + (gap if gap > MEETING_REACH else 0.0), first
    return start, UNSEEN_TOE_SIGMA, first


def _weld_surface(fit: GrooveFit, between: slice) -> Array:
    """Points of a weld's surface, shape (m, 2), of those between its toes, in metres."""
    row = select_points(fit.row, between)
    if not len(row):
        return row.points
    near = np.abs(fit.fitted.curves[-2].signed_distances(row.points)) < SURFACE_REACH
    # What hangs together with it is of the surface, too, however high it is.
    runs = find_runs(row)
    return np.asarray(row.points[np.logical_or.reduceat(near, runs.first).repeat(runs.count)])


def _is_tack(bow: float, chord: float) -> bool:
    """Whether a face of a height over its chord, in metres, is a tack's."""
    return bow > max(TACK_RATIO * chord, TACK_HEIGHT)


def _shape_of_face(fitted: FittedProfile) -> tuple[float, float, float]:
    """Height of a face over its chord, towards the sensor, the chord, and the area behind it."""
    root, start, end = fitted.curves[-2], fitted.places[-2][1], fitted.places[-1][0]
    (q, _), (end_q, _) = root.height_and_slope(start), root.height_and_slope(end)
    along, rise = end - start, end_q - q
    chord = hypot(along, rise)
    s = start + along * _FACE_SHARES
    height = root.c0 + s * (root.c1 + s * (root.c2 + s * root.c3))
    away = ((height - q) * along - (s - start) * rise) / max(chord, 1e-9)
    hollow = float(away.sum()) * chord / (FACE_HEIGHT_SAMPLES - 1)
    return float(-away[np.abs(away).argmax()]), chord, hollow


def _section_without_face(fit: GrooveFit, covariance: Array, tolerance: float) -> GrooveSection:
    """p3 and p4 at the ends of bevel and leg, or somewhere between their ends and the apex."""
    row, fitted = fit.row, fit.fitted
    bevel, leg = fitted.curves[-2:]
    apex_bevel, apex_leg = fitted.places[-1]
    off_bevel = np.abs(bevel.signed_distances(row.points))
    off_leg = np.abs(leg.signed_distances(row.points))
    # If the two are near each other a point belongs to the nearer one.
    on_bevel = (off_bevel < tolerance) & (off_bevel < off_leg)
    on_leg = (off_leg < tolerance) & (off_leg <= off_bevel)
    turn = int((-row.x_s / row.z_s).searchsorted(-fitted.corners[-1][0] / fitted.corners[-1][1]))
    last = max(end_of_support(on_bevel[:turn]) - 1, 0)
    last += int(np.logical_and.accumulate(on_bevel[last + 1 : turn]).sum())
    s_last = bevel.position_along_chord(*row.points[last].tolist())
    opening = abs(float(leg.signed_distances(np.array([bevel.point_on_curve(s_last)]))[0]))
    height = _height_sigmas(fitted)
    total = _covariance_of_top_and_angles(covariance)
    under = _first_point_under_bevel(row, leg, last, apex_leg, on_leg)
    if opening > LEAST_OPENING and under is not None:
        step = _column_spacing_along_bevel(row, bevel, last, on_bevel)
        # A root face or a rounded edge that goes on from the bevel leaves it slowly.
        sure = OUTLIER_SIGMAS * max(float(fitted.sigmas[-2]), LEAST_NOISE)
        surely = int(np.flatnonzero((off_bevel < min(sure, tolerance))[: last + 1])[-1])
        hidden = abs(int(row.columns[under] - row.columns[surely]))
        s3 = bevel.position_along_chord(*row.points[surely].tolist()) + 0.5 * step * hidden
        p3 = bevel.point_on_curve(s3)
        s4 = leg.position_along_chord(*p3)
        # What is taken for the leg under it may be a reflection. Then the bevel goes on.
        reflected = float(np.mean((np.abs(fitted.residuals) > LEAST_REFLECTION_DISTANCE) & ~on_leg))
        farther = sqrt(reflected / 3)
        opening = float(np.linalg.norm(np.subtract(p3, leg.point_on_curve(s4))))
        # As many columns may be lost before the edge as after it: their difference is triangular.
        along_3 = hypot(
            step * hidden / sqrt(24), farther * min(abs(apex_bevel - s3), FARTHEST_ROOT_DISTANCE)
        )
        along_4 = hypot(
            max(opening / 4, LEAST_UNSEEN_SIGMA),
            farther * min(abs(apex_leg - s4), FARTHEST_ROOT_DISTANCE),
        )
        found: dict[str, Any] = {"conditions": (OPEN_ROOT,), "absent": ("p4",)}
        found["root_opening"] = opening
    else:
        first = len(row.points) - end_of_support(on_leg[turn:][::-1])
        s_first = leg.position_along_chord(*row.points[min(first, len(row.points) - 1)].tolist())
        s3, s4 = 0.5 * (s_last + apex_bevel), 0.5 * (s_first + apex_leg)
        # What is taken for the ends of bevel and leg may be reflections.
        farther = sqrt(reflection_probability(fitted) / 3) * FARTHEST_ROOT_DISTANCE
        along_3, along_4 = (
            hypot(max(abs(away) / sqrt(12), LEAST_UNSEEN_SIGMA), farther)
            for away in (apex_bevel - s_last, s_first - apex_leg)
        )
        found = {"conditions": (ROOT_NOT_SEEN,), "absent": ("p3", "p4")}
        found["model_probability"] = fit.probability * PROBABILITY_OF_NO_FACE
    points = np.array((fitted.corners[0], bevel.point_on_curve(s3), leg.point_on_curve(s4)))
    total[2:4, 2:4] = _covariance_along_side(bevel, s3, along_3, height[-2])
    total[4:6, 4:6] = _covariance_along_side(leg, s4, along_4, height[-1])
    return _section_with_corners(fit, points, total, (fitted.places[0][0], s4), **found)


def _first_point_under_bevel(
    row: Profile, leg: CubicCurve, last: int, apex: float, on_leg: NDArray[np.bool_]
) -> int | None:
    """First point after the end of a bevel where the leg is seen under it; None if it is not.

    It is there beyond where the two, drawn on, meet.
    """
    index = last + 1 + np.flatnonzero(on_leg[last + 1 : last + 1 + POINTS_AFTER_BEVEL])
    s, _ = leg.local_coordinates(row.points[index])
    under = index[s < apex - LEAST_OPENING]
    return int(under[0]) if len(under) >= FEWEST_POINTS_UNDER_BEVEL else None


def _column_spacing_along_bevel(
    row: Profile, bevel: CubicCurve, last: int, on_bevel: NDArray[np.bool_]
) -> float:
    """Distance along a bevel between neighbouring columns near its end."""
    index = np.flatnonzero(on_bevel[: last + 1])[-10:]
    if len(index) < 2:
        return 0.0
    s, _ = bevel.local_coordinates(row.points[index])
    columns = np.abs(row.columns[index[-1]] - row.columns[index[0]])
    return float((s[-1] - s[0]) / max(int(columns), 1))


def _height_sigmas(fitted: FittedProfile) -> Array:
    """Standard deviation of each side's height at one of its ends, in metres, shape (k,)."""
    # A line's height at its end is known half as well as in its middle.
    share = np.minimum(4 * fitted.variance_inflation / fitted.counts, 1.0)
    return np.asarray(fitted.sigmas * np.sqrt(share))


def _covariance_of_top_and_angles(covariance: Array) -> Array:
    """That of p2 and of the angles of wall and leg, shape (8, 8), from that of a whole fit."""
    kept = [0, 1, -2, -1]
    total = np.zeros((8, 8))
    total[np.ix_(kept, kept)] = covariance[np.ix_(kept, kept)]
    return total


def _covariance_along_side(curve: CubicCurve, s: float, along: float, across: float) -> Array:
    """Covariance of a point on a side, shape (2, 2)."""
    t = np.array(curve.tangent_at(s))
    n = np.array((t[1], -t[0]))
    return np.asarray(along**2 * np.outer(t, t) + across**2 * np.outer(n, n))
