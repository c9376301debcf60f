"""A calibration board whose plane was touched with the arm's probe tip, or is stated."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc

from tjscan.calibration.noise import ARM_REACH
from tjscan.calibration.plucker import PluckerPlane, plane_through_point
from tjscan.calibration.targets.plane import PlaneTarget
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array

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
        other err alike; see `tjscan.calibration.noise`.
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
