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
    Striebel (Bierman, Fixed interval smoothing with discrete measurements, 1973). The state may
    grow.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget all steps."""
        self._kept: list[tuple[Array, ...]] = []

    def _reset_sums_since_kept_state(self, n: int) -> None:
        self._transition, self._information = np.eye(n), np.zeros((n, n))
        self._gradient = np.zeros(n)

    def add_move(self, F: Array) -> None:
        """Take in a step by its transition matrix, shape (size after, size before)."""
        if self._kept:
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
        if not self._kept:
            return
        h = H @ self._transition
        self._gradient += h * (off / variance)
        self._information += np.outer(h, h / variance)
        self._transition = self._transition - np.outer(gain, h)

    def keep(self, x: Array, P: Array, shares: Array) -> None:
        """Keep the state and covariance that the filter has now.

        Parameters
        ----------
        x : ndarray, shape (size,)
        P : ndarray, shape (size, size)
        shares : ndarray, shape (size,)
            Of each state in the quantity that is smoothed.
        """
        if self._kept:
            self._kept[-1] += (self._transition, self._gradient, self._information)
        row = shares @ P
        self._kept.append((shares @ x, row, row @ shares))
        self._reset_sums_since_kept_state(len(x))

    def smooth(self) -> tuple[Array, Array]:
        """The quantity at the kept states, and its standard deviation, by all steps; then forget.

        Returns
        -------
        ndarray, shape (kept,)
        ndarray, shape (kept,)
        """
        if not self._kept:
            return NO_STATES, NO_STATES
        self._kept[-1] += (self._transition, self._gradient, self._information)
        gradient = np.zeros(len(self._transition))
        information = np.zeros((len(gradient), len(gradient)))
        values = []
        for value, row, variance, transition, added, informed in reversed(self._kept):
            gradient = added + transition.T @ gradient
            information = informed + transition.T @ information @ transition
            left = float(variance - row @ information @ row)
            values.append((value + row @ gradient, max(left, 0.0) ** 0.5))
        self.restart()
        return tuple(np.array(values[::-1]).T)
