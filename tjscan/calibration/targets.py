"""Calibration targets: a plane, touched or unknown, or a sphere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc

from tjscan.calibration.arm_error import ARM_REACH
from tjscan.calibration.plucker import PluckerPlane, plane_through_point
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, frozen_arrays, unit_vector

MIN_TOUCHES: Final = 3
MIN_TOUCH_PATTERN_RATIO: Final = 0.1
"""Touched points whose pattern is narrower than this share of its length count as collinear."""
MAX_NORMAL_SIGMA: Final = float(np.radians(0.2))
"""Radians; a touched plane whose normal is less certain would spoil any calibration."""
MIN_TOUCH_PROBABILITY: Final = 1e-4
"""Touches less probable than this under the stated noise are refused."""


NOT_FLAT: Final = "touched points not on one plane"
"""The reason for which to touch again; none of the other reasons goes away by that."""
STATED_BOARD_SIZE: Final = 0.2
"""Metres; see `plane_stated_beforehand`."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class PlaneTarget:
    """A flat calibration board in frame b, with what is known about where it is.

    A nearby plane is written as (tilt, tilt, height): its normal is ``u + tilts @ axes_b``,
    scaled to length one, and `centre_b` lies at the signed distance `height` from it.

    Parameters
    ----------
    plane : PluckerPlane
        The board, frame b.
    centre_b : ndarray, shape (3,)
        The point on it that heights count from, in metres.
    axes_b : ndarray, shape (2, 3)
        Two unit vectors in the plane, the long side of the touched pattern first.
    information : ndarray, shape (3, 3)
        Inverse covariance of (tilt, tilt, height), radians and metres; zero where nothing is
        known.
    residuals : ndarray, shape (n,)
        Distances of the touched points from the plane, in metres; empty where none was touched.
    singular_values : ndarray, shape (3,)
        Of the touched points about their centroid, in metres: length, width and thickness of
        the pattern, times the root of the number of points.
    by_arm : ndarray, shape (3, m), or None
        How (tilt, tilt, height) move with draws of the arm's geometry, see `ArmGeometry.moves`;
        `information` is then that of the touches alone. None where it holds both.
    """

    plane: PluckerPlane
    centre_b: Array
    axes_b: Array
    information: Array
    residuals: Array
    singular_values: Array
    by_arm: Array | None = None

    @classmethod
    def unknown_plane(cls, plane: PluckerPlane, near_b: ArrayLike) -> Self:
        """Make a target whose plane is unknown beforehand, from a starting value.

        Parameters
        ----------
        plane : PluckerPlane
            A start for it, frame b.
        near_b : array_like, shape (3,)
            Heights count from the point of the plane next to this one; metres.
        """
        near = np.asarray(near_b, dtype=float)
        foot = near - float(plane.signed_distances(near)) * plane.u
        axes = np.linalg.svd(plane.u[None])[2][1:]
        return cls(plane, foot, axes, np.zeros((3, 3)), np.zeros(0), np.zeros(3))

    @property
    def was_touched(self) -> bool:
        """Whether the board's place is known, from touches or as stated."""
        return bool(self.information.any())

    def boxplus(self, by: Array) -> PluckerPlane:
        """Plane a step (tilt, tilt, height), shape (3,), away from this one."""
        u = unit_vector(self.plane.u + by[:2] @ self.axes_b)
        return plane_through_point(self.centre_b - by[2] * u, u)


def fit_plane(
    points_b: ArrayLike,
    sigma: float,
    side_b: ArrayLike | None = None,
    *,
    geometry: float = 0.0,
    by_arm: Array | None = None,
) -> PlaneTarget:
    """Fit the plane through points touched with the arm's probe tip.

    Parameters
    ----------
    points_b : array_like, shape (n, 3)
        Where the tip touched, frame b, in metres; n ≥ 3.
    sigma : float
        Standard deviation of a touched point in each axis, in metres.
    side_b : array_like, shape (3,), optional
        A point on the side of the plane that its normal shall point to, such as the flange.
    geometry : float
        Standard deviation of the arm's geometry error, metres: points that are touched near each
        other err alike; see `tjscan.calibration.arm_error`.
    by_arm : ndarray, shape (n, 3, m), optional
        How the tip moves with draws of the arm's geometry, for an error of one metre, where the
        arm's postures are known; see `ArmGeometry.moves`.

    Raises
    ------
    CalibrationRefused
        If the points are too few, collinear or too close together to fix a plane, or do not
        lie on one within the stated noise.
    """
    points = np.asarray(points_b, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ValueError(f"touched points are finite and of shape (n, 3), not {points.shape}")
    if len(points) < MIN_TOUCHES:
        raise CalibrationRefused(
            "too few touched points", f"{len(points)} were touched, a plane needs three or more"
        )
    centre = points.mean(axis=0)
    _, singular, axes = np.linalg.svd(points - centre, full_matrices=len(points) < 4)
    u = axes[2]
    if side_b is not None and u @ (np.asarray(side_b, dtype=float) - centre) < 0:
        u = -u
    residuals = (points - centre) @ u
    _check_pattern(singular, sigma)
    across = np.column_stack(((points - centre) @ axes[:2].T, np.ones(len(points))))
    own, gain = sigma**2 * np.eye(len(points)), np.linalg.pinv(across)
    if by_arm is None:
        metres = np.linalg.norm(points[:, None] - points, axis=2)
        covariance = own + geometry**2 * np.exp(-0.5 * (metres / ARM_REACH) ** 2)
        information, moves = np.linalg.inv(gain @ covariance @ gain.T), None
    else:
        off = np.einsum("i,nim->nm", u, by_arm)
        covariance = own + geometry**2 * (off @ off.T)
        information, moves = np.linalg.inv(gain @ own @ gain.T), -gain @ off
    _check_flatness(residuals, across, covariance, sigma)
    plane = plane_through_point(centre, u)
    return PlaneTarget(plane, centre, axes[:2], information, residuals, singular, moves)


def plane_stated_beforehand(
    plane: PluckerPlane, flange_b: ArrayLike, sigma: float, *, geometry: float = 0.0
) -> PlaneTarget:
    """Plane target that the user states, as sure as one touched at the corners of a square.

    Parameters
    ----------
    plane : PluckerPlane
        The board, frame b; its normal may point either way.
    flange_b : array_like, shape (3,)
        About where the flange was: on the side that lines are seen from.
    sigma : float
        Standard deviation of each touched corner of a square with side `STATED_BOARD_SIZE`, in
        metres.
    geometry : float
        Standard deviation of the arm's geometry error, metres.
    """
    flange = np.asarray(flange_b, dtype=float)
    bare = PlaneTarget.unknown_plane(plane, flange)
    corners = STATED_BOARD_SIZE / 2 * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
    return fit_plane(bare.centre_b + corners @ bare.axes_b, sigma, flange, geometry=geometry)


def _check_pattern(singular: Array, sigma: float) -> None:
    tilt = sigma / max(singular[1], 1e-12)
    if singular[1] > MIN_TOUCH_PATTERN_RATIO * singular[0] and tilt < MAX_NORMAL_SIGMA:
        return
    shown = ", ".join(f"{1e3 * s:.2f}" for s in singular)
    raise CalibrationRefused(
        "touched points nearly on one line",
        f"their singular values are {shown} mm and leave the plane's normal uncertain by "
        f"{min(np.degrees(tilt), 90):.2f}°; touch points that span a wide triangle or rectangle",
    )


def _check_flatness(residuals: Array, across: Array, covariance: Array, sigma: float) -> None:
    dof = len(residuals) - 3
    if dof == 0:
        return
    # What no plane explains, in as many axes as there are degrees of freedom.
    rest = np.linalg.svd(across)[0][:, 3:]
    left = residuals @ rest
    if (
        chdtrc(dof, left @ np.linalg.solve(rest.T @ covariance @ rest, left))
        > MIN_TOUCH_PROBABILITY
    ):
        return
    shown = ", ".join(f"{1e3 * r:+.3f}" for r in residuals)
    worst = int(np.argmax(np.abs(residuals))) + 1
    raise CalibrationRefused(
        NOT_FLAT,
        f"their distances from the best plane are {shown} mm, more than {1e3 * sigma:.3f} mm of "
        f"noise explain; touch number {worst} again first, then check that the board is flat",
    )


@dataclass(frozen=True, slots=True)
class SphereTarget:
    """A ball as calibration target: it stays where it is, somewhere in frame b.

    Parameters
    ----------
    radius : float, optional
        Metres, where it is stated.
    tolerance : float
        Standard deviation of a stated radius, metres. The default is an assumption: that of a
        ball from a bearing, painted matt.
    """

    radius: float | None = None
    tolerance: float = 10e-6

    def __post_init__(self) -> None:
        if self.radius is not None and not 0 < self.radius < np.inf:
            raise ValueError("a sphere's radius is positive and finite")
        if not 0 < self.tolerance < np.inf:
            raise ValueError("a radius has a tolerance, positive and finite")


@dataclass(frozen=True, slots=True)
class UnknownRoof:
    """A roof edge that stays where it is, somewhere in frame b."""


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
    def edge_b(self) -> tuple[Array, Array]:
        """The point of the edge next to the left plane's centre, metres, and its unit direction."""
        normals = np.stack((self.left.plane.u, self.right.plane.u))
        direction = unit_vector(np.cross(*normals))
        heights = np.array((self.left.plane.u0, self.right.plane.u0))
        near = self.left.centre_b
        return near - np.linalg.pinv(normals) @ (normals @ near + heights), direction

    @property
    def angle(self) -> float:
        """Between the planes on the sensor's side, radians."""
        return float(np.pi - np.arccos(np.clip(self.left.plane.u @ self.right.plane.u, -1, 1)))
