"""What is assumed about the errors of a calibration's measurements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import radians
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt

from tjscan.core.frames import Array
from tjscan.core.units import COLUMNS, DEG, MM, SettingsTable


@dataclass(frozen=True, slots=True)
class NoiseModel(SettingsTable):
    """Standard deviations of normally distributed errors.

    **The defaults are assumptions**: a line laser of the 100 mm class on a calibrated arm.

    Parameters
    ----------
    range : float
        Of one point along the sensor's z axis, in metres.
    correlation : float
        Columns after which the correlation of the range errors within one line has fallen to
        1/e, as a Gaussian: speckle is not white. Zero for white noise.
    position : float
        Of the flange's position, in metres, in each axis, common to all points of one line.
    rotation : float
        Of the flange's orientation, in radians, about each axis, common to all points of one
        line.
    touch : float
        Of one touched point, in metres, in each axis, the arm's own error included.
    geometry : float
        Of the flange's position, in metres, in each axis, from the arm's lengths and zeros of
        joints: alike at poses that are alike; see `geometry_error_correlation`. At least so
        much is allowed for; if the residuals show more, that. The default is what a maker's
        own calibration of an arm leaves; zero suits an exact, simulated one.

    Notes
    -----
    The error of the plane, common to all lines, follows from `touch` and from the touched
    points.
    """

    range: Annotated[float, Gt(0), MM] = 30e-6
    correlation: Annotated[float, Ge(0), COLUMNS] = 4.0
    position: Annotated[float, Gt(0), MM] = 50e-6
    rotation: Annotated[float, Gt(0), DEG] = radians(0.01)
    touch: Annotated[float, Gt(0), MM] = 50e-6
    geometry: Annotated[float, Ge(0), MM] = 300e-6

    def __post_init__(self) -> None:
        sigmas = np.array((self.range, self.position, self.rotation, self.touch))
        others = np.array((self.geometry, self.correlation))
        if not (np.isfinite((*sigmas, *others)).all() and sigmas.min() > 0 <= others.min()):
            raise ValueError(
                "every standard deviation must be finite and positive: a measurement without error "
                "has infinite weight; the arm's geometry error and the correlation, a number of "
                "columns, must be finite, zero or more"
            )

    @property
    def mean_variance_inflation(self) -> float:
        """By how much the variance of a line's mean exceeds that with white range noise."""
        if self.correlation == 0:
            return 1.0
        lags = np.arange(1, int(np.ceil(4 * self.correlation)) + 1)
        return float(1 + 2 * np.exp(-((lags / self.correlation) ** 2)).sum())


TYPICAL_FLANGE_LEVER: Final = 0.7
"""Metres from a joint to the flange, typically: the flange moves by this times the change of a
joint's angle, and an error of its position over this is the error of its orientation."""

FlangeMoves = Callable[[Array], Array]
"""From joint angles, shape (joints,), to how the flange moves with m independent standard normal
draws of the arm's geometry, shape (6, m): see `ArmGeometryDeviation.flange_motion`."""


def geometry_error_correlation(T_b_f: Array) -> Array:
    """Correlation of the geometry error of an unknown arm, shape (n, n).

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.

    Notes
    -----
    Errors of lengths, twists and zeros of joints move the flange by sums of sines and cosines of
    the joints' angles. With random amplitudes a sin q + b cos q correlates over a
    change of q as its cosine, near ``exp(-q² / 2)``: over one radian, or `TYPICAL_FLANGE_LEVER`
    metres.
    """
    p = T_b_f[:, :3, 3]
    metres = np.linalg.norm(p[:, None] - p, axis=2)
    R = T_b_f[:, :3, :3]
    # |R_i - R_j|² = 8 sin²(angle / 2), also where the angle is tiny.
    chord = np.linalg.norm(R[:, None] - R, axis=(2, 3))
    radians = 2 * np.arcsin(np.minimum(chord / np.sqrt(8), 1.0))
    return np.asarray(np.exp(-0.5 * ((metres / TYPICAL_FLANGE_LEVER) ** 2 + radians**2)))


def geometry_error_covariance(by_arm: Array, correlation: Array) -> Array:
    """Covariance that a geometry error of one metre (position, each axis) gives residuals.

    Parameters
    ----------
    by_arm : ndarray, shape (N, 6)
        Derivative of each residual by an error of its flange pose, in the axes of b.
    correlation : ndarray, shape (N, N)
        Of the error between the poses of the residuals.
    """
    scaled = by_arm / np.repeat((1.0, TYPICAL_FLANGE_LEVER), 3)
    return np.asarray(correlation * (scaled @ scaled.T))
