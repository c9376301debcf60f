"""Where the torch was along a pass, once all of the pass and the way back are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.crawler.method import FollowingMethod
from tjscan.crawler.phases import Phase

TRACE_SPACING: Final = 1e-3
"""Metres along the weld between places of a trace."""

TRACED_PHASES: Final = frozenset({Phase.READY, Phase.MANUAL, Phase.STOP})
"""Phases at whose beginning it is known where the torch was in the pass before: a reversal has
shown the crab, or it was stopped."""

LIKELY_SIGMAS: Final = 2.0
"""Standard deviations within which the torch is at 95 of 100 places."""


@dataclass(frozen=True, slots=True, eq=False)
class TorchTrace:
    """Where the torch was along a pass, by a smoother over the pass and what came after.

    Parameters
    ----------
    number : int
        Of the pass, from 1.
    travel : ndarray, shape (n,)
        Places along the weld at which the arc burned, metres.
    off, sigma : ndarray, shape (n,)
        Of the torch to the right of its path, and its standard deviation, metres.
    """

    number: int
    travel: Array
    off: Array
    sigma: Array

    @property
    def text(self) -> str:
        """How far off it was, in words."""
        most = int(np.abs(self.off).argmax())
        rms = float(np.sqrt(np.mean(self.off**2)))
        off, likely = 1e3 * abs(self.off[most]), 1e3 * LIKELY_SIGMAS * self.sigma[most]
        return (
            f"pass {self.number}: the torch was {1e3 * rms:.2f} mm (rms) beside its path, at most "
            f"{off:.2f} ± {likely:.2f} mm, at {1e3 * self.travel[most]:.0f} mm"
        )


class TorchTracer:
    """Notes where the arc burns, and asks the method where the torch was, once it knows better.

    Parameters
    ----------
    method : FollowingMethod
    """

    def __init__(self, method: FollowingMethod) -> None:
        self._method = method
        self._rows: list[tuple[int, float, float]] = []

    def add(self, number: int, travel: float, axis: float) -> None:
        """Note a cycle with the arc on.

        Parameters
        ----------
        number : int
            Of the pass.
        travel : float
            Along the weld, metres.
        axis : float
            Of the torch on its axis, to the right of its path, metres.
        """
        if self._rows and abs(travel - self._rows[-1][1]) < TRACE_SPACING:
            return
        self._method.keep_state()
        self._rows.append((number, travel, axis))

    def finish(self) -> TorchTrace | None:
        """The trace of what was noted; None if there is nothing, or the method can't state it."""
        rows, self._rows = self._rows, []
        offset, sigma = self._method.smoothed_offsets()
        if not len(offset):
            return None
        numbers, travel, axis = zip(*rows, strict=True)
        return TorchTrace(numbers[-1], np.array(travel), offset + axis, sigma)
