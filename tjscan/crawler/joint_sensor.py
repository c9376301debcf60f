"""The laser and the reader of its profiles: where the joint is now, or that it is not known."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from tjscan.core.errors import GrooveNotFound
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan.recording.journal import Journal, RunEvent

OLDEST_PROFILE: Final = 0.1
"""Seconds before now, or after it by a clock gone wrong, from which on a profile is not read: ten
of a sensor's periods, in which a vehicle that turns at 40 mm/s goes on by 4 mm."""

RECENT_PROFILES: Final = 10
"""Profiles that are kept."""


class JointReading(Protocol):
    """Where a profile shows the joint."""

    @property
    def centre(self) -> float:
        """Of the joint in the profile, along x_s, metres."""
        ...

    @property
    def centre_sigma(self) -> float:
        """Standard deviation of that, metres."""
        ...


class JointReader(Protocol):
    """Finds the joint in profiles, one after another."""

    def read(self, profile: Profile, travel: float) -> JointReading:
        """Find the joint in a profile.

        Parameters
        ----------
        profile : Profile
        travel : float
            Where the torch is along the joint, metres.

        Raises
        ------
        GrooveNotFound
            If it does not show it.
        """
        ...


class JointSensor:
    """A laser with its reader, which takes no profile of another time.

    Parameters
    ----------
    laser : LineLaser
    reader : JointReader
    clock : callable or None
        Gives the seconds on the clock that the profiles are dated by; None where they are not.
    journal : Journal
        Receives an event if profiles are not read for their age.
    """

    def __init__(
        self,
        laser: LineLaser,
        reader: JointReader,
        clock: Callable[[], float] | None,
        journal: Journal,
    ) -> None:
        self._laser, self._reader, self._clock = laser, reader, clock
        self._journal, self._late = journal, False
        self._seen: deque[tuple[float, Profile]] = deque(maxlen=RECENT_PROFILES)

    def look(self, travel: float) -> tuple[Profile, JointReading | None]:
        """Take a profile, and find the joint in it, if it shows it and is of now.

        Parameters
        ----------
        travel : float
            Where the torch is along the joint, metres.

        Raises
        ------
        LaserFault
            If no profile comes.
        """
        profile = self._laser.capture()
        off = self._seconds_off(profile)
        was_late, self._late = self._late, off > OLDEST_PROFILE
        if self._late:
            if not was_late:
                detail = f"a profile of the laser is dated {off:.2f} s off the clock, and not read"
                self._journal.record(RunEvent("old profile", detail))
            return profile, None
        try:
            reading = self._reader.read(profile, travel)
        except GrooveNotFound:
            return profile, None
        self._seen.append((-reading.centre, profile))
        return profile, reading

    @property
    def seen(self) -> Sequence[tuple[float, Profile]]:
        """The last profiles that were read, with laser minus joint in each, metres."""
        return tuple(self._seen)

    def _seconds_off(self, profile: Profile) -> float:
        """Seconds between a profile and now, at the least; none if the laser dates nothing."""
        if self._clock is None or profile.time == 0.0:
            return 0.0
        return abs(self._clock() - profile.time) - profile.time_uncertainty
