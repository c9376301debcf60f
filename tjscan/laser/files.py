"""Profiles from files of other makes: columns, a profile per row, NPY, PLY, Gocator's export."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.core.files import check_file_size
from tjscan.core.frames import Array
from tjscan.core.mesh_files import read_mesh_file
from tjscan.laser.gocator import is_gocator_export, read_gocator_profiles
from tjscan.laser.profile import Profile
from tjscan.laser.text import TextTable, is_column_numbering, read_text_table

METRES_PER_UNIT: Final = {"mm": 1e-3, "um": 1e-6, "m": 1.0}
"""Metres in each unit of length."""

GROUP_COLUMNS: Final = ("profile", "frame", "index")
"""Names of a column that separates the profiles of one table."""

ENOUGH_HEIGHTS: Final = 20
"""Heights that show what is usual among them."""

CODE_DISTANCE: Final = 10.0
"""A number that stands for no point lies this many times as far from all heights as these do from
each other."""

POINT_COLUMNS: Final = ["x", "z"]
"""What two columns without names hold: no profile has two points."""

PROFILE_SUFFIXES: Final = (".csv", ".txt", ".tsv", ".dat", ".npy", ".ply")
"""Files of a folder that are read."""

MOST_BYTES: Final = 100_000_000
"""A larger file is no profile; it would fill the memory."""

SMALLEST_SPAN, LARGEST_SPAN = 2e-4, 10.0
"""Metres that a profile spans: less or more is a mistaken unit."""

MOST_HEIGHT_OVER_WIDTH: Final = 5.0
"""Range of heights over width of a profile: more is a mistaken scale or pitch."""

OFF_PLANE_TOLERANCE: Final = 1e-6
"""Metres that a point of a profile may lie off the laser plane."""

ASSUMED_MID_RANGE: Final = 0.240
"""Distance of mid-range from the sensor where nothing is stated, in metres (assumption)."""

NOTED_ZERO_SHARE: Final = 0.02
"""Share of heights that are exactly zero, among others near it, that is worth a note."""


@dataclass(frozen=True, slots=True)
class ProfileFormat:
    """What the user states of a profile file: unit, pitch, invalid values, scale of heights.

    Parameters
    ----------
    unit : str, optional
        One of `METRES_PER_UNIT`, where the names of the columns don't state it.
    pitch : float, optional
        Distance of neighbouring columns of a matrix, or of points without an x, in that unit.
    invalid : tuple of float
        Values that stand for no point, beside NaN and nothing. Zero does, too, where it lies far
        from all other heights.
    z_scale : float
        What one of the file's numbers is in that unit; negative where heights grow towards the
        sensor.
    z_offset : float, optional
        Distance from the sensor, in that unit, where the file's height is zero. Without it
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


def read_profiles(file: Path, form: ProfileFormat) -> FileProfiles:
    """Read every profile in a file, or in the files of a folder; what is bad is named.

    Parameters
    ----------
    file : Path
        Text whose first line names columns x and z (and profile, where there are many); text
        with a profile per row, with or without a line of column numbers; NPY with either; PLY
        with points in the x-z plane; or a Gocator's exported recording. Text is separated by
        commas, semicolons, tabs or blanks.
    form : ProfileFormat
        What the file does not state.

    Raises
    ------
    ConfigurationError
        If the file is missing, too large, not text, or lacks a unit, a pitch or a column; or if
        its numbers can only be of another unit.
    """
    if form.unit is not None and form.unit not in METRES_PER_UNIT:
        known = ", ".join(METRES_PER_UNIT)
        raise ConfigurationError(f"unknown unit {form.unit!r}; one of {known}", key="units")
    for key, value in (("--z-scale", form.z_scale), ("--z-offset", form.z_offset or 0.0)):
        if not math.isfinite(value) or (key == "--z-scale" and value == 0):
            raise ConfigurationError(f"must be a number (found {value})", key=key)
    if file.is_dir():
        return _read_folder(file, form)
    table = _read_file(file, form)
    _check_unit(file, table.profiles.values())
    _check_scale(file, table.profiles.values())
    return table


def flip_heights(profile: Profile) -> Profile:
    """The profile that heights of the other sign would have given, as far from the sensor."""
    low, high = np.nanmin(profile.z_s), np.nanmax(profile.z_s)
    return Profile(profile.x_s, low + high - profile.z_s, profile.intensity, profile.time)


def _read_folder(folder: Path, form: ProfileFormat) -> FileProfiles:
    """The profiles of all files in a folder, by name."""
    together = FileProfiles()
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() not in PROFILE_SUFFIXES:
            continue
        try:
            table = read_profiles(file, form)
        except ConfigurationError as error:
            together.bad.append(f"{file.name}: {error.message}")
            continue
        for name, profile in table.profiles.items():
            own = file.name if name == file.name else f"{file.name} {name}"
            together.profiles[own] = profile
        together.bad += [f"{file.name}: {bad}" for bad in table.bad]
        together.notes += [note for note in table.notes if note not in together.notes]
    if not together.profiles:
        known = ", ".join(PROFILE_SUFFIXES)
        why = f" ({together.bad[0]})" if together.bad else ""
        raise ConfigurationError(f"holds no profile in a file {known}{why}", file=folder)
    return together


def _read_file(file: Path, form: ProfileFormat) -> FileProfiles:
    try:
        check_file_size(file, MOST_BYTES, "profiles")
        suffix = file.suffix.lower()
        if suffix == ".mcap":
            raise ConfigurationError(
                "is a recording, not a table of profiles; to read the profiles of a scan again: "
                f"tjscan reprocess {file.parent}",
                file=file,
            )
        if suffix == ".ply":
            return _read_ply(file, form)
        if suffix == ".npy":
            return _read_npy(file, form)
        return _read_text(file, read_text_table(file), form)
    except FileNotFoundError:
        near = nearest_word(file.name, [f.name for f in file.parent.glob("*")][:1000])
        raise ConfigurationError(f"there is no such file; near it: {near}", file=file) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigurationError(f"is no table of numbers: {error}", file=file) from None
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None


def _read_text(file: Path, text: TextTable, form: ProfileFormat) -> FileProfiles:
    if not text.rows:
        raise ConfigurationError("is empty", file=file)
    if is_gocator_export(text):
        return _read_gocator(text, form)
    first = text.parse_numbers(text.rows[0][1])
    if None in first:
        return _read_columns(file, text, form)
    if form.pitch is None and len(first) == len(POINT_COLUMNS):
        return _read_columns(file, replace(text, rows=((0, POINT_COLUMNS), *text.rows)), form)
    return _read_rows(file, text, form)


def _read_gocator(text: TextTable, form: ProfileFormat) -> FileProfiles:
    """Z grows towards the sensor, from mid-range, in millimetres, unless the options differ."""
    found, bad = read_gocator_profiles(text)
    offset = (
        ASSUMED_MID_RANGE
        if form.z_offset is None
        else form.z_offset * METRES_PER_UNIT[form.unit or "mm"]
    )
    sign = -form.z_scale
    profiles = {
        name: _profile(x, offset + sign * _without(height, form.invalid))
        for name, (x, height) in found.items()
    }
    return FileProfiles(profiles, bad, [] if form.z_offset is not None else [_MIDDLE_TAKEN])


_MIDDLE_TAKEN: Final = (
    f"heights count from mid-range, which is taken to be {1e3 * ASSUMED_MID_RANGE:g} mm "
    "from the sensor; --z-offset states it"
)


def _read_rows(file: Path, text: TextTable, form: ProfileFormat) -> FileProfiles:
    """A profile per row, below a line of column numbers or none."""
    first = text.parse_numbers(text.rows[0][1])
    indexed = len(first) > 2 and math.isnan(first[0] or 0.0) and is_column_numbering(first[1:])
    counted = indexed or (len(text.rows) > 1 and is_column_numbering(first))
    rows = text.rows[1:] if counted else text.rows
    start, width = rows[0][0], len(text.rows[0][1])
    table, names, heights = FileProfiles(), list[str](), list[list[float]]()
    for line, row in rows:
        name = f"row {line - start + 1}"
        values = text.parse_numbers(row)
        if len(row) != width:
            table.bad.append(f"{name}: {len(row)} columns, the first row has {width}")
        elif None in values:
            table.bad.append(f"{name}: {row[values.index(None)]!r} is no number")
        else:
            names.append(name)
            heights.append([v for v in values if v is not None][1 if indexed else 0 :])
    if heights:
        _add_matrix(file, table, names, np.array(heights), form)
    return table


def _add_matrix(
    file: Path, table: FileProfiles, names: Sequence[str], heights: Array, form: ProfileFormat
) -> None:
    """Add profiles of heights, shape (m, n), at columns a pitch apart, x = 0 in the middle."""
    scale = _scale(file, form.unit, "a matrix of profiles")
    x = scale * _pitched(file, heights.shape[1], form, "a matrix of profiles")
    z = _heights(heights, scale, form, table)
    for name, row in zip(names, z, strict=True):
        table.profiles[name] = _profile(x, row)


def _pitched(file: Path, count: int, form: ProfileFormat, what: str) -> Array:
    """X of columns a pitch apart, in the file's unit."""
    if form.pitch is None:
        raise ConfigurationError(
            f"{what} needs the distance of its columns: --pitch. If its rows are points, name "
            "the columns in a first line: x_mm,z_mm",
            file=file,
        )
    if not 0 < form.pitch < math.inf:
        raise ConfigurationError(f"must be a positive number (found {form.pitch})", key="--pitch")
    return np.asarray(form.pitch * (np.arange(count) - (count - 1) / 2))


def _read_columns(file: Path, text: TextTable, form: ProfileFormat) -> FileProfiles:
    """A point per row, in columns x and z; a column `GROUP_COLUMNS` separates the profiles."""
    (header, first), *rows = text.rows
    names = [cell.lower() for cell in first]
    z_at, z_unit = _column(file, names, "z")
    pitched = form.pitch is not None and not any(_is_axis(name, "x") for name in names)
    x_at, x_unit = (z_at, z_unit) if pitched else _column(file, names, "x")
    x_scale, z_scale = (
        _scale(file, unit or form.unit, "a column without a unit in its name")
        for unit in (x_unit, z_unit)
    )
    group_at = next((names.index(name) for name in GROUP_COLUMNS if name in names), None)
    table, points = FileProfiles(), dict[str, list[tuple[float, float]]]()
    for line, row in rows:
        name = f"row {line - header + 1}"
        if len(row) != len(names):
            table.bad.append(f"{name}: {len(row)} columns, the header has {len(names)}")
            continue
        x, z = text.parse_number(row[x_at]), text.parse_number(row[z_at])
        if x is None or z is None:
            table.bad.append(f"{name}: {row[x_at if x is None else z_at]!r} is no number")
            continue
        group = file.name if group_at is None else f"{names[group_at]} {row[group_at]}"
        points.setdefault(group, []).append((x, z))
    if not points:
        return table
    together = np.concatenate([np.array(values) for values in points.values()])
    together[:, 0] = _without(together[:, 0], form.invalid)
    z_s = _heights(together[:, 1], z_scale, form, table)
    ends = np.cumsum([len(values) for values in points.values()])
    for name, end, values in zip(points, ends, points.values(), strict=True):
        part = slice(end - len(values), end)
        x_s = together[part, 0]
        if pitched:
            x_s = _pitched(file, len(values), form, "a table without a column x")
        table.profiles[name] = _profile(x_scale * x_s, z_s[part])
    return table


def _read_npy(file: Path, form: ProfileFormat) -> FileProfiles:
    """Heights, shape (n,) or (m, n), or points x and z, shape (n, 2) or (m, n, 2)."""
    try:
        # Mapped, an array has no more elements than its file holds.
        found = np.lib.format.open_memmap(file, mode="r")
    except OSError:
        raise
    except Exception as error:  # its header is read as Python, which stumbles over many things
        raise ConfigurationError(f"is no array of numbers: {error}", file=file) from None
    if not isinstance(found, np.ndarray) or found.dtype.kind not in "iuf" or found.size == 0:
        raise ConfigurationError("is no array of numbers", file=file)
    values, table = found.astype(float), FileProfiles()
    values[np.isinf(values)] = np.nan
    names = [f"row {i + 1}" for i in range(len(values))]
    if values.ndim == 1:
        _add_matrix(file, table, [file.name], values[None], form)
    elif values.ndim == 2 and values.shape[1] != 2:
        _add_matrix(file, table, names, values, form)
    elif values.ndim in (2, 3) and values.shape[-1] == 2:
        scale = _scale(file, form.unit, "an array")
        several = values if values.ndim == 3 else values[None]
        z = _heights(several[..., 1], scale, form, table)
        x = scale * _without(several[..., 0], form.invalid)
        for i, name in enumerate(names if values.ndim == 3 else [file.name]):
            table.profiles[name] = _profile(x[i], z[i])
    else:
        raise ConfigurationError(f"an array of shape {values.shape} is no profile", file=file)
    return table


def _read_ply(file: Path, form: ProfileFormat) -> FileProfiles:
    scale = _scale(file, form.unit, "a PLY")
    try:
        points, _ = read_mesh_file(file)
    except ConfigurationError:
        raise
    except Exception as error:  # trimesh raises whatever its parser stumbles on
        raise ConfigurationError(f"is no PLY with points: {error}", file=file) from None
    if len(points) and not np.nanmax(np.abs(scale * points[:, 1])) <= OFF_PLANE_TOLERANCE:
        raise ConfigurationError(
            "its points lie off the plane y = 0, so it is no profile in a sensor's frame", file=file
        )
    table = FileProfiles()
    z_s = _heights(points[:, 2], scale, form, table)
    table.profiles[file.name] = _profile(scale * points[:, 0], z_s)
    return table


def _profile(x_s: Array, z_s: Array) -> Profile:
    """A profile whose points have both coordinates or neither."""
    gone = np.isnan(x_s) | np.isnan(z_s)
    return Profile(np.where(gone, np.nan, x_s), np.where(gone, np.nan, z_s))


def _heights(values: Array, scale: float, form: ProfileFormat, table: FileProfiles) -> Array:
    """Distances from the sensor in metres of a file's numbers, NaN for no point.

    Heights of either sign count from mid-range. A zero among them is a height; far from all
    others it is what sensors write where they see nothing.
    """
    z = _without(values, form.invalid)
    zero = z == 0
    others = z[~zero & np.isfinite(z)]
    if _is_apart(others):
        z = np.where(zero, np.nan, z)
    elif zero.mean() > NOTED_ZERO_SHARE:
        table.notes.append(
            f"{100 * zero.mean():.0f} % of the heights are exactly 0; if that means no point, "
            "state --invalid 0"
        )
    _check_codes(z)
    z = scale * form.z_scale * z
    if form.z_offset is not None:
        return np.asarray(z + scale * form.z_offset)
    if np.nanmin(z, initial=np.inf) > 0:
        return z
    table.notes.append(_MIDDLE_TAKEN)
    # Nothing lies behind the sensor, however long its range.
    return np.asarray(z + max(ASSUMED_MID_RANGE, -1.2 * float(np.nanmin(z))))


def _check_codes(heights: Array) -> None:
    """Refuse heights among which a number comes again and again far from all others."""
    known = heights[np.isfinite(heights)]
    if known.size < ENOUGH_HEIGHTS:
        return
    for code in (known.min(), known.max()):
        others = known[known != code]
        share = 1 - others.size / known.size
        if others.size and share > NOTED_ZERO_SHARE:
            away = np.abs(others - code).min()
            if away > CODE_DISTANCE * max(np.ptp(others), 1e-9 * away):
                raise ConfigurationError(
                    f"{100 * share:.0f} % of the heights are exactly {code:g}, far from all "
                    f"others; if that means no point, state --invalid {code:g}"
                )


def _is_apart(others: Array) -> bool:
    """Whether zero is farther from numbers, a few strays aside, than they are from each other."""
    if not len(others):
        return False
    low, high = np.percentile(others, (5, 95))
    return bool(min(abs(low), abs(high)) > high - low and (low > 0) == (high > 0))


def _column(file: Path, names: Sequence[str], axis: str) -> tuple[int, str | None]:
    """Place of a column such as x, x_s or x_mm, and the unit in its name."""
    for i, name in enumerate(names):
        match = _is_axis(name, axis)
        if match:
            return i, match[1]
    found = ", ".join(names[:12])
    raise ConfigurationError(f"has no column {axis} (found: {found[:200]!r})", file=file)


def _is_axis(name: str, axis: str) -> re.Match[str] | None:
    units = "|".join(METRES_PER_UNIT)
    return re.fullmatch(rf"{axis}(?:_s)?(?:[_ ]*[\[(]?({units})[\])]?)?", name)


def _check_unit(file: Path, profiles: Iterable[Profile]) -> None:
    """Refuse profiles of a size that only a mistaken unit explains."""
    spans = [np.ptp(p.points_s[:, [0, 2]], axis=0).max() for p in profiles if p.valid.any()]
    if spans and not SMALLEST_SPAN <= (span := float(np.median(spans))) <= LARGEST_SPAN:
        raise ConfigurationError(
            f"its profiles span {1e3 * span:.3g} mm: is the unit right? It is stated in the names "
            "of the columns (x_mm, x_um, x_m) or with --units",
            file=file,
        )


def _check_scale(file: Path, profiles: Iterable[Profile]) -> None:
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


def _scale(file: Path, unit: str | None, what: str) -> float:
    if unit is None:
        raise ConfigurationError(f"{what} needs its unit: --units mm, um or m", file=file)
    return METRES_PER_UNIT[unit]


def _without(values: Array, invalid: Sequence[float]) -> Array:
    """The same values with NaN for the codes of no point."""
    return np.where(np.isin(values, invalid), np.nan, values)
