"""Profiles taken in passing, each with the pose of the arm at the moment it was taken."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError, LaserFault
from tjscan.laser.line_laser import LineLaser, StreamingLaser
from tjscan.laser.profile import Profile, ProfileRepeats
from tjscan.robot.arm import Arm, ArmState
from tjscan.robot.following import Following, FollowingArm, check_can_follow
from tjscan.scanning.continuous.clocks import LATEST_ARRIVAL, LaserClock
from tjscan.scanning.continuous.poses import ActualPoses

PROFILE_PERIOD: Final = 0.005
"""Seconds from profile to profile."""

LONGEST_SILENCE: Final = 10.0
"""Seconds on the arm's clock without a profile that is waited for more."""

MOST_PENDING: Final = 200
"""Profiles that may wait for the arm's states: a second."""


def devices_that_follow(arm: Arm, laser: LineLaser) -> tuple[FollowingArm, StreamingLaser]:
    """Arm and laser of a continuous scan; nothing moves.

    Raises
    ------
    ConfigurationError
        If the arm can't follow paths, or the laser takes no stream of profiles.
    """
    if not isinstance(laser, StreamingLaser):
        raise ConfigurationError(
            "this laser's driver takes profiles one by one, and does not say when in a stream of "
            'them: set mode = "stepwise"',
            key="scan.mode",
        )
    return check_can_follow(arm), laser


class PlacedProfiles:
    """The stream of a laser's profiles, each with the arm's state in the middle of its exposure.

    Parameters
    ----------
    laser : StreamingLaser
        Takes the profiles; it is connected.
    poses : ActualPoses
        Learns the arm's states.
    repeats : ProfileRepeats
        Knows the profiles that came before: one that comes again was not taken now.

    Attributes
    ----------
    heard : float
        When the latest profile came that was taken, seconds on the arm's clock.
    placed_until : float
        When the latest profile was taken that has its state, seconds on the arm's clock.

    Raises
    ------
    LaserFault
        If the laser's stamps can't be true.
    """

    def __init__(self, laser: StreamingLaser, poses: ActualPoses, repeats: ProfileRepeats) -> None:
        laser.check_stream(PROFILE_PERIOD)
        self._laser, self._poses, self._repeats = laser, poses, repeats
        self.heard, self.placed_until = np.inf, -np.inf

    def profiles(self, following: Following) -> Iterator[Profile | None]:
        """Profiles as they arrive, None where one is missing or came before; never ends.

        The laser streams from the first on.

        Raises
        ------
        LaserFault
            After `LONGEST_SILENCE`.
        ArmFault
            If the arm stopped.
        """
        self.heard = quiet_since = np.inf
        self._poses.begin()
        for streamed in self._laser.stream(PROFILE_PERIOD):
            self._poses.add(following.states())
            latest = self._poses.latest
            if streamed is not None or quiet_since > latest:
                quiet_since = latest
                self.heard = latest - (0.0 if streamed is None else streamed.waited)
            elif latest - quiet_since > LONGEST_SILENCE:
                raise LaserFault(
                    f"no profile came for {latest - quiet_since:.0f} s. See that the laser "
                    "measures and its cable sits, then go on with --resume"
                )
            is_new = streamed is not None and not self._repeats.is_repeat(streamed.profile)
            yield streamed.profile if streamed is not None and is_new else None

    def has_passed(self, time: float) -> bool:
        """Whether all profiles until a time on the arm's clock were placed, or will not come."""
        return self.placed_until > time or self.heard > time + LATEST_ARRIVAL

    def placed(
        self, following: Following, clock: LaserClock
    ) -> Iterator[list[tuple[ArmState, Profile]]]:
        """States and profiles, as soon as the arm's states cover them; never ends.

        One that was taken before the arm began to follow is left out.
        """
        pending: deque[Profile] = deque()
        for profile in self.profiles(following):
            if profile is not None:
                clock.notice_arrival(profile.time, self.heard)
                if len(pending) == MOST_PENDING:
                    raise LaserFault(
                        "the laser's stamps are a second ahead of the arm's states. See that "
                        "nothing sets the laser's clock, then go on with --resume"
                    )
                pending.append(profile)
            ready = []
            while pending and (time := clock.arm_time(pending[0].time)) <= self._poses.latest:
                profile = pending.popleft()
                self.placed_until = time
                if self._poses.cover(time):
                    ready.append((self._poses.at(time), profile))
            yield ready
