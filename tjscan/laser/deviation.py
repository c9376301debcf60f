"""What is known of a laser's systematic deviation before anything is measured: its size alone."""

from __future__ import annotations

from dataclasses import dataclass
from math import tan
from typing import Final, Self

import numpy as np
from numpy.polynomial.legendre import legvander

from tjscan.core.frames import Array, frozen_arrays

DEGREE: Final = 3
DEGREES: Final = tuple(
    (i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1) if 0 < i + j <= DEGREE
)
"""Degrees in x and z of the polynomials that a laser's deviation is made of."""

BY_DEGREE: Final = (0.34, 0.19, 0.13)
"""Standard deviations of the coefficients of first, second and third degree, of lasers whose
largest deviation in the window is one (`tests/uncertainty/test_causes.py`)."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class LaserDeviation:
    """Smooth deviation of x and z over the laser's window: scale, tilt and what its lens bends.

    Products of Legendre polynomials of x and z up to the third degree, a lens' own, every one as
    likely as others of its degree and higher degrees as much less likely. (Assumption.) A laser
    deviates by as much as its data sheet says somewhere in its window: coefficients are as large
    as they are among such lasers.

    Parameters
    ----------
    largest : float
        Largest deviation in the window, metres: the linearity of a data sheet.
    middle, half : ndarray, shape (2,)
        Middle of the window in x and z of frame s, and half its sizes there, metres.
    """

    largest: float
    middle: Array
    half: Array

    @classmethod
    def in_window(
        cls, largest: float, *, near: float, far: float, apex_z: float, half_angle: float
    ) -> Self:
        """The deviation of a laser that measures in a trapezoid.

        Parameters
        ----------
        largest : float
            Metres.
        near, far, apex_z : float
            Where the window begins and ends, and where its sides meet: z in frame s, metres.
        half_angle : float
            Between the central ray and a side, radians.
        """
        half = ((far - apex_z) * tan(half_angle), 0.5 * (far - near))
        return cls(largest, np.array((0.0, 0.5 * (near + far))), np.array(half))

    def at(self, xz: Array) -> Array:
        """Displacement of points by each of m independent standard normal draws.

        Parameters
        ----------
        xz : ndarray, shape (n, 2)
            The points in x and z of frame s, metres.

        Returns
        -------
        ndarray, shape (n, 2, m)
            Metres.
        """
        by_x, by_z = np.moveaxis(legvander((xz - self.middle) / self.half, DEGREE), 1, 0)
        each = [BY_DEGREE[i + j - 1] * by_x[:, i] * by_z[:, j] for i, j in DEGREES]
        terms = self.largest * np.stack(each, axis=1)
        none = np.zeros_like(terms)
        return np.stack((np.hstack((terms, none)), np.hstack((none, terms))), axis=1)
