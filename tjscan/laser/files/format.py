"""What the user states of a profile file, and what is read from one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from tjscan.laser.profile import Profile

METRES_PER_UNIT: Final = {"mm": 1e-3, "um": 1e-6, "m": 1.0}
"""Metres in each unit of length."""

ASSUMED_MID_RANGE: Final = 0.240
"""Distance of mid-range from the sensor where nothing is stated, in metres (assumption)."""


@dataclass(frozen=True, slots=True)
class ProfileFormat:
    """What the user states of a profile file: unit, pitch, invalid values, scale of heights.

    Parameters
    ----------
    unit : str, optional
        One of `METRES_PER_UNIT`, if the names of the columns don't state it.
    pitch : float, optional
        Distance of neighbouring columns of a matrix, or of points without an x, in that unit.
    invalid : tuple of float
        Codes of no point, beside NaN and nothing. Zero is one, too, if it is far
        from all other heights.
    z_scale : float
        What one of the file's numbers is in that unit; negative where heights grow towards the
        sensor.
    z_offset : float, optional
        Distance from the sensor, in that unit, of a height of zero. Without it
        heights of either sign count from `ASSUMED_MID_RANGE`.
    """

    unit: str | None = None
    pitch: float | None = None
    invalid: tuple[float, ...] = ()
    z_scale: float = 1.0
    z_offset: float | None = None


@dataclass(slots=True)
class FileProfiles:
    """Profiles that were read from a file, and what could not be read.

    Parameters
    ----------
    profiles : dict of str to Profile
        By name: ``row 3``, counted from the first row of data, ``profile 12``, or the file's
        name.
    bad : list of str
        What could not be read, and why.
    notes : list of str
        What was taken for granted.
    """

    profiles: dict[str, Profile] = field(default_factory=dict)
    bad: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
