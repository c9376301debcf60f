"""How fast two simulated tracks run after what they were told."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le

from tjscan.core.frames import Array
from tjscan.core.units import MM_S, MM_S2, SECONDS, SettingsTable

STANDSTILL_SPEED: Final = 1e-7
"""m/s: a track that is told to rest, and is slower than this, is at rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveSettings(SettingsTable):
    """The table [simulation.vehicle.drives]: how the tracks' motors follow.

    Parameters
    ----------
    top_speed : float
        Of a track, m/s: the 6 m/min of the paper. Where one would run faster, both are slowed by
        the same share, so that the path's curvature stays.
    lag : float
        Time constant of the speed loop, seconds. Assumption.
    acceleration : float
        Most that a track gains or loses on a command, m/s². Assumption.
    braking : float
        Most that it loses on a stop, m/s². Assumption: 200 N of the 1,680 N that both tracks
        pull.
    """

    top_speed: Annotated[float, Gt(0), Le(5000), MM_S] = 0.1
    lag: Annotated[float, Ge(0), Le(10), SECONDS] = 0.05
    acceleration: Annotated[float, Gt(0), Le(1e5), MM_S2] = 0.5
    braking: Annotated[float, Gt(0), Le(1e5), MM_S2] = 2.0


class TrackDrives:
    """Drives of two tracks: a first-order lag and a limit to what they gain.

    Parameters
    ----------
    settings : DriveSettings
    """

    def __init__(self, settings: DriveSettings) -> None:
        self._settings = settings
        self.speeds = np.zeros(2)
        """Of the left and right track, m/s, forward positive."""

    def follow(self, wanted: Array, period: float) -> None:
        """Follow the wanted speeds of both tracks, shape (2,), for a period in seconds."""
        s = self._settings
        wanted = wanted * min(1.0, s.top_speed / max(float(np.abs(wanted).max()), 1e-12))
        share = 1.0 if s.lag == 0 else 1 - exp(-period / s.lag)
        most = s.acceleration * period
        self.speeds = self.speeds + np.clip(share * (wanted - self.speeds), -most, most)
        self.speeds[(wanted == 0) & (np.abs(self.speeds) < STANDSTILL_SPEED)] = 0.0

    def brake(self, period: float) -> None:
        """Slow both tracks down for a period in seconds, until they stand."""
        most = self._settings.braking * period
        self.speeds = self.speeds - np.clip(self.speeds, -most, most)
