"""Smooth errors of a line laser over its window: scale, tilt and what its lens bends."""

from __future__ import annotations

from itertools import product
from math import tan
from typing import Final, Self

import numpy as np
from numpy.polynomial.legendre import legval2d, legvander

from tjscan.core.frames import Array, array_dataclass
from tjscan.laser.model import LaserModel, MeasuringRange

LENS_MAX_DEGREE: Final = 3
"""Of the polynomials in x and z: a lens' distortion is of third order."""

DISTORTION_TERM_DEGREES: Final = tuple(
    (i, j) for i, j in product(range(LENS_MAX_DEGREE + 1), repeat=2) if 0 < i + j <= LENS_MAX_DEGREE
)
"""Degrees in x and z of the polynomials that a laser's deviation is made of."""

DISTORTION_SIGMAS_BY_DEGREE: Final = (0.34, 0.19, 0.13)
"""Standard deviations of the coefficients of first, second and third degree, of lasers whose
largest deviation in the window is one (`tests/uncertainty/test_causes.py`)."""


@array_dataclass
class LaserDeviation:
    """Smooth deviation of x and z over the laser's window: scale, tilt and what its lens bends.

    Products of Legendre polynomials of x and z up to the third degree, a lens' own, every one as
    likely as others of its degree and higher degrees as much less likely. (Assumption.) A laser
    deviates by the linearity of its data sheet somewhere in its window: coefficients are as large
    as among such lasers.

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
    def for_window(cls, largest: float, window: MeasuringRange) -> Self:
        """The deviation of a laser that measures in a window.

        Parameters
        ----------
        largest : float
            Metres.
        window : MeasuringRange
            Its measuring range.
        """
        near, far = window.near, window.far
        half = ((far - window.apex_z) * tan(window.half_angle), 0.5 * (far - near))
        return cls(largest, np.array((0.0, 0.5 * (near + far))), np.array(half))

    def displacements_at(self, xz: Array) -> Array:
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
        by_x, by_z = np.moveaxis(legvander((xz - self.middle) / self.half, LENS_MAX_DEGREE), 1, 0)
        each = [
            DISTORTION_SIGMAS_BY_DEGREE[i + j - 1] * by_x[:, i] * by_z[:, j]
            for i, j in DISTORTION_TERM_DEGREES
        ]
        terms = self.largest * np.stack(each, axis=1)
        none = np.zeros_like(terms)
        return np.stack((np.hstack((terms, none)), np.hstack((none, terms))), axis=1)


DISTORTION_RANDOM_STREAM: Final = 4
"""Keeps the random numbers of a sensor's make apart from the numbers of its profiles."""

DISTORTION_PLACES_EACH_WAY: Final = 41
"""Places across the window, each way, at which the largest error is looked for."""


@array_dataclass
class Distortion:
    """Systematic error of a sensor's points over its window, the same in every profile.

    Degree 1 is scale and tilt, degrees 2 and 3 are what the lens bends. (Assumption: a smooth
    field with every term as likely as any other of its degree; higher ones fall as 1/degree.)

    Parameters
    ----------
    coefficients : ndarray, shape (2, 4, 4)
        Of the errors of x and z, in metres, by products of Legendre polynomials.
    middle, half : ndarray, shape (2,)
        Middle of the window and half its sizes along x and z, in metres.
    """

    coefficients: Array
    middle: Array
    half: Array

    @classmethod
    def draw_in_window(cls, model: LaserModel, make: int) -> Self | None:
        """Draw a sensor of a kind, or none if the model has no such error.

        Parameters
        ----------
        model : LaserModel
            Its window, and its `linearity`: how large the error gets somewhere in the window.
        make : int
            Seed that decides which one.
        """
        if model.linearity == 0:
            return None
        rng = np.random.default_rng([make, DISTORTION_RANDOM_STREAM])
        i = np.arange(LENS_MAX_DEGREE + 1)
        degree = i[:, None] + i
        is_term = (degree > 0) & (degree <= LENS_MAX_DEGREE)
        weight = np.where(is_term, 1.0 / np.maximum(degree, 1), 0.0)
        width = (model.far - model.emitter_z) * np.tan(model.half_angle)
        field = cls(
            weight * rng.standard_normal((2, LENS_MAX_DEGREE + 1, LENS_MAX_DEGREE + 1)),
            np.array((0.0, 0.5 * (model.near + model.far))),
            np.array((width, 0.5 * (model.far - model.near))),
        )
        z = np.linspace(model.near, model.far, DISTORTION_PLACES_EACH_WAY)
        slopes = np.linspace(-1, 1, DISTORTION_PLACES_EACH_WAY)[:, None]
        x = slopes * (z - model.emitter_z) * np.tan(model.half_angle)
        errors = field._distortion_errors(x.ravel(), np.broadcast_to(z, x.shape).ravel())
        largest = np.abs(errors).max()
        return cls(model.linearity / largest * field.coefficients, field.middle, field.half)

    def distort(self, x_s: Array, z_s: Array) -> tuple[Array, Array]:
        """Give points as the sensor reports them, for where they are; shape (n,), metres."""
        dx, dz = self._distortion_errors(x_s, z_s)
        return x_s + dx, z_s + dz

    def _distortion_errors(self, x_s: Array, z_s: Array) -> Array:
        u, v = (x_s - self.middle[0]) / self.half[0], (z_s - self.middle[1]) / self.half[1]
        return np.array([legval2d(u, v, c) for c in self.coefficients])
