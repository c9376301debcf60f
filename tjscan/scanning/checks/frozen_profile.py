"""Whether a profile shows what stands before the sensor now."""

from __future__ import annotations

from hashlib import sha256
from typing import Final

import numpy as np

from tjscan.core.errors import LaserFault
from tjscan.core.frames import Array
from tjscan.laser.profile import Profile
from tjscan.robot.arm import ArmState
from tjscan.scanning.section import View

MOVED: Final = 1e-4
"""Metres, or entries of a rotation: a hand that moved further sees another profile."""


class FrozenProfileCheck:
    """Every profile that was good, told apart by its bits, and where it was taken."""

    def __init__(self) -> None:
        self._places: dict[bytes, Array] = {}

    def add(self, view: View) -> None:
        """Remember a profile; one without a point tells nothing."""
        if view.profile.valid.any():
            self._places.setdefault(_bits(view.profile), view.T_b_f)

    def check(self, profile: Profile, state: ArmState) -> None:
        """Refuse a profile that is late or frozen.

        Parameters
        ----------
        profile : Profile
            As it came.
        state : ArmState
            Where the arm came to rest before.

        Raises
        ------
        LaserFault
            If it was taken before the arm came to rest (where the sensor tells the time), or is
            the same to the last bit as one of another place, however long ago: no sensor measures
            the same noise twice.
        """
        if 0.0 < profile.time < state.time:
            raise LaserFault(
                f"the profile is late: it was taken {1e3 * (state.time - profile.time):.0f} ms "
                "before the arm came to rest"
            )
        place = self._places.get(_bits(profile))
        if place is not None and np.abs(state.T_b_f - place).max() > MOVED:
            raise LaserFault("the profile is frozen: it is one of a place before")


def _bits(profile: Profile) -> bytes:
    return sha256(profile.z_s.tobytes() + profile.x_s.tobytes()).digest()
