"""A smoother over the steps of a Kalman filter, in the form of Bryson and Frazier."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.frames import Array

NO_STATES: Final = np.empty(0)


class StateSmoother:
    """Fixed-interval smoother whose states are kept at few of the filter's steps.

    Between two kept states it needs no state, only what their steps add up to: so its memory grows
    with the kept states alone, and nothing is inverted. It equals the smoother of Rauch, Tung and
    Striebel (Bierman, Fixed interval smoothing with discrete measurements, 1973).

    Parameters
    ----------
    size : int
        Of the state.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self.restart()

    def restart(self) -> None:
        """Forget all steps."""
        self._kept: list[tuple[Array, ...]] = []
        self._reset_sums_since_kept_state()

    def _reset_sums_since_kept_state(self) -> None:
        n = self._size
        self._transition, self._information = np.eye(n), np.zeros((n, n))
        self._gradient = np.zeros(n)

    def add_move(self, F: Array) -> None:
        """Take in a step by its transition matrix, shape (size, size)."""
        self._transition = F @ self._transition

    def add_reading(self, H: Array, gain: Array, off: float, variance: float) -> None:
        """Take in a reading.

        Parameters
        ----------
        H, gain : ndarray, shape (size,)
            Its derivative with respect to the state, and the filter's gain.
        off, variance : float
            How far it was off from what was expected, and the variance that this had.
        """
        h = H @ self._transition
        self._gradient += h * (off / variance)
        self._information += np.outer(h, h / variance)
        self._transition = self._transition - np.outer(gain, h)

    def keep(self, x: Array, P: Array) -> None:
        """Keep the state and covariance that the filter has now."""
        if self._kept:
            self._kept[-1] += (self._transition, self._gradient, self._information)
        self._kept.append((x, P))
        self._reset_sums_since_kept_state()

    def smooth(self, which: int) -> tuple[Array, Array]:
        """One quantity of the kept states, and its standard deviation, by all steps; then forget.

        Returns
        -------
        ndarray, shape (kept,)
        ndarray, shape (kept,)
        """
        if not self._kept:
            self.restart()
            return NO_STATES, NO_STATES
        self._kept[-1] += (self._transition, self._gradient, self._information)
        gradient, information = np.zeros(self._size), np.zeros((self._size, self._size))
        values = []
        for x, P, transition, added, informed in reversed(self._kept):
            gradient = added + transition.T @ gradient
            information = informed + transition.T @ information @ transition
            row = P[which]
            variance = P[which, which] - row @ information @ row
            values.append((x[which] + row @ gradient, max(variance, 0.0) ** 0.5))
        self.restart()
        return tuple(np.array(values[::-1]).T)
