"""A straight laser line in a profile: robust, compressed to offset and angle with their errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets import consensus
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, Mask, array_dataclass
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.profile import Profile

MIN_LINE_SHARE: Final = 0.3
"""At least this share of a profile's points is on the line; else the choice of line is a guess."""
MIN_LINE_LENGTH: Final = 5e-3
"""Metres; a shorter line has no direction to speak of."""
SIDEWAYS_NOISE_SHARE: Final = 0.3
"""Of the range noise, by which points err sideways however steep their line is. An assumption:
lateral errors of such sensors are smaller than range errors, but not zero."""


@array_dataclass
class LineFit:
    """A straight line fitted to a profile in the laser plane, frame s.

    Parameters
    ----------
    point_s : ndarray, shape (3,)
        Centroid of its points, y = 0, in metres. Offset and angle err independently there.
    direction_s : ndarray, shape (3,)
        Unit vector, towards rising x.
    sigma_offset : float
        Standard deviation of the offset square to the line at `point_s`, in metres.
    sigma_angle : float
        Standard deviation of the line's angle in the laser plane, in radians.
    scatter : float
        RMS distance of its points from it, in metres.
    span : float
        Length that its points cover, in metres.
    inlier : ndarray of bool, shape (columns,)
        Which columns of the profile are on the line.
    """

    point_s: Array
    direction_s: Array
    sigma_offset: float
    sigma_angle: float
    scatter: float
    span: float
    inlier: Mask

    def by_laser(self, profile: Profile, laser: LaserDeviation) -> Array:
        """Changes of offset (metres) and angle (radians) in the laser plane, shape (2, m).

        Parameters
        ----------
        profile : Profile
            The profile that the line was fitted to.
        laser : LaserDeviation
            Of m independent draws.
        """
        points = np.column_stack((profile.x_s[self.inlier], profile.z_s[self.inlier]))
        direction = self.direction_s[[0, 2]]
        across = np.array((-direction[1], direction[0])) @ laser.displacements_at(points)
        along = (points - self.point_s[[0, 2]]) @ direction
        return np.stack((across.mean(axis=0), along @ across / (along @ along)))


@array_dataclass
class LineBundle:
    """Lines on a plane, stacked with the flange poses they were taken from.

    Parameters
    ----------
    R_b_f : ndarray, shape (n, 3, 3)
        Orientations of the flange.
    p_b_f : ndarray, shape (n, 3)
        Positions of the flange, in metres.
    points_s, directions_s : ndarray, shape (n, 3)
        A point and the unit direction of each line in frame s, y = 0.
    sigma_offset, sigma_angle : ndarray, shape (n,)
        Range errors of each line, in metres and radians.
    """

    R_b_f: Array
    p_b_f: Array
    points_s: Array
    directions_s: Array
    sigma_offset: Array
    sigma_angle: Array


def stack_lines(T_b_f: Array, fits: Sequence[LineFit]) -> LineBundle:
    """Stack flange poses, shape (n, 4, 4), and the line seen from each into one bundle."""
    return LineBundle(
        T_b_f[:, :3, :3],
        T_b_f[:, :3, 3],
        np.stack([fit.point_s for fit in fits]),
        np.stack([fit.direction_s for fit in fits]),
        np.array([fit.sigma_offset for fit in fits]),
        np.array([fit.sigma_angle for fit in fits]),
    )


def fit_line(profile: Profile, noise: NoiseModel) -> LineFit:
    """Fit the straight line that most points of a profile are on.

    Spatter, the board's edges and other objects in view are left out, as long as the board
    holds more points than any other straight thing.

    Parameters
    ----------
    profile : Profile
        Of a board.
    noise : NoiseModel
        States the range noise of a point.

    Raises
    ------
    CalibrationRefused
        If too few points of the profile are on one line, or the line is too short.
    """
    points = consensus.valid_points(profile)
    if len(points) < consensus.MIN_CURVE_POINTS:
        raise CalibrationRefused(
            "no line seen",
            f"the profile holds {len(points)} points, a line needs {consensus.MIN_CURVE_POINTS}; "
            "bring the board into the sensor's range",
        )
    pairs = points[consensus.sample_index_sets(len(points), 2)]
    inlier = consensus.find_inliers(
        points, lines_through_pairs(pairs), offsets_from_lines, noise.range
    )
    if inlier.any():
        inlier = consensus.refit_and_trim(
            lambda m: offsets_from_fitted_line(points, m), inlier, noise.range
        )
    if inlier.sum() < max(consensus.MIN_CURVE_POINTS, MIN_LINE_SHARE * len(points)):
        raise CalibrationRefused(
            "no line seen",
            f"only {inlier.sum()} of {len(points)} points are on one straight line within "
            f"{1e3 * consensus.OUTLIER_SIGMAS * consensus.MAX_SCATTER_RATIO * noise.range:.2f} mm; "
            "clear the board, or state the range noise that this sensor really has",
        )
    return describe_line(profile, inlier, noise)


def lines_through_pairs(pairs: Array) -> Array:
    """Lines (unit normal, offset) through pairs of points, shape (k, 2, 2); equal ones left out."""
    along = pairs[:, 1] - pairs[:, 0]
    length = np.hypot(along[:, 0], along[:, 1])
    apart = length > 0
    along = along[apart] / length[apart, None]
    normal = np.column_stack((-along[:, 1], along[:, 0]))
    return np.column_stack((normal, np.einsum("ij,ij->i", normal, pairs[apart, 0])))


def offsets_from_lines(points: Array, lines: Array) -> Array:
    """Signed distances of points, shape (n, 2), from lines (normal, offset), shape (k, n)."""
    return np.asarray(lines[:, :2] @ points.T - lines[:, 2:])


def offsets_from_fitted_line(points: Array, inlier: Mask) -> Array:
    """Signed distances of points, shape (n, 2), from the line through those of a mask, metres."""
    centre, direction = _centroid_and_direction(points[inlier])
    return np.asarray((points - centre) @ np.array((-direction[1], direction[0])))


def _centroid_and_direction(points: Array) -> tuple[Array, Array]:
    """Centroid and unit direction of the line with the least square distances."""
    centre = points.mean(axis=0)
    x, z = (points - centre).T
    # The major axis of a 2 x 2 scatter matrix, without an eigenvalue solver.
    angle = 0.5 * np.arctan2(2 * (x @ z), x @ x - z @ z)
    return centre, np.array((np.cos(angle), np.sin(angle)))


def describe_line(profile: Profile, inlier: Mask, noise: NoiseModel) -> LineFit:
    """Describe the line through chosen points of a profile, with its errors.

    Neighbours err alike: n points count as fewer.

    Parameters
    ----------
    profile : Profile
        The profile, of n valid points.
    inlier : ndarray of bool, shape (n,)
        The valid points that are on the line.
    noise : NoiseModel
        States the range noise of a point.

    Raises
    ------
    CalibrationRefused
        If the line is too short to have a direction.
    """
    kept = consensus.valid_points(profile)[inlier]
    centre, direction = _centroid_and_direction(kept)
    along = (kept - centre) @ direction
    across = (kept - centre) @ np.array((-direction[1], direction[0]))
    span = float(np.ptp(along))
    if span < MIN_LINE_LENGTH:
        raise CalibrationRefused(
            "no line seen",
            f"the line is {1e3 * span:.1f} mm long; turn the sensor so that the line crosses "
            f"more of the board, {1e3 * MIN_LINE_LENGTH:.0f} mm at the least",
        )
    scatter = float(np.sqrt(across @ across / (len(kept) - 2)))
    # Range errors act along z; only their part square to the line moves it. A line rougher than
    # stated counts with its own roughness.
    stated = noise.range * max(abs(direction[0]), SIDEWAYS_NOISE_SHARE)
    variance = noise.mean_variance_inflation * max(stated, scatter) ** 2
    return LineFit(
        np.array((centre[0], 0.0, centre[1])),
        np.array((direction[0], 0.0, direction[1])),
        float(np.sqrt(variance / len(kept))),
        float(np.sqrt(variance / (along @ along))),
        scatter,
        span,
        consensus.columns_of_points(profile, inlier),
    )
