"""What a profile file means: as the user states it, in metres from the sensor, and mistakes."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.core.frames import Array
from tjscan.laser.profile import Profile

METRES_PER_UNIT: Final = {"mm": 1e-3, "um": 1e-6, "m": 1.0}
"""Metres in each unit of length."""

ASSUMED_MID_RANGE: Final = 0.240
"""Distance of mid-range from the sensor if nothing is stated, in metres (assumption)."""


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
    other_files : tuple of str
        Files of a folder that hold other things than profiles.
    """

    unit: str | None = None
    pitch: float | None = None
    invalid: tuple[float, ...] = ()
    z_scale: float = 1.0
    z_offset: float | None = None
    other_files: tuple[str, ...] = ()


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
    assumed_units : set of str
        Units that were assumed.
    """

    profiles: dict[str, Profile] = field(default_factory=dict)
    bad: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    assumed_units: set[str] = field(default_factory=set)


MIN_CHECKED_HEIGHTS: Final = 20
"""Heights that show what is usual among them."""

INVALID_CODE_DISTANCE_RATIO: Final = 10.0
"""A code of no point is this many times as far from all heights as these are from each other."""

SMALLEST_SPAN, LARGEST_SPAN = 2e-4, 10.0
"""Metres that a profile spans: less or more is a mistaken unit."""

PLAUSIBLE_WIDTH: Final = (4e-3, 2.0)
"""Metres that the profile of a line laser is wide, from and to: no two units fit."""

SMALLEST_DISTANCE, LARGEST_DISTANCE = 1e-3, 3.0
"""Metres that what a line laser sees is from it, or from the middle of its range."""

MOST_HEIGHT_OVER_WIDTH: Final = 5.0
"""Range of heights over width of a profile: more is a mistaken scale or pitch."""

NOTED_ZERO_SHARE: Final = 0.02
"""Share of heights that are exactly zero, among others near it, that is worth a note."""

MID_RANGE_NOTE: Final = (
    f"heights count from mid-range, which is taken to be {1e3 * ASSUMED_MID_RANGE:g} mm "
    "from the sensor; --z-offset states it"
)


@contextmanager
def explain_unreadable_table(file: Path) -> Iterator[None]:
    """Turn errors of reading a table of numbers into a `ConfigurationError` that names its file."""
    try:
        yield
    except ConfigurationError as error:
        raise ConfigurationError(error.message, file=error.file or file, key=error.key) from None
    except FileNotFoundError:
        near = nearest_word(file.name, [f.name for f in file.parent.glob("*")][:1000])
        raise ConfigurationError(f"there is no such file; near it: {near}", file=file) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigurationError(f"is no table of numbers: {error}", file=file) from None
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None
    except ValueError as error:
        raise ConfigurationError(str(error), file=file) from None


def heights_from_sensor(
    values: Array, scale: float, form: ProfileFormat, table: FileProfiles
) -> Array:
    """Distances from the sensor in metres of a file's numbers, NaN for no point.

    Heights of either sign count from mid-range. A zero among them is a height; far from all
    others it is what sensors write where they see nothing.
    """
    z = without_invalid_codes(values, form.invalid)
    zero = z == 0
    others = z[~zero & np.isfinite(z)]
    if _is_zero_apart(others):
        z = np.where(zero, np.nan, z)
    elif zero.mean() > NOTED_ZERO_SHARE:
        table.notes.append(
            f"{100 * zero.mean():.0f} % of the heights are exactly 0; if that means no point, "
            "state --invalid 0"
        )
    _check_invalid_codes(z)
    z = scale * form.z_scale * z
    if form.z_offset is not None:
        return np.asarray(z + scale * form.z_offset)
    if np.nanmin(z, initial=np.inf) > 0:
        return z
    table.notes.append(MID_RANGE_NOTE)
    # Nothing is behind the sensor, however long its range.
    return np.asarray(z + max(ASSUMED_MID_RANGE, -1.2 * float(np.nanmin(z))))


def profile_of_columns(x_s: Array, z_s: Array) -> Profile:
    """A profile whose points have both coordinates or neither."""
    gone = np.isnan(x_s) | np.isnan(z_s)
    return Profile(np.where(gone, np.nan, x_s), np.where(gone, np.nan, z_s))


def without_invalid_codes(values: Array, invalid: Sequence[float]) -> Array:
    """The same values with NaN for the codes of no point."""
    return np.where(np.isin(values, invalid), np.nan, values)


def metres_per_number(
    x: Array, heights: Array, form: ProfileFormat, table: FileProfiles, what: str
) -> float:
    """Metres of one of a file's numbers, as stated, or as lasers are wide and far away.

    Whole numbers may be a sensor's counts, of any length: their unit has to be stated.

    Raises
    ------
    ConfigurationError
        If its unit is not stated, and none or several are plausible.
    """
    if form.unit is not None:
        return METRES_PER_UNIT[form.unit]
    x, z = (without_invalid_codes(values, form.invalid).ravel() for values in (x, heights))
    z = form.z_scale * z[np.isfinite(z) & (z != 0)]
    if not len(z):
        return 1.0  # of no point
    if np.isfinite(x).any():
        low, high = np.nanpercentile(x, (1, 99))
        nearest, farthest = np.percentile(z, (1, 99))
        counts = form.z_scale == 1 and bool(np.all(z == np.round(z)))
        for unit, metres in METRES_PER_UNIT.items():
            wide = PLAUSIBLE_WIDTH[0] <= metres * (high - low) <= PLAUSIBLE_WIDTH[1]
            far = metres * max(-nearest, farthest) <= LARGEST_DISTANCE
            near = nearest > 0 and metres * nearest < SMALLEST_DISTANCE
            if wide and far and not near and not counts:
                table.assumed_units.add(unit)
                return metres
    raise ConfigurationError(
        f"{what} needs its unit: --units mm, um or m; whole numbers may also be counts of --z-scale"
    )


def check_unit(file: Path, profiles: Iterable[Profile]) -> None:
    """Refuse profiles of a size that only a mistaken unit explains."""
    spans = [np.ptp(p.points_s[:, [0, 2]], axis=0).max() for p in profiles if p.valid.any()]
    if spans and not SMALLEST_SPAN <= (span := float(np.median(spans))) <= LARGEST_SPAN:
        raise ConfigurationError(
            f"its profiles span {1e3 * span:.3g} mm: is the unit right? It is stated in the names "
            "of the columns (x_mm, x_um, x_m) or with --units",
            file=file,
        )


def check_height_scale(file: Path, profiles: Iterable[Profile]) -> None:
    """Refuse heights that only a mistaken scale, or a mistaken pitch, explains."""
    steep = []
    for profile in profiles:
        points = profile.points_s
        if len(points) > 2:
            low, high = np.percentile(points[:, 2], (5, 95))
            steep.append((high - low) / max(np.ptp(points[:, 0]), 1e-12))
    if steep and (ratio := float(np.median(steep))) > MOST_HEIGHT_OVER_WIDTH:
        raise ConfigurationError(
            f"heights span {ratio:.3g} times the width of the profiles: are their units the "
            "same? --pitch states the distance of columns, --z-scale what one of the heights' "
            "numbers is",
            file=file,
        )


def _check_invalid_codes(heights: Array) -> None:
    """Refuse heights among which a number comes again and again far from all others."""
    known = heights[np.isfinite(heights)]
    if known.size < MIN_CHECKED_HEIGHTS:
        return
    for code in (known.min(), known.max()):
        others = known[known != code]
        share = 1 - others.size / known.size
        if others.size and share > NOTED_ZERO_SHARE:
            away = np.abs(others - code).min()
            if away > INVALID_CODE_DISTANCE_RATIO * max(np.ptp(others), 1e-9 * away):
                raise ConfigurationError(
                    f"{100 * share:.0f} % of the heights are exactly {code:g}, far from all "
                    f"others; if that means no point, state --invalid {code:g}"
                )


def _is_zero_apart(others: Array) -> bool:
    """Whether zero is farther from numbers, a few strays aside, than they are from each other."""
    if not len(others):
        return False
    low, high = np.percentile(others, (5, 95))
    return bool(min(abs(low), abs(high)) > high - low and (low > 0) == (high > 0))
