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


@dataclass(frozen=True, slots=True)
class StreamedProfile:
    """A profile of a stream, and how long ago it came.

    Parameters
    ----------
    profile : Profile
        With the time in the middle of its exposure, in seconds on the laser's own clock: it may be
        off the arm's and drift.
    waited : float
        Seconds since it came from the laser, for which it has waited to be taken.
    """

    profile: Profile
    waited: float = 0.0


@runtime_checkable
class StreamingLaser(Protocol):
    """A line laser that takes profiles as the arm moves, and says when each was taken."""

    def check_stream(self, period: float) -> None:
        """Refuse a stream, before anything moves, whose times can't be true.

        Parameters
        ----------
        period : float
            Seconds between two profiles.

        Raises
        ------
        LaserFault
            If they can't, profiles would be much fewer, or the laser is not connected.
        """

    def stream(self, period: float) -> Iterator[StreamedProfile | None]:
        """Take profiles one after another, without end.

        Parameters
        ----------
        period : float
            Seconds between two of them.

        Yields
        ------
        StreamedProfile or None
            In the order of their exposures: those that come while one is read wait. None for each
            that was lost, and from time to time while none comes.

        Raises
        ------
        LaserFault
            If the laser is not connected, ends its stream, or too many wait.
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
