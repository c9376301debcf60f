"""How what is read from a profile answers to the laser's own deviation, alike in all of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tjscan.calibration.fits.circle import CircleFit
from tjscan.calibration.fits.line import LineFit
from tjscan.calibration.fits.roof import RoofFit
from tjscan.core.frames import Array
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.profile import Profile


def line_by_laser(fit: LineFit, profile: Profile, laser: LaserDeviation) -> Array:
    """Changes of a line's offset (metres) and angle (radians) in the laser plane, shape (2, m).

    Parameters
    ----------
    fit : LineFit
        The line.
    profile : Profile
        That it was fitted to.
    laser : LaserDeviation
        Of m independent draws.
    """
    points = _points(profile, fit.inlier)
    direction = fit.direction_s[[0, 2]]
    across = np.array((-direction[1], direction[0])) @ laser.at(points)
    along = (points - fit.point_s[[0, 2]]) @ direction
    return np.stack((across.mean(axis=0), along @ across / (along @ along)))


def circle_by_laser(fit: CircleFit, profile: Profile, laser: LaserDeviation) -> Array:
    """Changes of a circle's centre x, centre z and radius, metres, shape (3, m).

    Parameters
    ----------
    fit : CircleFit
        The circle.
    profile, laser
        As of `line_by_laser`.
    """
    points = _points(profile, fit.inlier)
    away = points - fit.centre_s[[0, 2]]
    away /= np.hypot(*away.T)[:, None]
    outward = np.einsum("na,nam->nm", away, laser.at(points))
    J = np.column_stack((away, np.ones(len(away))))
    return np.asarray(np.linalg.lstsq(J, outward, rcond=None)[0])


def roof_by_laser(fit: RoofFit, profile: Profile, laser: LaserDeviation) -> Array:
    """Changes of both lines of a roof, the left one's first, shape (4, m); see `line_by_laser`."""
    return np.concatenate([line_by_laser(one, profile, laser) for one in (fit.left, fit.right)])


def estimate_by_laser(covariance: Array, jacobian: Array, errors: Array, by_laser: Array) -> Array:
    """By how much least-squares estimates are off with draws of the laser's deviation.

    Parameters
    ----------
    covariance : ndarray, shape (p, p)
        Of the estimates.
    jacobian : ndarray, shape (N, p)
        Derivative of the residuals that they rest on.
    errors : ndarray, shape (N, N)
        Covariance of these residuals.
    by_laser : ndarray, shape (N, m)
        Their derivative by the draws.

    Returns
    -------
    ndarray, shape (p, m)
    """
    return np.asarray(-covariance @ jacobian.T @ np.linalg.solve(errors, by_laser))


def _points(profile: Profile, inlier: NDArray[np.bool_]) -> Array:
    return np.column_stack((profile.x_s[inlier], profile.z_s[inlier]))
