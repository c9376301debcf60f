"""How residuals of neighbouring columns hang together, and what that does to a fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.frames import Array
from tjscan.groove.segments import Index

LONGEST: Final = 24
"""Lag in columns beyond which noise is taken as independent."""

FAINT: Final = 0.08
"""A correlation below this ends the search: what follows is chance."""


@dataclass(frozen=True, slots=True, eq=False)
class Correlation:
    """Correlation of the noise of columns, as the spectrum that a fast convolution needs.

    Parameters
    ----------
    lags : ndarray, shape (m,)
        Correlation of columns 0, 1, 2 … apart.
    spectrum : ndarray
        Its power spectrum over `size` columns, nowhere negative.
    size : int
        Columns, padded.
    """

    lags: Array
    spectrum: Array
    size: int

    @property
    def inflation(self) -> float:
        """By how much correlation raises the variance of a mean of many points."""
        return float(max(1.0, 2 * self.lags.sum() - 1))


def correlation(scaled: Array, columns: Index, count: int) -> Correlation:
    """Estimate the correlation from residuals over their own standard deviation.

    Parameters
    ----------
    scaled : ndarray, shape (n,)
    columns : ndarray of int, shape (n,)
        The column of each.
    count : int
        Columns in all.
    """
    size = 1 << (count + LONGEST - 1).bit_length()
    grid = np.zeros((2, size))
    grid[0, columns] = scaled
    grid[1, columns] = 1.0
    power = np.abs(np.fft.rfft(grid)) ** 2
    product, pairs = np.fft.irfft(power)[:, :LONGEST]
    rho = product / np.maximum(pairs, 1.0)
    rho = rho / max(rho[0], 1e-30)
    faint = rho < FAINT
    end = int(faint.argmax()) if faint.any() else LONGEST
    lags = np.clip(rho[:end], 0, 1)
    kernel = np.zeros(size)
    kernel[:end] = lags
    kernel[size - end + 1 :] = lags[:0:-1]
    spectrum = np.maximum(np.fft.rfft(kernel).real, 0.0)
    return Correlation(lags, spectrum, size)


def covariances(
    correlation: Correlation,
    bases: list[Array],
    inverses: list[Array],
    sigmas: list[float],
    columns: list[Index],
) -> list[Array]:
    """Covariance of the coefficients of least-squares fits to correlated points.

    ``inverse (B R Bᵀ) inverse sigma²``, with R the correlation of the columns.
    """
    rows = sum(len(b) for b in bases)
    grid = np.zeros((rows, correlation.size))
    k = 0
    for basis, where in zip(bases, columns, strict=True):
        grid[k : k + len(basis), where] = basis
        k += len(basis)
    smooth = np.fft.irfft(np.fft.rfft(grid) * correlation.spectrum, n=correlation.size)
    found, k = [], 0
    for basis, inverse, sigma in zip(bases, inverses, sigmas, strict=True):
        m = len(basis)
        meat = grid[k : k + m] @ smooth[k : k + m].T
        found.append(sigma**2 * inverse @ meat @ inverse)
        k += m
    return found
