"""What a line laser's own calibration leaves: scale, tilt and lens errors, within its linearity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.polynomial.legendre import legval2d

from tjscan.core.frames import Array, frozen_arrays
from tjscan.laser.model import LaserModel

DEGREE: Final = 3
"""Of the polynomials in x and z: a lens' distortion is of third order."""

RANDOM_STREAM: Final = 4
"""Keeps the random numbers of a sensor's make apart from those of its profiles."""

SAMPLES: Final = 41
"""Places across the window, each way, at which the largest error is looked for."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
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
    def draw(cls, model: LaserModel, make: int) -> Self | None:
        """Draw a sensor of a kind, or none where the model states it has no such error.

        Parameters
        ----------
        model : LaserModel
            Its window, and its `linearity`: how large the error gets somewhere in the window.
        make : int
            Seed that decides which one.
        """
        if model.linearity == 0:
            return None
        rng = np.random.default_rng([make, RANDOM_STREAM])
        i = np.arange(DEGREE + 1)
        degree = i[:, None] + i
        weight = np.where((degree > 0) & (degree <= DEGREE), 1.0 / np.maximum(degree, 1), 0.0)
        width = (model.far - model.emitter_z) * np.tan(model.half_angle)
        field = cls(
            weight * rng.standard_normal((2, DEGREE + 1, DEGREE + 1)),
            np.array((0.0, 0.5 * (model.near + model.far))),
            np.array((width, 0.5 * (model.far - model.near))),
        )
        largest = np.abs(field._errors(*_window(model))).max()
        return cls(model.linearity / largest * field.coefficients, field.middle, field.half)

    def distort(self, x_s: Array, z_s: Array) -> tuple[Array, Array]:
        """Give points as the sensor reports them, for where they are; shape (n,), metres."""
        dx, dz = self._errors(x_s, z_s)
        return x_s + dx, z_s + dz

    def _errors(self, x_s: Array, z_s: Array) -> Array:
        u, v = (x_s - self.middle[0]) / self.half[0], (z_s - self.middle[1]) / self.half[1]
        return np.array([legval2d(u, v, c) for c in self.coefficients])


def _window(model: LaserModel) -> tuple[Array, Array]:
    z = np.linspace(model.near, model.far, SAMPLES)
    x = np.linspace(-1, 1, SAMPLES)[:, None] * (z - model.emitter_z) * np.tan(model.half_angle)
    return x.ravel(), np.broadcast_to(z, x.shape).ravel()
