"""Where to look next, and what says so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from tjscan.core.frames import Array, readonly
from tjscan.scanning.section import ScannedSection


@dataclass(frozen=True, slots=True, eq=False)
class SetPoint:
    """Where frame t shall lie, and where it sits in the sensor.

    Parameters
    ----------
    T_b_t : ndarray, shape (4, 4)
        Frame t in the base frame.
    T_s_t : ndarray, shape (4, 4)
        Frame t in the sensor frame, eq. (14).
    covariance : ndarray, shape (7, 7), optional
        Of where the ideal set-point will turn out to be: position and rotation vector in frame t
        (metres, radians), and work angle (radians). None where the predictor can't tell.
    straight : bool
        Whether the flange shall go there on a straight line, as the paper's does. The joints'
        own way is shorter for them and takes less time.
    """

    T_b_t: Array
    T_s_t: Array
    covariance: Array | None = None
    straight: bool = True

    def __post_init__(self) -> None:
        for name in ("T_b_t", "T_s_t", "covariance"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, readonly(value))


class Predictor(Protocol):
    """Predicts the set-point of the next section from the finished ones, and from nothing else.

    A scan that was interrupted goes on as if it had not been: no predictor remembers.
    """

    def __call__(self, sections: Sequence[ScannedSection], step: float) -> SetPoint:
        """Set-point a step (metres) beyond the last of two or more sections."""
        ...


class StepRule(Protocol):
    """Says how long the next step shall be, from the finished sections and from nothing else."""

    def __call__(self, sections: Sequence[ScannedSection]) -> float:
        """Length of the step beyond the last of two or more sections, metres."""
        ...
