"""Whether a profile shows what stands before the sensor now."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.errors import LaserFault
from tjscan.laser.profile import Profile
from tjscan.robot.arm import ArmState
from tjscan.scanning.scan import View

MOVED: Final = 1e-4
"""Metres, or entries of a rotation: a hand that moved further sees another profile."""


def check_fresh(profile: Profile, state: ArmState, before: View | None) -> None:
    """Refuse a profile that is late or frozen.

    Parameters
    ----------
    profile : Profile
        As it came.
    state : ArmState
        Where the arm came to rest before.
    before : View, optional
        The last profile that was good.

    Raises
    ------
    LaserFault
        If it was taken before the arm came to rest (where the sensor tells the time), or is the
        same to the last bit as that of another place: no sensor measures the same noise twice.
    """
    if 0.0 < profile.time < state.time:
        raise LaserFault(
            f"the profile is late: it was taken {1e3 * (state.time - profile.time):.0f} ms before "
            "the arm came to rest"
        )
    if before is None or not _same(profile, before.profile):
        return
    if np.abs(state.T_b_f - before.T_b_f).max() > MOVED:
        raise LaserFault("the profile is frozen: it is the one of the place before")


def _same(one: Profile, other: Profile) -> bool:
    return (
        one.z_s.tobytes() == other.z_s.tobytes()
        and one.x_s.tobytes() == other.x_s.tobytes()
        and bool(one.valid.any())
    )
