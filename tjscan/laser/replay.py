"""A line laser that replays recorded profiles as the arm comes to their poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tjscan.core.devices import LocalDevice
from tjscan.core.errors import LaserFault, ViewNotRecorded
from tjscan.core.frames import Array
from tjscan.laser.profile import Profile

SAME_POSE_TOLERANCE: Final = 1e-6
"""Metres and radians: poses nearer to each other are one pose."""


class RecordedPoses:
    """Flange poses of a recording's profiles, from which a replay seeks the pose asked for.

    A pose that was recorded exactly is sought first, then the first one ahead within the
    tolerance. What is between is passed over, such as the second look at the section that a
    resumed scan went back to.

    Parameters
    ----------
    T_b_f : array_like, shape (n, 4, 4)
        The poses, in the order of the recording.
    times : sequence of float
        What the arm's clock showed there, seconds.
    distance : float
        How far from the pose asked for the flange may have been, metres.
    angle : float
        How far it may have been turned from it, radians.
    """

    def __init__(
        self, T_b_f: Sequence[Array], times: Sequence[float], *, distance: float, angle: float
    ) -> None:
        self._poses = np.array(T_b_f).reshape(-1, 4, 4)
        self.times, self._distance, self._angle = tuple(times), distance, angle
        self._at, self._taken = -1, False

    @property
    def current_view_number(self) -> int:
        """Number of the view that was last asked for; at first, of the first one."""
        return max(self._at, 0)

    def check_views(self, *T_b_f: Array) -> None:
        """Check that views from these poses were recorded, one after another.

        Parameters
        ----------
        *T_b_f : ndarray, shape (4, 4)
            Flange poses in the base frame.

        Raises
        ------
        ViewNotRecorded
            For the first that was not.
        """
        at = self._at
        for T in T_b_f:
            at = self._find_view(T, at + 1)

    def go_to_view(self, T_b_f: Array) -> None:
        """Go on to the view from a pose; raises as `check_views` does."""
        self._at, self._taken = self._find_view(T_b_f, self._at + 1), False

    def take_profile_number(self, T_b_f: Array) -> int:
        """Number of the profile that was recorded from a pose; goes on in the recording.

        Parameters
        ----------
        T_b_f : ndarray, shape (4, 4)
            Where the flange is, in the base frame.

        Raises
        ------
        LaserFault
            If no further profile was taken from there.
        """
        if self._taken or self._at < 0:
            try:
                self._at = self._find_view(T_b_f, self._at + 1)
            except ViewNotRecorded as error:
                message = f"the recording holds no further profile from there: {error.reason}"
                raise LaserFault(message) from None
        self._taken = True
        return self._at

    def _find_view(self, T_b_f: Array, start: int) -> int:
        """First view from `start` on that was recorded from a pose."""
        gaps = _pose_differences(self._poses[start:], T_b_f)
        for limits in ((SAME_POSE_TOLERANCE, SAME_POSE_TOLERANCE), (self._distance, self._angle)):
            near = np.flatnonzero((gaps <= limits).all(axis=1))
            if len(near):
                return start + int(near[0])
        raise ViewNotRecorded(_describe_nearest_pose(gaps), T_b_f)


class ReplayedLaser(LocalDevice):
    """A laser that replays recorded profiles, each chosen by the arm's pose.

    Parameters
    ----------
    poses : RecordedPoses
        Where it took its profiles; the same object that a replayed arm moves by.
    profiles : sequence of Profile
        The profiles, in the order of the recording.
    T_b_f : callable
        Returns the flange pose that the arm reports, shape (4, 4).
    time : callable
        Gives the seconds on the arm's clock: profiles are as late after its arrival as they were.
    """

    not_connected = (LaserFault, "the recording is not open: capture inside a `with` block")

    def __init__(
        self,
        poses: RecordedPoses,
        profiles: Sequence[Profile],
        T_b_f: Callable[[], Array],
        time: Callable[[], float],
    ) -> None:
        self._poses, self._profiles, self._T_b_f, self._time = poses, tuple(profiles), T_b_f, time

    def capture(self) -> Profile:
        """Return the profile that was recorded from the present pose of the arm.

        Raises
        ------
        LaserFault
            Outside a ``with`` block, or if no further profile was taken from there.
        """
        self.check_connected()
        i = self._poses.take_profile_number(self._T_b_f())
        profile = self._profiles[i]
        return replace(profile, time=profile.time + (self._time() - self._poses.times[i]))


def _pose_differences(poses: Array, T: Array) -> Array:
    """Metres and radians from each of many poses, shape (n, 4, 4), to one, shape (n, 2)."""
    apart = poses - T
    chord = np.linalg.norm(apart[:, :3, :3], axis=(1, 2)) / np.sqrt(8)  # sin(angle / 2)
    angle = 2 * np.arcsin(np.minimum(chord, 1.0))
    return np.column_stack((np.linalg.norm(apart[:, :3, 3], axis=1), angle))


def _describe_nearest_pose(gaps: Array) -> str:
    if not len(gaps):
        return "the recording ends before it"
    distance, angle = gaps[int(gaps[:, 0].argmin())]
    return (
        f"the nearest one ahead is {1e3 * distance:.1f} mm and {np.degrees(angle):.1f} deg off. "
        "Replay it with the [scan] it was recorded with, or allow for more with "
        "laser.replay_tolerance_mm"
    )
