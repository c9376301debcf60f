"""Times that hold on any machine: each is taken in turns with a fixed reference task."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import median
from time import perf_counter
from typing import Final, Self

import numpy as np
from _table import Row

USUAL: Final = 1.2e-3
"""Seconds that the reference task takes on the machine for which the limits were set: from three
tasks whose times were known there, 1.0, 1.1 and 1.3 ms."""


class Stopwatch:
    """Times what is done in ``with`` blocks, and the reference task before and after each.

    Attributes
    ----------
    seconds : list of float
        What each block took.
    """

    def __init__(self) -> None:
        self.seconds: list[float] = []
        self._references: list[float] = []
        self._start = 0.0

    def __enter__(self) -> Self:
        """Time the reference task, then begin."""
        self._time_reference()
        self._start = perf_counter()
        return self

    def __exit__(self, *error: object) -> None:
        """Note what the block took, and time the reference task again."""
        self.seconds.append(perf_counter() - self._start)
        self._time_reference()

    def row(self, name: str, statistic: Callable[[Sequence[float]], float], limit_ms: float) -> Row:
        """A bar in milliseconds, held as on the usual machine.

        Parameters
        ----------
        name : str
            What is timed.
        statistic : callable
            Of the seconds: `median`, `max`.
        limit_ms : float
            The longest that holds on the usual machine, in milliseconds.
        """
        taken = 1e3 * statistic(self.seconds)
        return Row(name, taken, limit_ms, "ms", slowdown=self.slowdown)

    @property
    def slowdown(self) -> float:
        """How many times longer the reference task took than on the usual machine."""
        return median(self._references) / USUAL

    def _time_reference(self) -> None:
        start = perf_counter()
        run_reference_task()
        self._references.append(perf_counter() - start)


def run_reference_task() -> None:
    """Do what the program mostly does: many small calls of NumPy, between steps of Python."""
    x = np.linspace(-1.0, 1.0, 640)
    for i in range(60):
        powers = np.stack((np.ones_like(x), x, x * x), axis=1)
        normal = powers.T @ powers
        solution = np.linalg.solve(normal, powers.T @ np.hypot(x, 0.1 * i))
        near = np.abs(powers @ solution) < 0.5
        sum(k * k for k in range(40 if near.any() else 41))
