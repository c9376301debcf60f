"""Profiles from text, a point or a profile per row, and from arrays and clouds (NPY, PLY)."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.core.mesh_files import read_mesh_file
from tjscan.laser.files.format import (
    ASSUMED_MID_RANGE,
    METRES_PER_UNIT,
    MIDDLE_TAKEN,
    FileProfiles,
    ProfileFormat,
    heights_from_sensor,
    metres_per_number,
    profile_of_columns,
    without_codes,
)
from tjscan.laser.files.text import (
    TextTable,
    is_column_numbering,
    is_gocator_export,
    read_gocator_profiles,
)

OFF_PLANE_TOLERANCE: Final = 1e-6
"""Metres that a point of a profile may be off the laser plane."""


def read_npy(file: Path, form: ProfileFormat) -> FileProfiles:
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
        add_matrix(file, table, [file.name], values[None], form)
    elif values.ndim == 2 and values.shape[1] != 2:
        add_matrix(file, table, names, values, form)
    elif values.ndim in (2, 3) and values.shape[-1] == 2:
        scale = metres_per_number(file, form.unit, "an array")
        several = values if values.ndim == 3 else values[None]
        z = heights_from_sensor(several[..., 1], scale, form, table)
        x = scale * without_codes(several[..., 0], form.invalid)
        for i, name in enumerate(names if values.ndim == 3 else [file.name]):
            table.profiles[name] = profile_of_columns(x[i], z[i])
    else:
        raise ConfigurationError(f"an array of shape {values.shape} is no profile", file=file)
    return table


def read_ply_profile(file: Path, form: ProfileFormat) -> FileProfiles:
    """The profile that a PLY holds, its points in the plane y = 0.

    Raises
    ------
    ConfigurationError
        If it is no PLY with points, or they are off that plane.
    """
    scale = metres_per_number(file, form.unit, "a PLY")
    try:
        points, _ = read_mesh_file(file)
    except ConfigurationError:
        raise
    except Exception as error:  # trimesh raises whatever its parser stumbles on
        raise ConfigurationError(f"is no PLY with points: {error}", file=file) from None
    if len(points) and not np.nanmax(np.abs(scale * points[:, 1])) <= OFF_PLANE_TOLERANCE:
        message = "its points lie off the plane y = 0, so it is no profile in a sensor's frame"
        raise ConfigurationError(message, file=file)
    table = FileProfiles()
    z_s = heights_from_sensor(points[:, 2], scale, form, table)
    table.profiles[file.name] = profile_of_columns(scale * points[:, 0], z_s)
    return table


def add_matrix(
    file: Path, table: FileProfiles, names: Sequence[str], heights: Array, form: ProfileFormat
) -> None:
    """Add profiles of heights, shape (m, n), at columns a pitch apart, x = 0 in the middle."""
    scale = metres_per_number(file, form.unit, "a matrix of profiles")
    x = scale * places_of_columns(file, heights.shape[1], form, "a matrix of profiles")
    z = heights_from_sensor(heights, scale, form, table)
    for name, row in zip(names, z, strict=True):
        table.profiles[name] = profile_of_columns(x, row)


def places_of_columns(file: Path, count: int, form: ProfileFormat, what: str) -> Array:
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


GROUP_COLUMNS: Final = ("profile", "frame", "index")
"""Names of a column that separates the profiles of one table."""

POINT_COLUMNS: Final = ["x", "z"]
"""What two columns without names hold: no profile has two points."""


def read_text(file: Path, text: TextTable, form: ProfileFormat) -> FileProfiles:
    """The profiles of a table, whatever of the three kinds it is.

    Raises
    ------
    ConfigurationError
        If it is empty, or lacks a unit, a pitch or a column.
    """
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
    offset, notes = ASSUMED_MID_RANGE, [MIDDLE_TAKEN]
    if form.z_offset is not None:
        offset, notes = form.z_offset * METRES_PER_UNIT[form.unit or "mm"], []
    profiles = {
        name: profile_of_columns(x, offset + -form.z_scale * without_codes(height, form.invalid))
        for name, (x, height) in found.items()
    }
    return FileProfiles(profiles, bad, notes)


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
        add_matrix(file, table, names, np.array(heights), form)
    return table


def _read_columns(file: Path, text: TextTable, form: ProfileFormat) -> FileProfiles:
    """A point per row, in columns x and z; a column `GROUP_COLUMNS` separates the profiles."""
    (header, first), *rows = text.rows
    names = [cell.lower() for cell in first]
    z_at, z_unit = _find_column(file, names, "z")
    pitched = form.pitch is not None and not any(_is_axis(name, "x") for name in names)
    x_at, x_unit = (z_at, z_unit) if pitched else _find_column(file, names, "x")
    x_scale, z_scale = (
        metres_per_number(file, unit or form.unit, "a column without a unit in its name")
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
    together[:, 0] = without_codes(together[:, 0], form.invalid)
    z_s = heights_from_sensor(together[:, 1], z_scale, form, table)
    ends = np.cumsum([len(values) for values in points.values()])
    for name, end, values in zip(points, ends, points.values(), strict=True):
        part = slice(end - len(values), end)
        x_s = together[part, 0]
        if pitched:
            x_s = places_of_columns(file, len(values), form, "a table without a column x")
        table.profiles[name] = profile_of_columns(x_scale * x_s, z_s[part])
    return table


def _find_column(file: Path, names: Sequence[str], axis: str) -> tuple[int, str | None]:
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
