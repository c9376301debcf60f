"""Profiles from files of other makes: columns, a matrix with a profile per row, or a PLY."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError, nearest
from tjscan.core.files import check_size
from tjscan.core.frames import Array
from tjscan.laser.profile import Profile

UNITS: Final = {"mm": 1e-3, "um": 1e-6, "m": 1.0}
"""Metres in each unit of length."""

GROUPS: Final = ("profile", "frame", "index")
"""Names of a column that tells profiles in one table apart."""

MOST_BYTES: Final = 100_000_000
"""A larger file is no profile; it would fill the memory."""

SMALLEST, LARGEST = 2e-4, 10.0
"""Metres that a profile spans: less or more is a mistaken unit."""

PLANE: Final = 1e-6
"""Metres that a point of a profile may lie off the laser plane."""


@dataclass(frozen=True, slots=True)
class ProfileFormat:
    """What a file does not say of itself.

    Parameters
    ----------
    unit : str, optional
        One of `UNITS`, where the names of the columns don't tell it.
    pitch : float, optional
        Distance of neighbouring columns of a matrix, in that unit.
    invalid : tuple of float
        Values that stand for no point, beside NaN and nothing.
    """

    unit: str | None = None
    pitch: float | None = None
    invalid: tuple[float, ...] = ()


@dataclass(slots=True)
class ProfileTable:
    """What a file holds.

    Parameters
    ----------
    profiles : dict of str to Profile
        By name: ``row 3``, ``profile 12``, or the file's name.
    bad : list of str
        What could not be read, and why.
    """

    profiles: dict[str, Profile] = field(default_factory=dict)
    bad: list[str] = field(default_factory=list)


def read_profiles(file: Path, form: ProfileFormat) -> ProfileTable:
    """Read every profile in a file; what is bad is named and left out.

    Parameters
    ----------
    file : Path
        CSV with a header that names columns x and z (and profile, where there are many); CSV
        without a header, a profile per row; or PLY with points in the x-z plane.
    form : ProfileFormat
        What the file does not say of itself.

    Raises
    ------
    ConfigurationError
        If the file is missing, too large, not text, or lacks a unit, a pitch or a column.
    """
    if form.unit is not None and form.unit not in UNITS:
        known = ", ".join(UNITS)
        raise ConfigurationError(f"unknown unit {form.unit!r}; one of {known}", key="units")
    try:
        check_size(file, MOST_BYTES, "profiles")
        if file.suffix.lower() == ".ply":
            table = _read_ply(file, form)
        else:
            with file.open(newline="", encoding="utf-8-sig") as stream:
                table = _read_text(file, csv.reader(stream), form)
    except FileNotFoundError:
        near = nearest(file.name, [f.name for f in file.parent.glob("*")][:1000])
        raise ConfigurationError(f"there is no such file; near it: {near}", file=file) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigurationError(f"is no table of numbers: {error}", file=file) from None
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None
    _check_unit(file, table.profiles.values())
    return table


def _read_text(file: Path, rows: Iterable[list[str]], form: ProfileFormat) -> ProfileTable:
    # A row of empty cells is a missing point; an empty line is nothing.
    numbered = ((i, row) for i, row in enumerate(rows, start=1) if row[1:] or "".join(row).strip())
    first = next(numbered, None)
    if first is None:
        raise ConfigurationError("is empty", file=file)
    number, row = first
    if all(_number(cell) is not None for cell in row):
        return _read_matrix(file, [(number, row), *numbered], form)
    return _read_columns(file, [cell.strip().lower() for cell in row], numbered, form)


def _read_matrix(
    file: Path, rows: Sequence[tuple[int, list[str]]], form: ProfileFormat
) -> ProfileTable:
    """A profile per row: z at columns a pitch apart, x = 0 in the middle."""
    scale = _scale(file, form.unit, "a matrix of profiles")
    if form.pitch is None:
        raise ConfigurationError(
            "a matrix of profiles needs the distance of its columns: --pitch. If its rows are "
            "points, name the columns in a first line: x_mm,z_mm",
            file=file,
        )
    if not 0 < form.pitch < math.inf:
        raise ConfigurationError(f"must be a positive number (found {form.pitch})", key="--pitch")
    table, width = ProfileTable(), len(rows[0][1])
    x = scale * form.pitch * (np.arange(width) - (width - 1) / 2)
    for number, row in rows:
        values = [_number(cell) for cell in row]
        if len(row) != width:
            table.bad.append(f"row {number}: {len(row)} columns, the first row has {width}")
        elif None in values:
            word = row[values.index(None)].strip()
            table.bad.append(f"row {number}: {word!r} is no number")
        else:
            z = _without(np.array(values, dtype=float), form.invalid) * scale
            table.profiles[f"row {number}"] = Profile(np.where(np.isnan(z), np.nan, x), z)
    return table


def _read_columns(
    file: Path, names: list[str], rows: Iterable[tuple[int, list[str]]], form: ProfileFormat
) -> ProfileTable:
    """A point per row, in columns x and z; a column `GROUPS` tells profiles apart."""
    (x_at, x_unit), (z_at, z_unit) = (_column(file, names, axis) for axis in "xz")
    scales = [
        _scale(file, unit or form.unit, "a column without a unit in its name")
        for unit in (x_unit, z_unit)
    ]
    group_at = next((names.index(name) for name in GROUPS if name in names), None)
    table, points = ProfileTable(), dict[str, list[tuple[float, float]]]()
    for number, row in rows:
        if len(row) != len(names):
            table.bad.append(f"row {number}: {len(row)} columns, the header has {len(names)}")
            continue
        x, z = _number(row[x_at]), _number(row[z_at])
        if x is None or z is None:
            word = row[x_at if x is None else z_at].strip()
            table.bad.append(f"row {number}: {word!r} is no number")
            continue
        name = file.name if group_at is None else f"{names[group_at]} {row[group_at].strip()}"
        points.setdefault(name, []).append((x, z))
    for name, values in points.items():
        xz = _without(np.array(values), form.invalid) * scales
        table.profiles[name] = Profile(xz[:, 0], xz[:, 1])
    return table


def _read_ply(file: Path, form: ProfileFormat) -> ProfileTable:
    import trimesh

    scale = _scale(file, form.unit, "a PLY")
    try:
        points = np.asarray(trimesh.load(file, process=False).vertices, dtype=float) * scale
    except Exception as error:  # trimesh raises whatever its parser stumbles on
        raise ConfigurationError(f"is no PLY with points: {error}", file=file) from None
    if len(points) and not np.nanmax(np.abs(points[:, 1])) <= PLANE:
        raise ConfigurationError(
            "its points lie off the plane y = 0, so it is no profile in a sensor's frame", file=file
        )
    return ProfileTable({file.name: Profile(points[:, 0], points[:, 2])})


def _column(file: Path, names: Sequence[str], axis: str) -> tuple[int, str | None]:
    """Place of a column such as x, x_s or x_mm, and the unit in its name."""
    for i, name in enumerate(names):
        match = re.fullmatch(rf"{axis}(?:_s)?(?:[_ ]*[\[(]?({'|'.join(UNITS)})[\])]?)?", name)
        if match:
            return i, match[1]
    found = ", ".join(names[:12])
    hint = "; separate columns by commas" if any(mark in found for mark in ";\t") else ""
    raise ConfigurationError(f"has no column {axis} (found: {found[:200]!r}){hint}", file=file)


def _check_unit(file: Path, profiles: Iterable[Profile]) -> None:
    """Refuse profiles of a size that only a mistaken unit explains."""
    spans = [np.ptp(p.points_s[:, [0, 2]], axis=0).max() for p in profiles if p.valid.any()]
    if spans and not SMALLEST <= (span := float(np.median(spans))) <= LARGEST:
        raise ConfigurationError(
            f"its profiles span {1e3 * span:.3g} mm: is the unit right? It is stated in the names "
            "of the columns (x_mm, x_um, x_m) or with --units",
            file=file,
        )


def _scale(file: Path, unit: str | None, what: str) -> float:
    if unit is None:
        raise ConfigurationError(f"{what} needs its unit: --units mm, um or m", file=file)
    return UNITS[unit]


def _number(cell: str) -> float | None:
    """A finite number, NaN for nothing, None for anything else."""
    text = cell.strip()
    if not text:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        return None
    return math.nan if math.isinf(value) else value


def _without(values: Array, invalid: Sequence[float]) -> Array:
    """The same values with NaN for the codes of no point."""
    return np.where(np.isin(values, invalid), np.nan, values)
