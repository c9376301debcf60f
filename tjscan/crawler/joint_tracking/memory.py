"""What the joint looked like on the way back, for the next pass, which may no longer see its edges.

On the way back the arc is out, and the surface is that which the next pass will see. Where the
edges can't be read on the way back either, the joint is found by what was seen a pass before; then
the error of that is in what is remembered, and grows from pass to pass.
"""

from __future__ import annotations

from dataclasses import replace
from math import floor, sqrt
from typing import Final

from tjscan.crawler.joint_tracking.registration import JointPlacement, ReferenceProfile
from tjscan.crawler.joint_tracking.tracking import REGISTERED_JOINT, ButtJointReading, JointTracker
from tjscan.laser.profile import Profile

STATION_LENGTH: Final = 5e-3
"""Metres along the joint for which one reference holds."""

PROFILE_SPACING: Final = 0.5e-3
"""Metres between two profiles that are remembered."""

FEWEST_PROFILES: Final = 4
"""Profiles that make a reference: the median of fewer shows the light of the arc."""


class JointMemory:
    """What the joint looked like at each place when the vehicle last went back over it."""

    def __init__(self) -> None:
        self._references: dict[int, ReferenceProfile] = {}
        self._seen: list[tuple[Profile, JointPlacement]] = []
        self._station = 0
        self._last: float | None = None

    def reference_at(self, travel: float) -> ReferenceProfile | None:
        """What the joint looked like at a place along it, in metres; None if it was not seen."""
        return self._references.get(floor(travel / STATION_LENGTH))

    def remember(
        self, travel: float, profile: Profile, placement: JointPlacement, noise: float
    ) -> None:
        """Take in a profile, if the vehicle went back since the last one.

        The reference of a station is made when the vehicle leaves it.

        Parameters
        ----------
        travel : float
            Where it is along the joint, metres.
        profile : Profile
        placement : JointPlacement
            Where the joint is in it.
        noise : float
            Standard deviation of its z, metres.
        """
        if self._last is None or travel > self._last:
            self._last = travel
        if travel > self._last - PROFILE_SPACING:
            return
        self._last = travel
        station = floor(travel / STATION_LENGTH)
        if station != self._station:
            if len(self._seen) >= FEWEST_PROFILES:
                profiles, placements = zip(*self._seen, strict=True)
                reference = ReferenceProfile.from_profiles(profiles, placements, noise)
                self._references[self._station] = reference
            self._seen, self._station = [], station
        self._seen.append((profile, placement))


class RememberingTracker:
    """A `JointReader` that reads the edges, and where they are gone goes by what it remembers."""

    def __init__(self) -> None:
        self._tracker, self._memory = JointTracker(), JointMemory()
        self._reference: ReferenceProfile | None = None
        self._readings = 0

    def read(self, profile: Profile, travel: float) -> ButtJointReading:
        """Find the joint in a profile; see `JointReader.read`.

        Readings by the same reference share its error: each states only what it adds to those
        before it.
        """
        reference = self._memory.reference_at(travel)
        reading = self._tracker.read(profile, reference)
        self._memory.remember(travel, profile, reading, self._tracker.noise)
        if reference is not self._reference:
            self._reference, self._readings = reference, 0
        if REGISTERED_JOINT not in reading.conditions:
            return reading
        self._readings += 1
        own = reading.centre_sigma**2 - reading.shared_sigma**2
        return replace(
            reading,
            centre_sigma=sigma_of_independent_part(sqrt(own), reading.shared_sigma, self._readings),
        )


def sigma_of_independent_part(own: float, shared: float, count: int) -> float:
    """Standard deviation of the last of some readings, taken as independent of those before it.

    Readings with errors of their own, and one they share, give n / (own² + n shared²) together.
    What the last one adds to that is the inverse of the returned value's square.

    Parameters
    ----------
    own, shared : float
        Standard deviations.
    count : int
        How many readings there are, this one included.
    """
    together = own**2 + count * shared**2
    before = together - shared**2
    return sqrt(together * before) / own
