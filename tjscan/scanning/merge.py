"""One profile from several of the same place: what most of them agree on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tjscan.laser.profile import Profile

AGREEING_PROFILES: Final = 3
"""Profiles that have to agree on a column. Among seven with 30 % of their points anywhere, 97 % of
the columns have as many right ones; chance makes three wrong ones agree in a column of thousands.
"""

AGREEMENT_SPAN: Final = 0.3e-3
"""Metres of range within which points agree: six standard deviations of a sensor's noise."""


def merge_repeated_profiles(profiles: Sequence[Profile]) -> Profile | None:
    """Keep what several profiles, taken with the arm at rest, agree on, column by column.

    Parameters
    ----------
    profiles : sequence of Profile
        Of one sensor, with the same columns. What is the same to the last bit counts once: it
        was measured once.

    Returns
    -------
    Profile or None
        Means of the points that agree, with the time of the last profile; None where fewer than
        `AGREEING_PROFILES` profiles differ.
    """
    distinct = list({profile.z_s.tobytes(): profile for profile in profiles}.values())
    if len(distinct) < AGREEING_PROFILES or len({len(profile) for profile in distinct}) > 1:
        return None
    x_s = np.array([profile.x_s for profile in distinct])
    z_s = np.array([profile.z_s for profile in distinct])
    order = np.argsort(z_s, axis=0)  # NaN last
    ranked = np.take_along_axis(z_s, order, axis=0)
    spans = ranked[AGREEING_PROFILES - 1 :] - ranked[: len(distinct) - AGREEING_PROFILES + 1]
    first = np.argmin(np.nan_to_num(spans, nan=np.inf), axis=0)
    middle = np.take_along_axis(ranked, first[None] + AGREEING_PROFILES // 2, axis=0)
    agree = np.abs(z_s - middle) <= AGREEMENT_SPAN / 2
    count = agree.sum(axis=0)
    kept = count >= AGREEING_PROFILES
    divisor = np.maximum(count, 1)
    x, z = (np.where(agree, v, 0.0).sum(axis=0) / divisor for v in (x_s, z_s))
    return replace(
        profiles[-1], x_s=np.where(kept, x, np.nan), z_s=np.where(kept, z, np.nan), intensity=None
    )
