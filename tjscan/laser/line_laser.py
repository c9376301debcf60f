"""The protocol that every line laser, real or simulated, fulfils."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from tjscan.core.devices import Device
from tjscan.laser.profile import Profile


class LineLaser(Device, Protocol):
    """A line laser on the arm's hand."""

    def capture(self) -> Profile:
        """Take one profile with the arm at rest, now: one that waits in a buffer is late.

        Raises
        ------
        LaserFault
            If no profile came.
        """


@runtime_checkable
class StreamingLaser(Protocol):
    """A line laser that takes profiles as the arm moves, and says when each was taken."""

    def stream(self, period: float) -> Iterator[Profile | None]:
        """Take profiles one after another, without end.

        Parameters
        ----------
        period : float
            Seconds between two of them.

        Yields
        ------
        Profile or None
            With the time in the middle of its exposure, in seconds on the laser's own clock: it
            may be off the arm's and drift. None each time that none came.

        Raises
        ------
        LaserFault
            If the laser is not connected.
        """


@dataclass(frozen=True, slots=True)
class LaserDescription:
    """What a laser states about itself and its link, for a person to read.

    Parameters
    ----------
    link : str
        How it is connected.
    format : str
        What it sends, and what its numbers mean.
    near, far : float
        Limits of z in frame s that it can state, in metres.
    advice : str
        What would be better, in a sentence; empty if nothing would.
    """

    link: str
    format: str
    near: float
    far: float
    advice: str = ""


@runtime_checkable
class SelfDescribingLaser(Protocol):
    """A laser that describes itself; a simulated or a recorded one has nothing to describe."""

    def describe(self) -> LaserDescription:
        """Describe the laser; it has to be connected."""
