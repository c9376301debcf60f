"""Other forms that a groove's points suggest: a weld bead at the root, none, a bevel in two facets.

The face of a bead is proposed as an arc if a straight root fits badly, or as what goes on from
bevel or leg; a knee of the bevel if one straight side fits badly. For the form without a face at
the root a bound shows whether it is worth a search.
"""

from __future__ import annotations

from itertools import product
from math import hypot
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.refinement import FACE_BLUNTNESS
from tjscan.groove.reflections import PointRuns
from tjscan.groove.settings import GrooveModel
from tjscan.groove.sides import (
    CubicCurve,
    FittedProfile,
    OrderedProfilePoints,
    Polyline,
    bearing_tangents,
    corners_between_sides,
    end_of_support,
)

BEAD_POINT_SHARES: Final = np.array(
    list(product((0.03, 0.12, 0.22, 0.32), (0.4, 0.5, 0.6), (0.68, 0.78, 0.88, 0.97)))
)
"""Where, as shares of the bead, the three points of a proposed parabola lie."""

FEWEST_BEAD_POINTS: Final = 6
"""Points between the neighbours that are worth a parabola."""

FEWEST_POINTS_OF_FACE: Final = 4
"""Points that show where a face goes which begins at bevel or leg."""

LEAST_GAIN_OF_PARABOLA: Final = 3.0
"""By how many points a parabola must explain more than a straight face."""

WIDER_TOLERANCE_COST: Final = 0.3
"""What each point costs a face that reaches farther, times the logarithm of how much farther."""

KNEE_POINT_SHARES: Final = np.array(
    list(product((0.03, 0.12, 0.24), (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8), (0.76, 0.88, 0.97)))
)
"""Where, as shares of the side's points, the three points of a proposed pair of lines lie."""

FARTHEST_KNEE_POINT: Final = 2.0e-3
"""Farther from the side a point proposes nothing, in metres."""

FEWEST_DIVIDED_POINTS: Final = 12
"""Points of a side that is worth dividing."""


def fit_parabola_to_bead(
    row: OrderedProfilePoints,
    runs: PointRuns,
    line: Polyline,
    model: GrooveModel,
    tolerance: float,
) -> Polyline:
    """Fit a parabola to the bead side of a polyline, the one that explains most points.

    Parameters
    ----------
    row : OrderedProfilePoints
    runs : PointRuns
        Of its points.
    line : Polyline
        With straight inner sides.
    model : GrooveModel
        What its sides are like; without a bead among them the polyline stays as it is.
    tolerance : float
        Distance within which a point supports a side, in metres.
    """
    k = next((i for i, side in enumerate(model.sides) if side.bead), None)
    if k is None:
        return line
    before, straight, after = line.sides[k - 1 : k + 2]
    first, last = row.tangents.searchsorted(bearing_tangents(line.corners[k - 1 : k + 1])).tolist()
    a, b = _point_range_between_sides(row, (before, after), (last, first), tolerance)
    if b - a < FEWEST_BEAD_POINTS:
        return line
    points = row.points[a:b]
    pays = np.minimum((straight.signed_distances(points) / tolerance) ** 2, 1)
    own = runs.within(a, b)
    flat = float(own.total_cost(pays))
    curve = _cheapest_parabola(
        points, own, (before, after), tolerance, flat - LEAST_GAIN_OF_PARABOLA
    )
    if curve is None:
        return line
    sides = (*line.sides[:k], curve, *line.sides[k + 1 :])
    corners = line.corners.copy()
    corners[k - 1], corners[k] = points[0], points[-1]
    met = corners_between_sides(sides, corners)
    if met is None or hypot(*(met[0][k] - met[0][k - 1]).tolist()) > model.sides[k].longest:
        return line
    return line._replace(sides=sides, corners=met[0])


def add_root_arc(
    row: OrderedProfilePoints, runs: PointRuns, line: Polyline, tolerance: float
) -> Polyline | None:
    """Add the arc of a root bead between the last two sides of a polyline without one.

    Parameters
    ----------
    row : OrderedProfilePoints
    runs : PointRuns
        Of its points.
    line : Polyline
        Its last corner is where the last two sides, drawn on, meet.
    tolerance : float
        Distance within which a point supports a side, in metres.

    Returns
    -------
    Polyline or None
        With one side more; None if no arc fits between.
    """
    a, b = _point_range_at_root(row, line, tolerance)
    if b - a < FEWEST_BEAD_POINTS:
        return None
    points = row.points[a:b]
    curve = _cheapest_parabola(points, runs.within(a, b), line.sides[-2:], tolerance, np.inf)
    return None if curve is None else _insert_root_face(line, curve, points)


def add_faces_along_neighbours(
    row: OrderedProfilePoints, runs: PointRuns, line: Polyline, tolerance: float
) -> list[Polyline]:
    """Add a face along the points that go on, without a jump, from the bevel or from the leg.

    Parameters are those of `add_root_arc`.
    """
    a, b = _point_range_at_root(row, line, tolerance)
    found = []
    for start, end in (
        (a, min(runs.bounds_of_run(max(a - 1, 0))[1], b)),
        (max(runs.bounds_of_run(min(b, len(row.points) - 1))[0], a), b),
    ):
        if end - start < FEWEST_POINTS_OF_FACE:
            continue
        points = row.points[start:end]
        middle = points.mean(axis=0)
        away = points - middle
        direction = np.linalg.eigh(away.T @ away)[1][:, 1]
        direction *= np.copysign(1.0, direction @ (points[-1] - points[0]))
        face = CubicCurve(*middle.tolist(), *direction.tolist())
        found.append(_insert_root_face(line, face, points))
    return [one for one in found if one is not None]


def _point_range_at_root(
    row: OrderedProfilePoints, line: Polyline, tolerance: float
) -> tuple[int, int]:
    """First point after those of the last side but one, and first point of the last side."""
    apex = int(row.tangents.searchsorted(float(bearing_tangents(line.corners[-1]))))
    return _point_range_between_sides(row, line.sides[-2:], (apex, apex), tolerance)


def _point_range_between_sides(
    row: OrderedProfilePoints,
    sides: tuple[CubicCurve, ...],
    ends: tuple[int, int],
    tolerance: float,
) -> tuple[int, int]:
    """First point after those on a side, and first point on the side after it.

    The points of the first side come before the first of `ends`, of the other from the second on.
    """
    a = end_of_support(np.abs(sides[0].signed_distances(row.points[: ends[0]])) < tolerance)
    on_second = np.abs(sides[1].signed_distances(row.points[ends[1] :])) < tolerance
    return a, len(row.points) - end_of_support(on_second[::-1])


def _insert_root_face(line: Polyline, face: CubicCurve, points: Array) -> Polyline | None:
    """A polyline with a face over points before its last side; None if they do not meet."""
    sides = (*line.sides[:-1], face, line.sides[-1])
    met = corners_between_sides(sides, np.vstack((line.corners[:-1], points[0], points[-1])))
    return None if met is None else line._replace(sides=sides, corners=met[0])


def remove_root_face(line: Polyline) -> Polyline | None:
    """A polyline without the face at the root; None if its neighbours do not meet."""
    sides = (*line.sides[:-2], line.sides[-1])
    met = corners_between_sides(sides, line.corners[:-1])
    return None if met is None else line._replace(sides=sides, corners=met[0])


def _cheapest_parabola(
    points: Array,
    runs: PointRuns,
    neighbours: tuple[CubicCurve, ...],
    tolerance: float,
    most: float,
) -> CubicCurve | None:
    """The parabola over the neighbours' ends that costs least; None if that exceeds `most`."""
    if most < 0:
        return None
    before, after = neighbours
    start = before.point_on_curve(before.position_along_chord(*points[0].tolist()))
    end = after.point_on_curve(after.position_along_chord(*points[-1].tolist()))
    length = hypot(end[0] - start[0], end[1] - start[1])
    if length < tolerance:
        return None
    tx, tz = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    chord = CubicCurve(0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]), tx, tz)
    s, d = chord.local_coordinates(points)
    n = len(points) - 1
    triples = np.rint(BEAD_POINT_SHARES * n).astype(np.intp)
    s3 = s[triples]
    basis = np.stack((np.ones_like(s3), s3, s3 * s3), axis=-1)
    distinct = np.abs(np.diff(s3, axis=1)).min(axis=1) > tolerance
    if not distinct.any():
        return None
    coefficients = np.linalg.solve(basis[distinct], d[triples][distinct][..., None])[..., 0]
    steep = np.abs(coefficients[:, 2]) * length > 2
    away = d - (coefficients @ np.vstack((np.ones_like(s), s, s * s)))
    # A face that rises high is no parabola.
    reach = np.maximum(tolerance, FACE_BLUNTNESS * np.abs(coefficients[:, 2]) * length**2 / 4)
    cost = runs.total_cost(np.minimum((away / reach[:, None]) ** 2, 1)) + 1e9 * steep
    cost += WIDER_TOLERANCE_COST * len(points) * np.log(reach / tolerance)
    best = int(cost.argmin())
    if cost[best] > most:
        return None
    return chord._replace(
        c0=float(coefficients[best, 0]),
        c1=float(coefficients[best, 1]),
        c2=float(coefficients[best, 2]),
    )


def divide_side_at_knee(
    row: OrderedProfilePoints, fitted: FittedProfile, k: int, tolerance: float, least_gain: float
) -> Polyline | None:
    """Divide a fitted side into the two lines that explain most of its points.

    Parameters
    ----------
    row : OrderedProfilePoints
    fitted : FittedProfile
    k : int
        Number of the side.
    tolerance : float
        Distance within which a point supports a side, in metres.
    least_gain : float
        By how many points two lines must explain more than one side.

    Returns
    -------
    Polyline or None
        With one side more; None if no two lines explain that much more.
    """
    own = fitted.spans[k]
    points, residuals = row.points[own], fitted.residuals[own]
    near = np.flatnonzero(np.abs(residuals) < FARTHEST_KNEE_POINT)
    if len(near) < FEWEST_DIVIDED_POINTS:
        return None
    side = fitted.curves[k]
    s, d = side.local_coordinates(points)
    n = len(near) - 1
    triples = near[np.rint(KNEE_POINT_SHARES * n).astype(np.intp)]
    s3, d3 = s[triples], d[triples]
    apart = np.diff(s3, axis=1)
    distinct = apart.min(axis=1) > 4 * tolerance
    if not distinct.any():
        return None
    s3, d3 = s3[distinct], d3[distinct]
    slopes = np.diff(d3, axis=1) / apart[distinct]
    along = s - s3[:, 1:2]
    away = d - d3[:, 1:2] - along * np.where(along < 0, slopes[:, :1], slopes[:, 1:])
    cost = np.minimum((away / tolerance) ** 2, 1).sum(axis=1)
    best = int(cost.argmin())
    if cost[best] > np.minimum((residuals / tolerance) ** 2, 1).sum() - least_gain:
        return None
    x, z = side.cx + s3[best, 1] * side.tx, side.cz + s3[best, 1] * side.tz
    height = float(d3[best, 1])
    centre = x + height * side.tz, z - height * side.tx
    facets = [CubicCurve(*centre, side.tx, side.tz, 0.0, float(m)) for m in slopes[best]]
    sides = (*fitted.curves[:k], *facets, *fitted.curves[k + 1 :])
    near_corners = np.insert(fitted.corners, k, centre, axis=0)
    met = corners_between_sides(sides, near_corners)
    return None if met is None else Polyline(sides, met[0], np.inf)


def bound_cost_of_removing_root(
    row: OrderedProfilePoints, fitted: FittedProfile, tolerance: float
) -> float:
    """Bound what leaving out the face at the root costs, before anything is fitted.

    Either its points are left to its neighbours, drawn on to where they meet; or the bevel is
    another line, too, which may explain every point that lies on no side between wall and leg, but
    none of the face's and the bevel's.

    Parameters
    ----------
    row : OrderedProfilePoints
    fitted : FittedProfile
        The last side but one is the face.
    tolerance : float
        Distance at which a point stops supporting a side, in metres.

    Returns
    -------
    float
        In outliers.
    """
    root = len(fitted.curves) - 2
    neighbours = fitted.curves[root - 1], fitted.curves[root + 1]
    met = corners_between_sides(neighbours, fitted.corners[root - 1 : root])
    if met is None:
        return 0.0
    first, (bevel, start, end) = fitted.edges[1], fitted.edges[root - 1 : root + 2]
    pays = np.minimum((fitted.residuals / tolerance) ** 2, 1)
    explained = 1 - pays[bevel:end]
    other_bevel = float(explained.sum()) - np.count_nonzero(pays[first:end] == 1)
    apex = int(row.tangents.searchsorted(bearing_tangents(met[0][0])))
    a, b = min(apex, start), max(apex, end)
    left_to_neighbours = sum(
        float(np.minimum((side.signed_distances(row.points[i:j]) / tolerance) ** 2, 1).sum())
        for side, i, j in zip(neighbours, (a, apex), (apex, b), strict=True)
    )
    return min(other_bevel, left_to_neighbours - float(pays[a:b].sum()))
