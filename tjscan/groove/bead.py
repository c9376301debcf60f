"""The face of a weld bead at the root: an arc proposed where a straight root fits badly."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from math import hypot
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.background import PointRuns
from tjscan.groove.curves import CubicCurve
from tjscan.groove.fitted_profile import OrderedProfilePoints, corners_between_sides
from tjscan.groove.hypotheses import PolylineHypothesis, bearing_tangents, end_of_support
from tjscan.groove.models import GrooveModel
from tjscan.groove.refinement import FACE_BLUNTNESS

BEAD_PLACES: Final = np.array(
    list(product((0.03, 0.12, 0.22, 0.32), (0.4, 0.5, 0.6), (0.68, 0.78, 0.88, 0.97)))
)
"""Where, as shares of the bead, the three points of a proposed parabola lie."""

FEWEST_BEAD_POINTS: Final = 6
"""Points between the neighbours that are worth a parabola."""

FEWEST_FACE_RUN: Final = 4
"""Points that show where a face goes which begins at bevel or leg."""

LEAST_BEAD_GAIN: Final = 3.0
"""By how many points a parabola must explain more than a straight face."""

REACH_COST: Final = 0.3
"""What each point costs a face that reaches farther, times the logarithm of how much farther."""


def fit_bead(
    row: OrderedProfilePoints,
    runs: PointRuns,
    hypothesis: PolylineHypothesis,
    model: GrooveModel,
    tolerance: float,
) -> PolylineHypothesis:
    """Fit a parabola to the bead side of a hypothesis, the one that explains most points.

    Parameters
    ----------
    row : OrderedProfilePoints
    runs : PointRuns
        Of its points.
    hypothesis : PolylineHypothesis
        With straight inner sides.
    model : GrooveModel
        What its sides are like; without a bead among them the hypothesis stays as it is.
    tolerance : float
        Distance within which a point supports a side, in metres.
    """
    k = next((i for i, side in enumerate(model.sides) if side.bead), None)
    if k is None:
        return hypothesis
    before, straight, after = hypothesis.sides[k - 1 : k + 2]
    first, last = row.tangents.searchsorted(
        bearing_tangents(hypothesis.corners[k - 1 : k + 1])
    ).tolist()
    a = end_of_support(np.abs(before.signed_distances(row.points[:last])) < tolerance)
    b = len(row.points) - end_of_support(
        np.abs(after.signed_distances(row.points[first:]))[::-1] < tolerance
    )
    if b - a < FEWEST_BEAD_POINTS:
        return hypothesis
    points = row.points[a:b]
    pays = np.minimum((straight.signed_distances(points) / tolerance) ** 2, 1)
    own = runs.within(a, b)
    flat = float(own.total_cost(pays))
    curve = _parabola(points, own, before, after, tolerance, flat - LEAST_BEAD_GAIN)
    if curve is None:
        return hypothesis
    sides = (*hypothesis.sides[:k], curve, *hypothesis.sides[k + 1 :])
    corners = hypothesis.corners.copy()
    corners[k - 1], corners[k] = points[0], points[-1]
    met = corners_between_sides(sides, corners)
    if met is None or hypot(*(met[0][k] - met[0][k - 1]).tolist()) > model.sides[k].longest:
        return hypothesis
    return replace(hypothesis, sides=sides, corners=met[0])


def add_root_bead(
    row: OrderedProfilePoints, runs: PointRuns, hypothesis: PolylineHypothesis, tolerance: float
) -> PolylineHypothesis | None:
    """Add the face of a root bead between the last two sides of a hypothesis without one.

    Parameters
    ----------
    row : OrderedProfilePoints
    runs : PointRuns
        Of its points.
    hypothesis : PolylineHypothesis
        Its last corner is where the last two sides, drawn on, meet.
    tolerance : float
        Distance within which a point supports a side, in metres.

    Returns
    -------
    PolylineHypothesis or None
        With one side more; None where no face fits between.
    """
    before, after = hypothesis.sides[-2:]
    apex = int(row.tangents.searchsorted(float(bearing_tangents(hypothesis.corners[-1]))))
    a = end_of_support(np.abs(before.signed_distances(row.points[:apex])) < tolerance)
    b = len(row.points) - end_of_support(
        np.abs(after.signed_distances(row.points[apex:]))[::-1] < tolerance
    )
    if b - a < FEWEST_BEAD_POINTS:
        return None
    points = row.points[a:b]
    curve = _parabola(points, runs.within(a, b), before, after, tolerance, np.inf)
    if curve is None:
        return None
    sides = (*hypothesis.sides[:-1], curve, after)
    met = corners_between_sides(sides, np.vstack((hypothesis.corners[:-1], points[0], points[-1])))
    return None if met is None else PolylineHypothesis(sides, met[0], hypothesis.cost)


def attached_faces(
    row: OrderedProfilePoints, runs: PointRuns, hypothesis: PolylineHypothesis, tolerance: float
) -> list[PolylineHypothesis]:
    """Add a face along the points that go on, without a jump, from the bevel or from the leg.

    Parameters are those of `add_root_bead`.
    """
    before, after = hypothesis.sides[-2:]
    apex = int(row.tangents.searchsorted(float(bearing_tangents(hypothesis.corners[-1]))))
    a = end_of_support(np.abs(before.signed_distances(row.points[:apex])) < tolerance)
    b = len(row.points) - end_of_support(
        np.abs(after.signed_distances(row.points[apex:]))[::-1] < tolerance
    )
    found = []
    for start, end in (
        (a, min(runs.bounds_of_run(max(a - 1, 0))[1], b)),
        (max(runs.bounds_of_run(min(b, len(row.points) - 1))[0], a), b),
    ):
        if end - start < FEWEST_FACE_RUN:
            continue
        points = row.points[start:end]
        middle = points.mean(axis=0)
        away = points - middle
        direction = np.linalg.eigh(away.T @ away)[1][:, 1]
        direction *= np.copysign(1.0, direction @ (points[-1] - points[0]))
        face = CubicCurve(*middle.tolist(), *direction.tolist())
        sides = (*hypothesis.sides[:-1], face, after)
        met = corners_between_sides(
            sides, np.vstack((hypothesis.corners[:-1], points[0], points[-1]))
        )
        if met is not None:
            found.append(PolylineHypothesis(sides, met[0], hypothesis.cost))
    return found


def _parabola(
    points: Array,
    runs: PointRuns,
    before: CubicCurve,
    after: CubicCurve,
    tolerance: float,
    most: float,
) -> CubicCurve | None:
    """The parabola over the neighbours' ends that costs least; None if that exceeds `most`."""
    if most < 0:
        return None
    start = before.points_at(before.position_along_chord(*points[0].tolist()))
    end = after.points_at(after.position_along_chord(*points[-1].tolist()))
    length = hypot(end[0] - start[0], end[1] - start[1])
    if length < tolerance:
        return None
    tx, tz = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    chord = CubicCurve(0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]), tx, tz)
    s, d = chord.local_coordinates(points)
    n = len(points) - 1
    triples = np.rint(BEAD_PLACES * n).astype(np.intp)
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
    cost += REACH_COST * len(points) * np.log(reach / tolerance)
    best = int(cost.argmin())
    if cost[best] > most:
        return None
    return chord._replace(
        c0=float(coefficients[best, 0]),
        c1=float(coefficients[best, 1]),
        c2=float(coefficients[best, 2]),
    )
