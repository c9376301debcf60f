"""The step under way, and how far any step may lead."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.scanning.section import ScannedSection, Substep

TIGHTEST: Final = 0.04
"""Metres: radius of the tightest bend of a groove. A brace of 168 mm on a leg hardly larger bends
its groove so at the saddle."""

LOOSE: Final = radians(20)
"""Turn from section to section beside the groove's own: noise, and what a nudge turns."""

TAUGHT: Final = radians(45)
"""How much further the first turn may go, from where a hand held the sensor."""

MOST: Final = radians(100)
"""Largest turn from section to section, whatever the step."""


@dataclass(frozen=True, slots=True, eq=False)
class StepRequest:
    """One step, as it was meant.

    Parameters
    ----------
    last : ScannedSection
        The section it starts from.
    p_b_ahead : ndarray, shape (3,)
        Where it leads: origin of frame t in the prediction substep, metres.
    length : float
        Metres.
    predicted : ScannedSection, optional
        What the prediction view showed, once it is read.
    """

    last: ScannedSection
    p_b_ahead: Array
    length: float
    predicted: ScannedSection | None = None

    @property
    def direction_b(self) -> Array:
        """Unit vector of the step, shape (3,).

        It starts from frame t or from the groove, whichever fits its length better: of a section
        that was taught, frame t lies beside the groove.
        """
        steps = np.stack((self.p_b_ahead - self.last.T_b_t[:3, 3], self.p_b_ahead - self.start_b))
        lengths = np.linalg.norm(steps, axis=1)
        best = int(np.abs(lengths - self.length).argmin())
        return np.asarray(steps[best] / lengths[best])

    @property
    def start_b(self) -> Array:
        """The groove's origin that it starts from, shape (3,), metres."""
        return self.last.T_b_g[:3, 3]

    @property
    def largest_turn(self) -> float:
        """Radians that sensor or groove may turn over the step."""
        turn = min(LOOSE + self.length / TIGHTEST, MOST)
        return turn + TAUGHT if self.last.view.substep is Substep.TAUGHT else turn
