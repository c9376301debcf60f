"""What the joint looked like on the way back, for the next pass, which may no longer see its edges.

On the way back the arc is out, and the surface is that which the next pass will see. Where the
edges can't be read on the way back either, the joint is found by what was seen a pass before; then
the error of that is in what is remembered, and grows from pass to pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import floor, hypot, sqrt
from typing import Final

import numpy as np

from tjscan.core.errors import GrooveNotFound
from tjscan.crawler.joint_tracking.registration import JointPlacement, ReferenceProfile
from tjscan.crawler.joint_tracking.tracking import REGISTERED_JOINT, ButtJointReading, JointTracker
from tjscan.crawler.slip_estimator import MOST_SIDEWAYS_SHARE
from tjscan.laser.profile import Profile

STATION_LENGTH, STATION_STEP = 4e-3, 1e-3
"""Metres along the joint that a reference is the median of, about its place, and between two: over
a longer way a bead's toe does not go to one side evenly."""

PROFILE_SPACING: Final = 0.5e-3
"""Metres between two profiles that are remembered."""

FEWEST_PROFILES: Final = 4
"""Profiles that make a reference: the median of fewer shows the light of the arc."""

LINE_LENGTH, LINE_SIGMA = 20e-3, 0.02e-3
"""Metres of the way along which the joint goes straight aside in a laser's line, and by how much it
does not, as a standard deviation: by what neither edges nor the vehicle's way are even."""


Seen = tuple[float, Profile, JointPlacement | None]
"""Where along the joint a profile was taken, metres, and where the joint was read in it."""


class JointMemory:
    """What the joint looked like at each place when the vehicle last went back over it."""

    def __init__(self) -> None:
        self._references: dict[int, ReferenceProfile] = {}
        self._seen: list[Seen] = []
        self._next = 0
        self._last: float | None = None

    def reference_at(self, travel: float) -> ReferenceProfile | None:
        """What the joint looked like at a place along it, in metres; None if it was not seen."""
        station = round(travel / STATION_STEP)
        reference = self._references.get(station)
        return reference and reference.seen_from(travel - station * STATION_STEP)

    def remember(
        self, travel: float, profile: Profile, placement: JointPlacement | None, noise: float
    ) -> None:
        """Take in a profile, if the vehicle went back since the last one.

        The reference of a place is made when the vehicle has gone on beyond it, or turns.

        Parameters
        ----------
        travel : float
            Where it is along the joint, metres.
        profile : Profile
        placement : JointPlacement or None
            Where the joint is in it; None if it was not read.
        noise : float
            Standard deviation of its z, metres.
        """
        if self._last is None or travel > self._last + PROFILE_SPACING:
            self._make_references(self._last or 0.0, noise)
            self._last, self._next = travel, floor(travel / STATION_STEP)
            self._seen = []
        if travel > self._last - PROFILE_SPACING:
            return
        self._last = travel
        self._seen.append((travel, profile, placement))
        self._make_references(travel + LINE_LENGTH / 2, noise)

    def _make_references(self, down_to: float, noise: float) -> None:
        """Make the references that are left of those ahead of a place."""
        while self._seen and (place := self._next * STATION_STEP) > down_to:
            self._seen = [row for row in self._seen if row[0] < place + LINE_LENGTH / 2]
            near = [row for row in self._seen if abs(row[0] - place) < STATION_LENGTH / 2]
            placements = _on_one_line(self._seen, near, place)
            if len(placements) >= FEWEST_PROFILES:
                places, profiles, _ = zip(*near, strict=True)
                before, beyond = self._references.get(self._next), np.subtract(places, place)
                made = ReferenceProfile.from_profiles(profiles, placements, noise, before, beyond)
                self._references[self._next] = made
            self._next -= 1


def _on_one_line(rows: Sequence[Seen], near: Sequence[Seen], place: float) -> list[JointPlacement]:
    """Where the joint is in profiles near a place, on the line through all that was read about it.

    A vehicle hardly turns meanwhile. Empty if it was not read on both sides.
    """
    read = [(at - place, one) for at, _, one in rows if one is not None]
    along = np.array([at for at, _ in read])
    if not (len(read) and along.min() < STATION_LENGTH / 2 and along.max() > -STATION_LENGTH / 2):
        return []
    found = np.array([(one.centre, one.hull_z, one.roll) for _, one in read])
    total, shared = np.array([(one.centre_sigma, one.shared_sigma) for _, one in read]).T
    # Readings over the length of a reference are off alike. It goes aside no more than it may.
    alike = max(len(read) * STATION_LENGTH / LINE_LENGTH, 1.0)
    X = np.vstack((np.stack((np.ones_like(along), along), axis=1), (0.0, 1.0)))
    weights = 1 / np.append(alike * (total**2 + LINE_SIGMA**2), MOST_SIDEWAYS_SHARE**2)
    shares = np.linalg.solve(X.T @ (weights[:, None] * X), X.T * weights)
    start, slope = shares[:, :-1] @ found
    own = np.append(alike * (total**2 - shared**2 + LINE_SIGMA**2), MOST_SIDEWAYS_SHARE**2)
    sigma = hypot(sqrt(float(shares[0] ** 2 @ own)), float(shares[0, :-1] @ shared))
    placements = []
    for at, _, one in near:
        centre, hull_z, roll = (start + (at - place) * slope).tolist()
        seen = one or replace(read[0][1], hull_z=hull_z, roll=roll)
        placements.append(replace(seen, centre=centre, centre_sigma=sigma, shared_sigma=sigma))
    return placements


class RememberingTracker:
    """A `JointReader` that reads the edges, and where they are gone goes by what it remembers."""

    def __init__(self) -> None:
        self._tracker, self._memory = JointTracker(), JointMemory()
        self._station, self._readings = 0, 0

    def read(self, profile: Profile, travel: float) -> ButtJointReading:
        """Find the joint in a profile; see `JointReader.read`.

        Readings by the same reference share its error: each states only what it adds to those
        before it.
        """
        reference = self._memory.reference_at(travel)
        try:
            reading = self._tracker.read(profile, reference)
        except GrooveNotFound as error:
            if error.reason != "frozen":
                self._memory.remember(travel, profile, None, self._tracker.noise)
            raise
        self._memory.remember(travel, profile, reading, self._tracker.noise)
        station = floor(travel / STATION_LENGTH)
        if station != self._station:
            self._station, self._readings = station, 0
        if REGISTERED_JOINT not in reading.conditions:
            return reading
        self._readings += 1
        own = reading.centre_sigma**2 - reading.shared_sigma**2
        return replace(
            reading,
            centre_sigma=sigma_of_independent_part(sqrt(own), reading.shared_sigma, self._readings),
            lone_sigma=reading.centre_sigma,
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
