"""The arm's geometry error: alike at poses that are alike, so no average over these removes it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from tjscan.core.frames import Array

ARM_REACH: Final = 0.7
"""Metres from a joint to the flange, typically: the flange moves by this times the change of a
joint's angle, and an error of its position over this is the error of its orientation."""

FlangeMoves = Callable[[Array], Array]
"""From joint angles, shape (joints,), to how the flange moves with m independent standard normal
draws of the arm's geometry, shape (6, m): see `ArmGeometry.moves`."""


def geometry_correlation(T_b_f: Array) -> Array:
    """Correlation of the geometry error of an arm of which nothing is known, shape (n, n).

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.

    Notes
    -----
    Errors of lengths, twists and zeros of joints move the flange by sums of sines and cosines of
    the joints' angles. With random amplitudes a sin q + b cos q correlates over a
    change of q as its cosine, near ``exp(-q² / 2)``: over one radian, or `ARM_REACH` metres.
    """
    p = T_b_f[:, :3, 3]
    metres = np.linalg.norm(p[:, None] - p, axis=2)
    R = T_b_f[:, :3, :3]
    # |R_i - R_j|² = 8 sin²(angle / 2), also where the angle is tiny.
    chord = np.linalg.norm(R[:, None] - R, axis=(2, 3))
    radians = 2 * np.arcsin(np.minimum(chord / np.sqrt(8), 1.0))
    return np.asarray(np.exp(-0.5 * ((metres / ARM_REACH) ** 2 + radians**2)))


def geometry_covariance(by_arm: Array, correlation: Array) -> Array:
    """Covariance that a geometry error of one metre (position, each axis) gives residuals.

    Parameters
    ----------
    by_arm : ndarray, shape (N, 6)
        Derivative of each residual by an error of its flange pose, in the axes of b.
    correlation : ndarray, shape (N, N)
        Of the error between the poses of the residuals.
    """
    scaled = by_arm / np.repeat((1.0, ARM_REACH), 3)
    return np.asarray(correlation * (scaled @ scaled.T))
