"""Robust statistics: the spread of most values, and weights that leave outliers out.

References
----------
.. [1] Huber, Ronchetti (2009): Robust Statistics, 2nd edition.
.. [2] Zhang (1997): Parameter estimation techniques, a tutorial with application to conic
   fitting. doi:10.1016/S0262-8856(96)01112-2
"""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.frames import Array

MAD_TO_SIGMA: Final = 1.4826
"""Standard deviation over the median absolute deviation of Gaussian noise ([1]_, chapter 5)."""

TUKEY_CUTOFF: Final = 4.685
"""Standard deviations of no weight: least squares stay 95 % efficient ([2]_, table 1)."""


def mad_sigma(residuals: Array) -> float:
    """Standard deviation of most residuals, from their median absolute deviation from zero.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        At least one; any unit.
    """
    return MAD_TO_SIGMA * float(np.median(np.abs(residuals)))


def tukey_root_weights(standardised: Array) -> Array:
    """Square roots of `tukey_weights`: what the rows of a least-squares problem are scaled by.

    Parameters
    ----------
    standardised : ndarray, shape (n,)
        Residuals over their standard deviations.
    """
    u = np.minimum(np.abs(standardised) / TUKEY_CUTOFF, 1.0)
    return np.asarray(1 - u * u)


def tukey_weights(standardised: Array, least: float = 0.0) -> Array:
    """Weights of Tukey's biweight, ``(1 - (r / 4.685)²)²``, zero beyond ([2]_, table 1).

    Parameters
    ----------
    standardised : ndarray, shape (n,)
        Residuals over their standard deviations.
    least : float
        The smallest weight to return, if a weight of zero can't be divided by.
    """
    return np.asarray(np.maximum(tukey_root_weights(standardised) ** 2, least))
