"""One profile out of those taken within a millimetre or more along the groove."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tjscan.core.frames import Array, inverse_pose
from tjscan.laser.profile import Profile
from tjscan.scanning.profile_taker import merge_repeated_profiles
from tjscan.scanning.section import ProfileView, Substep

LARGEST_HALF_WIDTH: Final = 1e-3
"""Metres to either side of a place within which profiles are fused: over more of the groove the
section turns and its edges bend within what is fused."""

WIDER_BEHIND: Final = (2e-3, 3e-3)
"""Metres behind a place within which they are fused, too, where nearer ones leave a corner unsure:
what misled their reading rarely goes on."""


class ProfileFuser:
    """Fuses the profiles about evenly spaced places along the groove, each as soon as it can be.

    By length, never by count.

    Parameters
    ----------
    spacing : float
        Metres from one place to the next.
    p_s_t : ndarray, shape (3,)
        Where the groove is meant to be seen, in the sensor frame, metres.
    """

    def __init__(self, spacing: float, p_s_t: Array) -> None:
        self._spacing, self._p_s_t = spacing, np.append(p_s_t, 1.0)
        self._recent: list[tuple[float, ProfileView]] = []
        self._last: Array | None = None
        self._next_place = 0.0
        self.gone = 0.0

    def start_at(self, T_b_s: Array, gone: float) -> None:
        """Count from a pose of the sensor, shape (4, 4), where so many metres were gone."""
        self._last, self.gone, self._recent = (T_b_s @ self._p_s_t)[:3], gone, []
        self._next_place = gone + self._spacing

    def add(
        self, view: ProfileView, along_b: Array
    ) -> Iterator[tuple[float, Iterator[ProfileView]]]:
        """Add a profile; yields places that lie behind and what was seen there, as one view.

        Parameters
        ----------
        view : ProfileView
            Taken in passing.
        along_b : ndarray, shape (3,)
            Direction of the groove here, unit vector.

        Yields
        ------
        place : float
            Metres gone along the groove where the middle one of the profiles was taken.
        views : iterator of ProfileView
            From the pose of that one; each out of more profiles than the one before.
        """
        here = (view.T_b_s @ self._p_s_t)[:3]
        if self._last is not None:
            self.gone += float((here - self._last) @ along_b)
        self._last = here
        self._recent.append((self.gone, view))
        half = min(0.5 * self._spacing, LARGEST_HALF_WIDTH)
        while self.gone >= self._next_place + half:
            place = self._next_place
            self._next_place += self._spacing
            if min(abs(s - place) for s, _ in self._recent) <= half:
                s, middle = min(self._recent, key=lambda one: abs(one[0] - place))
                yield s, self._fused(place, half, middle, along_b)
            farthest = place - max(self._spacing, *WIDER_BEHIND)
            self._recent = [one for one in self._recent if one[0] > farthest]

    def _fused(
        self, place: float, half: float, middle: ProfileView, along_b: Array
    ) -> Iterator[ProfileView]:
        for behind in (half, *WIDER_BEHIND):
            near = [one for s, one in self._recent if -behind <= s - place <= half]
            yield fuse_profiles(near, middle, along_b)


def fuse_profiles(views: Sequence[ProfileView], middle: ProfileView, along_b: Array) -> ProfileView:
    """Slide the points of several views along the groove into the plane of one, and merge them.

    Parameters
    ----------
    views : sequence of ProfileView
        Taken near each other.
    middle : ProfileView
        The one in whose plane they are wanted.
    along_b : ndarray, shape (3,)
        Direction of the groove, unit vector.

    Returns
    -------
    ProfileView
        What they agree on, column by column; the middle one's own profile if they are too few.
    """
    T_m_b = inverse_pose(middle.T_b_s)
    along = T_m_b[:3, :3] @ along_b
    moved = [_slide_into_plane(one.profile, T_m_b @ one.T_b_s, along) for one in views]
    fused = merge_repeated_profiles(moved)
    profile = middle.profile if fused is None else replace(fused, time=middle.profile.time)
    return replace(middle, substep=Substep.FUSED, profile=profile)


def _slide_into_plane(profile: Profile, T: Array, along: Array) -> Profile:
    """A profile whose sensor is at `T` in another's frame, slid along into that one's plane."""
    R, p = T[:3, :3], T[:3, 3]
    points = profile.points @ R[:, [0, 2]].T + p
    points -= (points[:, 1] / along[1])[:, None] * along
    return replace(profile, x_s=points[:, 0].copy(), z_s=points[:, 2].copy())
