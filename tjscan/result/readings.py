"""What was read in each of many profiles: a groove, or why there is none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove.read import fit_groove, read_groove
from tjscan.groove.section import GrooveSection
from tjscan.groove.settings import TEE_GROOVE, GrooveSettings
from tjscan.laser.profile import Profile
from tjscan.result.section import MEASURE_FIELDS

DRAWN_SIDE_POINTS: Final = 24
"""Points of a fitted side in a picture."""


@dataclass(frozen=True, slots=True, eq=False)
class ProfileReading:
    """Groove read in one profile: its corners and section, or why none was found.

    Parameters
    ----------
    name : str
        Which profile.
    profile : Profile
        The profile.
    points_s : ndarray, shape (k, 3)
        Corners in frame s, metres; with the ends for a tee; empty if refused.
    section : GrooveSection or None
        The section of a tee.
    refusal : GrooveNotFound or None
        Why nothing was read.
    """

    name: str
    profile: Profile
    points_s: Array
    section: GrooveSection | None = None
    refusal: GrooveNotFound | None = None

    @property
    def found_in_words(self) -> str:
        """The form and the conditions of a section, or why there is none; empty for butt joints."""
        if self.refusal is not None:
            return self.refusal.reason
        found = () if self.section is None else (self.section.model, *self.section.conditions)
        return ", ".join(found)

    @property
    def corners_seen(self) -> tuple[bool, ...]:
        """Which of the corners show in the profile, one for each of `points_s`."""
        absent = () if self.section is None else self.section.absent
        return tuple(f"p{i}" not in absent for i in range(1, len(self.points_s) + 1))


def measure_grooves(
    profiles: Mapping[str, Profile], settings: GrooveSettings
) -> Iterator[ProfileReading]:
    """Read the groove in every profile; if none is found, the reading states why.

    Parameters
    ----------
    profiles : mapping of str to Profile
        By their names.
    settings : GrooveSettings
        How to read them.
    """
    for name, profile in profiles.items():
        try:
            if settings.model is TEE_GROOVE:
                section = read_groove(profile, settings)
                yield ProfileReading(name, profile, section.points_s, section)
            else:
                corners = fit_groove(profile, settings).fitted.corners
                yield ProfileReading(name, profile, np.insert(corners, 1, 0.0, axis=1))
        except GrooveNotFound as refusal:
            yield ProfileReading(name, profile, np.empty((0, 3)), refusal=refusal)


def fitted_side_polylines(profile: Profile, settings: GrooveSettings) -> list[Array]:
    """Polylines of the sides fitted to a profile, for pictures: x and z in metres, (n, 2) each.

    Parameters
    ----------
    profile : Profile
        In which a groove was found.
    settings : GrooveSettings
        How it was read.

    Returns
    -------
    list of ndarray
        From the first side to the last, each as far as its points reach; empty if none fit.
    """
    try:
        fitted = fit_groove(profile, settings).fitted
    except GrooveNotFound:
        return []
    sides = []
    for number, curve in enumerate(fitted.curves):
        along = fitted.kept_along(number)
        if len(along):
            reach = np.linspace(along.min(), along.max(), DRAWN_SIDE_POINTS)
            sides.append(np.array([curve.point_on_curve(float(s)) for s in reach]))
    return sides


def reading_to_dict(reading: ProfileReading) -> dict[str, Any]:
    """Convert a profile's reading to a dict for JSON, in millimetres and degrees.

    Parameters
    ----------
    reading : ProfileReading
        What was read in one profile.
    """
    fields: dict[str, Any] = {"name": reading.name, "found": reading.refusal is None}
    if reading.refusal is not None:
        return fields | {"reason": reading.refusal.reason, "detail": reading.refusal.detail}
    fields["points_mm"] = (1e3 * reading.points_s[:, [0, 2]]).round(5).tolist()
    if (section := reading.section) is not None:
        fields["corner_sigma_mm"] = (1e3 * np.sqrt(np.diag(section.covariance_s))).round(5).tolist()
        fields |= {name: [value, sigma] for name, value, sigma in measures_with_sigmas(section)}
        fields["work_angle_deg"] = float(np.degrees(section.work_angle))
        fields["rms_mm"] = 1e3 * section.rms
        fields["model"] = section.model
        fields["model_probability"] = section.model_probability
        fields["conditions"] = list(section.conditions)
        fields["absent_corners"] = list(section.absent)
        if np.isfinite(section.root_opening):
            fields["root_opening_mm"] = 1e3 * section.root_opening
    return fields


def measures_with_sigmas(section: GrooveSection) -> list[tuple[str, float, float]]:
    """Name with unit, value and standard deviation of each measure, in millimetres and degrees.

    Parameters
    ----------
    section : GrooveSection
        As it was read.
    """
    rows = []
    sigmas = np.sqrt(np.diag(section.measure_covariance))
    for field, sigma in zip(MEASURE_FIELDS, sigmas, strict=True):
        value, factor = getattr(section, field.name), field.unit.factor
        rows.append((field.column_names()[0], float(value / factor), float(sigma / factor)))
    return rows
