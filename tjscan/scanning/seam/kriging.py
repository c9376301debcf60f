"""What varies along the groove in no known way: smooth random functions of its length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from tjscan.core.frames import Array


def matern(between: Array, amplitude: float, length: float) -> Array:
    """Covariance of a function with two derivatives at places this far apart.

    Parameters
    ----------
    between : ndarray
        Distances along the groove, metres.
    amplitude : float
        Standard deviation of the function.
    length : float
        Over which it varies, metres.

    Notes
    -----
    Matérn's of order 5/2. Rasmussen, Williams (2006): Gaussian Processes for Machine Learning,
    eq. (4.17).
    """
    r = np.sqrt(5) * np.abs(between) / length
    return np.asarray(amplitude**2 * (1 + r + r * r / 3) * np.exp(-r))


@dataclass(frozen=True, slots=True, eq=False)
class Kriging:
    """A smooth random function about an unknown mean, measured at some places.

    Parameters
    ----------
    along, values, sigmas : ndarray, shape (n,)
        Where it was measured (metres), what was, and how well.
    amplitude, length : float
        Of `matern`.

    Notes
    -----
    Ordinary kriging. Cressie (1993): Statistics for Spatial Data, section 3.2.
    """

    along: Array
    values: Array
    sigmas: Array
    amplitude: float
    length: float

    def at(self, places: Array) -> tuple[Array, Array]:
        """Values at places, shape (m,), and their standard deviations."""
        return self._weigh(self._towards(places), 1.0, np.full(len(places), self.amplitude**2))

    def change(self, places: Array, start: float) -> tuple[Array, Array]:
        """How much it changes from a place to others, shape (m,), with standard deviations."""
        towards = self._towards(places) - self._towards(np.array([start]))
        between = matern(places - start, self.amplitude, self.length)
        return self._weigh(towards, 0.0, 2 * (self.amplitude**2 - between))

    def _towards(self, places: Array) -> Array:
        return matern(self.along[:, None] - places, self.amplitude, self.length)

    def _weigh(self, towards: Array, share: float, prior: Array) -> tuple[Array, Array]:
        """Value and deviation of what covaries so, shape (n, m), with `share` of the mean."""
        spread = matern(self.along[:, None] - self.along, self.amplitude, self.length)
        spread[np.diag_indices_from(spread)] += self.sigmas**2
        ones = np.ones(len(self.along))
        solved = cho_solve(cho_factor(spread), np.column_stack((ones, self.values, towards)))
        doubt = 1 / float(ones @ solved[:, 0])
        mean = doubt * float(ones @ solved[:, 1])
        values = share * mean + towards.T @ (solved[:, 1] - mean * solved[:, 0])
        slack = share - ones @ solved[:, 2:]
        variances = prior - np.sum(towards * solved[:, 2:], axis=0) + slack**2 * doubt
        return np.asarray(values), np.sqrt(np.maximum(variances, 0.0))
