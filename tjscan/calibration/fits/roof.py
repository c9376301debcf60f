"""The laser line over a roof edge: two straight lines that meet, each with its errors."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from tjscan.calibration.fits.consensus import (
    OUTLIER_SIGMAS,
    InlierMask,
    best_hypothesis,
    evenly_spaced_indices,
    refit_and_trim,
)
from tjscan.calibration.fits.line import (
    MIN_LINE_LENGTH,
    MIN_POINTS,
    LineFit,
    describe_line,
    distances_from_line,
)
from tjscan.calibration.noise import NoiseModel
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, frozen_arrays
from tjscan.laser.profile import Profile

LINES_TRIED: Final = 5
"""A profile holds the two flanks, perhaps the table on both sides, and what else lies there."""
ANCHOR_POINTS: Final = 48
NEIGHBOURS: Final = 12
"""Lines are drawn through each anchor and its next ones: a flank may fill little of a profile."""
SCORED_POINTS: Final = 240
MIN_ANGLE: Final = float(np.radians(20.0))
"""Radians between the flanks; on flatter roofs the edge lies anywhere."""
MAX_GAP: Final = 5e-3
"""Metres between the edge and the next point of a flank: the edge itself may be rounded or
glare."""

CROSSING_POINTS: Final = 5
"""Points of the other flank that may lie near a line where both meet."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class RoofFit:
    """Two lines fitted to the flanks of a roof edge in a profile, frame s.

    Parameters
    ----------
    left, right : LineFit
        The flanks, the one at smaller x_s first.
    edge_s : ndarray, shape (3,)
        Where they meet, y = 0, in metres.
    """

    left: LineFit
    right: LineFit
    edge_s: Array

    @property
    def point_count(self) -> int:
        """Number of points on both flanks."""
        return self.left.point_count + self.right.point_count


def fit_roof(profile: Profile, noise: NoiseModel) -> RoofFit:
    """Fit the two straight lines that meet in a profile.

    Of all pairs of straight lines that meet, the one is taken whose shorter line is longest.

    Parameters
    ----------
    profile : Profile
        Of a roof edge.
    noise : NoiseModel
        States the range noise of a point.

    Raises
    ------
    CalibrationRefused
        If no two lines of the profile meet.
    """
    valid = profile.valid
    points = np.column_stack((profile.x_s[valid], profile.z_s[valid]))
    fits = [describe_line(points, line, valid, noise) for line in _lines(points, noise.range)]
    roofs = [roof for pair in combinations(fits, 2) if (roof := _meeting(profile, *pair))]
    if not roofs:
        raise CalibrationRefused(
            "no roof edge seen",
            f"the profile holds {len(points)} points and {len(fits)} straight lines, no two of "
            f"which meet at {np.degrees(MIN_ANGLE):.0f}° or more; let the laser line cross the "
            "edge with both flanks in range",
        )
    return max(roofs, key=lambda roof: min(roof.left.span, roof.right.span))


def _lines(points: Array, sigma: float) -> list[InlierMask]:
    """Straight lines in the profile, those with most points first."""
    found: list[InlierMask] = []
    free = np.ones(len(points), dtype=bool)
    while len(found) < LINES_TRIED and free.sum() >= MIN_POINTS:
        left = np.flatnonzero(free)
        start = _most_crowded_line(points[left], sigma)
        if start.sum() >= MIN_POINTS:
            start = refit_and_trim(
                lambda m, p=points[left]: distances_from_line(p, m),  # type: ignore[misc]
                start,
                sigma,
            )
        if start.sum() < MIN_POINTS:
            break
        line = np.zeros(len(points), dtype=bool)
        line[left[start]] = True
        free[left[start]] = False
        if np.ptp(points[line], axis=0).max() >= MIN_LINE_LENGTH:
            found.append(line)
    return found


def _most_crowded_line(points: Array, sigma: float) -> InlierMask:
    """Points close to the line through two near ones that most points are close to."""
    tolerance = 2 * OUTLIER_SIGMAS * sigma
    anchors = evenly_spaced_indices(len(points), ANCHOR_POINTS)
    pair = np.array(
        [(i, j) for k, i in enumerate(anchors) for j in anchors[k + 1 : k + 1 + NEIGHBOURS]]
    )
    along = points[pair[:, 1]] - points[pair[:, 0]]
    length = np.linalg.norm(along, axis=1)
    pair, along = pair[length > 0], along[length > 0] / length[length > 0, None]
    normal = np.column_stack((-along[:, 1], along[:, 0]))
    offset = np.einsum("ij,ij->i", normal, points[pair[:, 0]])
    few = points[evenly_spaced_indices(len(points), SCORED_POINTS)]
    k = best_hypothesis(normal @ few.T - offset[:, None], tolerance)
    return np.asarray(np.abs(points @ normal[k] - offset[k]) < tolerance)


def _meeting(profile: Profile, a: LineFit, b: LineFit) -> RoofFit | None:
    """The roof that two lines make, if they meet between their points."""
    left, right = (a, b) if a.point_s[0] < b.point_s[0] else (b, a)
    ends = np.stack((left.direction_s[[0, 2]], -right.direction_s[[0, 2]]), axis=1)
    if abs(np.linalg.det(ends)) < np.sin(MIN_ANGLE):
        return None
    away = np.linalg.solve(ends, (right.point_s - left.point_s)[[0, 2]])
    edge = left.point_s + away[0] * left.direction_s
    for line, side in ((left, -1.0), (right, 1.0)):
        x, z = profile.x_s[line.inlier], profile.z_s[line.inlier]
        along = side * ((x - edge[0]) * line.direction_s[0] + (z - edge[2]) * line.direction_s[2])
        # Some points of the other flank may lie on a line's continuation.
        if not -MAX_GAP < np.partition(along, CROSSING_POINTS)[CROSSING_POINTS] < MAX_GAP:
            return None
    return RoofFit(left, right, edge)
