"""The laser line on a flat board: robust, compressed to offset and angle with their errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.calibration.fits.consensus import (
    MAX_SCATTER_RATIO,
    OUTLIER_SIGMAS,
    SCORED_POINTS,
    InlierMask,
    best_hypothesis,
    evenly_spaced_indices,
    refit_and_trim,
    sample_index_sets,
)
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.plucker import PluckerLine, line_through_point
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, frozen_arrays
from tjscan.laser.profile import Profile

MIN_POINTS: Final = 20
"""A line has at least so many points."""
MIN_INLIER_SHARE: Final = 0.3
"""At least this share of a profile's points lies on the line; else what the line is, is a guess."""
MIN_LINE_LENGTH: Final = 5e-3
"""Metres; a shorter line has no direction to speak of."""
SIDEWAYS_NOISE_SHARE: Final = 0.3
"""However steep a line is in the sensor, its points err sideways by this share of the range noise.

An assumption: lateral errors of such sensors are smaller than range errors, but not zero.
"""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
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
        Which columns of the profile lie on the line.
    """

    point_s: Array
    direction_s: Array
    sigma_offset: float
    sigma_angle: float
    scatter: float
    span: float
    inlier: NDArray[np.bool_]

    @property
    def point_count(self) -> int:
        """Number of points on the line."""
        return int(self.inlier.sum())

    @property
    def plucker_line_s(self) -> PluckerLine:
        """The line in Plücker coordinates, frame s: what eq. (18) starts from."""
        return line_through_point(self.point_s, self.direction_s)


def fit_line(profile: Profile, noise: NoiseModel) -> LineFit:
    """Fit the straight line that most points of a profile lie on.

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
        If too few points of the profile lie on one line, or the line is too short.
    """
    valid = profile.valid
    points = np.column_stack((profile.x_s[valid], profile.z_s[valid]))
    if len(points) < MIN_POINTS:
        raise CalibrationRefused(
            "no line seen",
            f"the profile holds {len(points)} points, a line needs {MIN_POINTS}; bring the board "
            "into the sensor's range",
        )
    inlier = refit_and_trim(
        lambda m: distances_from_line(points, m), _start(points, noise.range), noise.range
    )
    if inlier.sum() < max(MIN_POINTS, MIN_INLIER_SHARE * len(points)):
        raise CalibrationRefused(
            "no line seen",
            f"only {inlier.sum()} of {len(points)} points lie on one straight line within "
            f"{1e3 * OUTLIER_SIGMAS * MAX_SCATTER_RATIO * noise.range:.2f} mm; "
            "clear the board, or state the range "
            "noise that this sensor really has",
        )
    return describe_line(points, inlier, valid, noise)


def _start(points: Array, sigma: float) -> InlierMask:
    """Points close to the line through two of them that most of them are close to."""
    tolerance = 2 * OUTLIER_SIGMAS * sigma
    pair = sample_index_sets(len(points), 2)
    along = points[pair[:, 1]] - points[pair[:, 0]]
    length = np.hypot(along[:, 0], along[:, 1])
    length[length == 0] = np.inf
    normal = np.column_stack((-along[:, 1], along[:, 0])) / length[:, None]
    offset = np.einsum("ij,ij->i", normal, points[pair[:, 0]])
    few = points[evenly_spaced_indices(len(points), SCORED_POINTS)]
    # A pair of coinciding points has no normal; it must not look like a perfect fit.
    distances = normal @ few.T - offset[:, None] + np.where(np.isinf(length), np.inf, 0.0)[:, None]
    k = best_hypothesis(distances, tolerance)
    return np.asarray(np.abs(points @ normal[k] - offset[k]) < tolerance)


def _axes(points: Array) -> tuple[Array, Array]:
    """Centroid and unit direction of the line with the least square distances."""
    centre = points.mean(axis=0)
    x, z = (points - centre).T
    # The major axis of a 2 x 2 scatter matrix, without an eigenvalue solver.
    angle = 0.5 * np.arctan2(2 * (x @ z), x @ x - z @ z)
    return centre, np.array((np.cos(angle), np.sin(angle)))


def distances_from_line(points: Array, inlier: InlierMask) -> Array:
    """Signed distances of points, shape (n, 2), from the line through those of a mask, metres."""
    centre, direction = _axes(points[inlier])
    return np.asarray((points - centre) @ np.array((-direction[1], direction[0])))


def describe_line(
    points: Array, inlier: InlierMask, valid: InlierMask, noise: NoiseModel
) -> LineFit:
    """Describe the line through chosen points of a profile, with its errors.

    Neighbours err alike: n points count as fewer.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        The valid points of the profile, x and z in frame s, metres.
    inlier : ndarray of bool, shape (n,)
        Those of them that lie on the line.
    valid : ndarray of bool, shape (columns,)
        Which columns of the profile hold a point.
    noise : NoiseModel
        States the range noise of a point.

    Raises
    ------
    CalibrationRefused
        If the line is too short to have a direction.
    """
    kept = points[inlier]
    centre, direction = _axes(kept)
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
    columns = np.zeros(len(valid), dtype=bool)
    columns[np.flatnonzero(valid)[inlier]] = True
    return LineFit(
        np.array((centre[0], 0.0, centre[1])),
        np.array((direction[0], 0.0, direction[1])),
        float(np.sqrt(variance / len(kept))),
        float(np.sqrt(variance / (along @ along))),
        scatter,
        span,
        columns,
    )
