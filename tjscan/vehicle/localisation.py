"""Poses of the vehicles of a team, from a device that sees them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tjscan.core.devices import Device


@dataclass(frozen=True, slots=True)
class VehiclePose:
    """Pose of a vehicle at a time, in frame w.

    Parameters
    ----------
    time : float
        When it was measured, seconds on the clock of the reader and its team.
    x, y : float
        Of the vehicle's origin, metres.
    heading : float
        From x towards y, radians.
    """

    time: float
    x: float
    y: float
    heading: float


@dataclass(frozen=True, slots=True)
class TrackedDisc:
    """A round thing that moves through the area, in frame w.

    Parameters
    ----------
    time : float
        When it was measured, seconds on the reader's clock.
    x, y, radius : float
        Metres.
    vx, vy : float
        Its speed, m/s.
    """

    time: float
    x: float
    y: float
    radius: float
    vx: float
    vy: float


class Localisation(Device, Protocol):
    """Something that sees a team; connecting waits until every vehicle was seen.

    What it gives may be noisy, old, frozen, or another vehicle's: its reader judges that.
    What can't be a pose, and what came after a later one, it drops itself, and reports so, as it
    reports lost links, in the thread that reads.
    """

    def read(self) -> tuple[VehiclePose | None, ...]:
        """Give the newest pose of each vehicle that came since the last reading, or none.

        It does not wait, and a lost link is no error: no poses come.
        """

    def read_passers_by(self) -> tuple[TrackedDisc, ...]:
        """Give the newest sight of everything that moves through the area, however old."""
