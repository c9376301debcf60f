"""Gaussian processes of one variable: values between and beyond places that were measured.

Symbols are from [1]_: training inputs x and targets y, noise sigma_n, kernel k with signal
deviation sigma_f and length scale l, test inputs x_star; k_star holds the covariances between
both, and ``alpha = (K + sigma_n² I)^-1 (y - mean)``.

References
----------
.. [1] Rasmussen, Williams (2006): Gaussian Processes for Machine Learning.
.. [2] Cressie (1993): Statistics for Spatial Data, revised edition.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
import scipy  # its parts are loaded at first use

from tjscan.core.frames import Array, array_dataclass


class Kernel(Protocol):
    """Covariance of a stationary process."""

    @property
    def sigma_f(self) -> float:
        """Standard deviation of the process."""

    def __call__(self, difference: Array) -> Array:
        """Covariances of values at inputs that differ by so much, of any shape."""


@dataclass(frozen=True, slots=True)
class Matern52:
    """Matérn's kernel of order 5/2: a process with two derivatives ([1]_ eq. 4.17).

    Parameters
    ----------
    sigma_f : float
        Standard deviation of the process.
    length : float
        Over which it varies, in the unit of the inputs.
    """

    sigma_f: float
    length: float

    def __call__(self, difference: Array) -> Array:
        """Covariances of values at inputs that differ by so much, of any shape."""
        r = np.sqrt(5) * np.abs(difference) / self.length
        return np.asarray(self.sigma_f**2 * (1 + r + r * r / 3) * np.exp(-r))


@dataclass(frozen=True, slots=True)
class PeriodicKernel:
    """A smooth process over an angle that closes after a turn ([1]_ eq. 4.31).

    Parameters
    ----------
    sigma_f : float
        Standard deviation of the process about its mean.
    length : float
        Over which it varies, radians.
    """

    sigma_f: float
    length: float

    def __call__(self, difference: Array) -> Array:
        """Covariances of values at angles that differ by so much, of any shape."""
        return np.asarray(self.sigma_f**2 * np.exp((np.cos(difference) - 1) / self.length**2))

    def derivative(self, difference: Array) -> Array:
        """Derivative of the covariances by the difference, per radian."""
        return np.asarray(-np.sin(difference) / self.length**2 * self(difference))


@array_dataclass
class SimpleKriging:
    """Posterior mean of a process whose mean is known ([1]_ eq. 2.25).

    Parameters
    ----------
    kernel : Kernel
        Covariance of the process.
    x : ndarray, shape (n,)
        Training inputs.
    alpha : ndarray, shape (n,)
        Weights of the kernel's values.
    mean : float
        Of the process.
    """

    kernel: Kernel
    x: Array
    alpha: Array
    mean: float

    @classmethod
    def fit(cls, kernel: Kernel, x: Array, y: Array, sigma_n: float) -> Self:
        """Condition the process on values; their average is taken for the mean.

        Parameters
        ----------
        kernel : Kernel
            Covariance of the process.
        x, y : ndarray, shape (n,)
            Training inputs and what was measured there.
        sigma_n : float
            Standard deviation of each measured value.
        """
        K = kernel(x[:, None] - x) + sigma_n**2 * np.eye(len(x))
        mean = float(y.mean())
        return cls(kernel, x, scipy.linalg.cho_solve(scipy.linalg.cho_factor(K), y - mean), mean)

    def predict_change(self, start: float, by: float) -> float:
        """Predict how much the value changes between two inputs.

        Parameters
        ----------
        start, by : float
            The first input, and how far beyond it the second is.
        """
        k_start, k_end = self.kernel(np.array((start, start + by))[:, None] - self.x)
        return float((k_end - k_start) @ self.alpha)


@dataclass(frozen=True, slots=True, eq=False)
class OrdinaryKriging:
    """A process about an unknown constant mean ([2]_, section 3.2; [1]_ eq. 2.41-2.42).

    Parameters
    ----------
    x, y, sigma_n : ndarray, shape (n,)
        Training inputs, what was measured there, and the standard deviation of each.
    kernel : Kernel
        Covariance of the process.
    """

    x: Array
    y: Array
    sigma_n: Array
    kernel: Kernel

    def predict(self, x_star: Array) -> tuple[Array, Array]:
        """Values expected at inputs, shape (m,), and their standard deviations."""
        k_star = self.kernel(self.x[:, None] - x_star)
        return self._predict_linear_functions(
            k_star, np.full(len(x_star), self.kernel.sigma_f**2), 1.0
        )

    def predict_change(self, x_star: Array, start: float) -> tuple[Array, Array]:
        """Predict how much the value changes from one input to others, with standard deviations.

        Parameters
        ----------
        x_star : ndarray, shape (m,)
            The others.
        start : float
            The one.

        Returns
        -------
        values, sigmas : ndarray, shape (m,)
            Expected changes and their standard deviations.
        """
        k_star = self.kernel(self.x[:, None] - x_star) - self.kernel(self.x[:, None] - start)
        k_star_star = 2 * (self.kernel.sigma_f**2 - self.kernel(x_star - start))
        return self._predict_linear_functions(k_star, k_star_star, 0.0)

    def _predict_linear_functions(
        self, k_star: Array, k_star_star: Array, h_star: float
    ) -> tuple[Array, Array]:
        """Mean and deviation of linear functions of the process, [1]_ eq. 2.41-2.42.

        `h_star` is what the function makes of a constant: 1 for a value, 0 for a change.
        """
        K = self.kernel(self.x[:, None] - self.x)
        K[np.diag_indices_from(K)] += self.sigma_n**2
        h = np.ones(len(self.x))
        solved = scipy.linalg.cho_solve(
            scipy.linalg.cho_factor(K), np.column_stack((h, self.y, k_star))
        )
        K_inv_h, K_inv_y, K_inv_k_star = solved[:, 0], solved[:, 1], solved[:, 2:]
        var_beta = 1 / float(h @ K_inv_h)
        beta = var_beta * float(h @ K_inv_y)
        values = h_star * beta + k_star.T @ (K_inv_y - beta * K_inv_h)
        r = h_star - h @ K_inv_k_star
        variances = k_star_star - np.sum(k_star * K_inv_k_star, axis=0) + r**2 * var_beta
        return np.asarray(values), np.sqrt(np.maximum(variances, 0.0))
