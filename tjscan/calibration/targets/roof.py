"""A roof edge as calibration target: two planes that meet, each seen as a line in a profile."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final, Self

import numpy as np

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets import consensus
from tjscan.calibration.targets.line import (
    MIN_LINE_LENGTH,
    LineFit,
    describe_line,
    lines_through_pairs,
    offsets_from_fitted_line,
    offsets_from_lines,
    stack_lines,
)
from tjscan.calibration.targets.plane import (
    PlaneModel,
    PlaneTarget,
    plane_through_lines,
    unknown_plane_starts,
)
from tjscan.calibration.targets.target import LinearisedModel, SeenTarget, TargetModel
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, Mask, array_dataclass
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.profile import Profile

MAX_LINES_FOUND: Final = 5
"""A profile holds the two flanks, perhaps the table on both sides, and other things in view."""
FLANK_ANCHOR_POINTS: Final = 48
"""Points from which lines are drawn: a flank may fill little of a profile."""
TRIAL_LINES_PER_ANCHOR: Final = 12
"""Lines are drawn through each anchor and so many next ones."""
FLANK_SCORED_POINTS: Final = 240
"""Points at which a line is scored: a short flank has to be hit often enough."""
MIN_ROOF_ANGLE: Final = float(np.radians(20.0))
"""Radians between the flanks; on flatter roofs the edge has no definite place."""
MAX_EDGE_GAP: Final = 5e-3
"""Metres from the edge to the next point of a flank: the edge may be rounded or glare."""
MAX_POINTS_PAST_EDGE: Final = 5
"""Points of the other flank that may be near a line at the crossing."""


@array_dataclass
class RoofFit:
    """Two lines fitted to the flanks of a roof edge in a profile, frame s.

    Parameters
    ----------
    left, right : LineFit
        The flanks, the one at smaller x_s first.
    edge_s : ndarray, shape (3,)
        Their intersection, y = 0, in metres.
    """

    left: LineFit
    right: LineFit
    edge_s: Array

    def by_laser(self, profile: Profile, laser: LaserDeviation) -> Array:
        """Changes of both lines, the left one's first, shape (4, m); see `LineFit.by_laser`."""
        return np.concatenate([one.by_laser(profile, laser) for one in (self.left, self.right)])


def fit_roof(profile: Profile, noise: NoiseModel) -> RoofFit:
    """Fit the two straight lines that meet in a profile.

    Of all pairs of straight lines that meet, the pair with the longest shorter line is taken.

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
    points = consensus.valid_points(profile)
    fits = [describe_line(profile, line, noise) for line in _find_lines(points, noise.range)]
    roofs = [roof for pair in combinations(fits, 2) if (roof := _roof_of_lines(profile, *pair))]
    if not roofs:
        raise CalibrationRefused(
            "no roof edge seen",
            f"the profile holds {len(points)} points and {len(fits)} straight lines, no two of "
            f"which meet at {np.degrees(MIN_ROOF_ANGLE):.0f}° or more; let the laser line cross "
            "the edge with both flanks in range",
        )
    return max(roofs, key=lambda roof: min(roof.left.span, roof.right.span))


def _find_lines(points: Array, sigma: float) -> list[Mask]:
    """Straight lines in the profile, those with most points first."""
    found: list[Mask] = []
    free = np.ones(len(points), dtype=bool)
    while len(found) < MAX_LINES_FOUND and free.sum() >= consensus.MIN_CURVE_POINTS:
        left = np.flatnonzero(free)
        line = _most_crowded_line(points[left], sigma)
        if line.sum() < consensus.MIN_CURVE_POINTS:
            break
        free[left[line]] = False
        if np.ptp(points[left[line]], axis=0).max() >= MIN_LINE_LENGTH:
            found.append(np.isin(np.arange(len(points)), left[line]))
    return found


def _most_crowded_line(points: Array, sigma: float) -> Mask:
    """Points of the line through two near ones that most points are close to."""
    anchors = consensus.evenly_spaced_indices(len(points), FLANK_ANCHOR_POINTS)
    pairs = [
        (i, j)
        for k, i in enumerate(anchors)
        for j in anchors[k + 1 : k + 1 + TRIAL_LINES_PER_ANCHOR]
    ]
    lines = lines_through_pairs(points[np.array(pairs)])
    line = consensus.find_inliers(points, lines, offsets_from_lines, sigma, FLANK_SCORED_POINTS)
    if line.sum() < consensus.MIN_CURVE_POINTS:
        return line
    return consensus.refit_and_trim(lambda m: offsets_from_fitted_line(points, m), line, sigma)


def _roof_of_lines(profile: Profile, a: LineFit, b: LineFit) -> RoofFit | None:
    """The roof of two lines, if they meet between their points."""
    left, right = (a, b) if a.point_s[0] < b.point_s[0] else (b, a)
    ends = np.stack((left.direction_s[[0, 2]], -right.direction_s[[0, 2]]), axis=1)
    if abs(np.linalg.det(ends)) < np.sin(MIN_ROOF_ANGLE):
        return None
    away = np.linalg.solve(ends, (right.point_s - left.point_s)[[0, 2]])
    edge = left.point_s + away[0] * left.direction_s
    for line, side in ((left, -1.0), (right, 1.0)):
        x, z = profile.x_s[line.inlier], profile.z_s[line.inlier]
        along = side * ((x - edge[0]) * line.direction_s[0] + (z - edge[2]) * line.direction_s[2])
        # Some points of the other flank may be on a line's continuation.
        nearest = np.partition(along, MAX_POINTS_PAST_EDGE)[MAX_POINTS_PAST_EDGE]
        if not -MAX_EDGE_GAP < nearest < MAX_EDGE_GAP:
            return None
    return RoofFit(left, right, edge)


@dataclass(frozen=True, slots=True, eq=False)
class RoofTarget:
    """A roof edge: two planes that meet, somewhere in frame b.

    Parameters
    ----------
    left, right : PlaneTarget
        The planes; the profiles show the left one at smaller x_s.
    """

    left: PlaneTarget
    right: PlaneTarget

    @property
    def angle(self) -> float:
        """Between the planes on the sensor's side, radians."""
        return float(np.pi - np.arccos(np.clip(self.left.plane.u @ self.right.plane.u, -1, 1)))


@dataclass(frozen=True, slots=True, eq=False)
class RoofModel(TargetModel):
    """Residuals of both flanks of a roof edge; the arm's errors move both together.

    The target's parameters belong to the left plane, then to the right one.

    Parameters
    ----------
    left, right : PlaneModel
        The lines on either plane, from the same poses.
    """

    left: PlaneModel
    right: PlaneModel

    def at_other_poses(self, T_b_f: Array) -> Self:
        """Return the same flanks, taken from other flange poses, shape (n, 4, 4)."""
        return type(self)(self.left.at_other_poses(T_b_f), self.right.at_other_poses(T_b_f))

    def result_fields(self, target: Array, covariance: Array) -> dict[str, Any]:
        """Both planes."""
        left = self.left.estimated_plane(target[:3], covariance[:3, :3])
        right = self.right.estimated_plane(target[3:], covariance[3:, 3:])
        return {"roof": RoofTarget(left, right)}

    @property
    def prior_information(self) -> Array:
        """Nothing is known of either plane: zeros, shape (6, 6)."""
        return np.zeros((6, 6))

    def linearise(self, T_f_s: Array, target: Array) -> LinearisedModel:
        """Offset and tilt on the left plane, then on the right one, k = 4, with derivatives.

        Parameters
        ----------
        T_f_s : ndarray, shape (4, 4)
            The sensor on the flange.
        target : ndarray, shape (6,)
            Tilt, tilt (radians) and height (metres) of the left plane, then of the right one.
        """
        left = self.left.linearise(T_f_s, target[:3])
        right = self.right.linearise(T_f_s, target[3:])
        n = len(left.residuals)
        by_target, own = np.zeros((n, 4, 6)), np.zeros((n, 4, 4))
        by_target[:, :2, :3], by_target[:, 2:, 3:] = left.by_target, right.by_target
        own[:, :2, :2], own[:, 2:, 2:] = left.own_covariance, right.own_covariance
        by_laser = None
        if left.by_laser is not None and right.by_laser is not None:
            by_laser = np.concatenate((left.by_laser, right.by_laser), axis=1)
        return LinearisedModel(
            np.concatenate((left.residuals, right.residuals), axis=1),
            np.concatenate((left.by_pose, right.by_pose), axis=1),
            by_target,
            np.concatenate((left.by_arm, right.by_arm), axis=1),
            own,
            left.noise,
            by_laser,
        )


@dataclass(frozen=True, slots=True, eq=False)
class SeenRoof(SeenTarget[RoofFit]):
    """Pairs of lines on the two planes of a roof edge.

    Parameters
    ----------
    samples : sequence of PosedFit
        The pairs of lines.
    noise : NoiseModel
        Errors of profiles and poses.
    """

    noise: NoiseModel

    @property
    def kind(self) -> str:
        """``roof edge``."""
        return "roof edge"

    @property
    def flanks(self) -> tuple[list[LineFit], list[LineFit]]:
        """Lines on the left and on the right plane."""
        return [fit.left for fit in self.fits], [fit.right for fit in self.fits]

    def starts(self) -> list[Array]:
        """From the lines on either plane, as if it were an unknown board."""
        return [
            T for flank in self.flanks for T in unknown_plane_starts(stack_lines(self.T_b_f, flank))
        ]

    def model_at_sensor_pose(self, T_f_s: Array) -> tuple[RoofModel, Array]:
        """The planes through all points."""
        T_b_f, by_laser = self.T_b_f, self.by_laser
        halves = (None, None) if by_laser is None else np.split(by_laser, 2, axis=1)
        left, right = (
            PlaneModel(
                stack_lines(T_b_f, flank),
                plane_through_lines(T_b_f, flank, T_f_s),
                self.noise,
                half,
            )
            for flank, half in zip(self.flanks, halves, strict=True)
        )
        return RoofModel(left, right), np.zeros(6)
