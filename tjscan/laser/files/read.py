"""Profiles of a file or a folder: a point or a profile per row, NPY, PLY, Gocator's export."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.files import check_file_size
from tjscan.core.frames import Array
from tjscan.core.mesh_files import read_mesh_file
from tjscan.laser.files import format as file_format
from tjscan.laser.files.format import FileProfiles, ProfileFormat
from tjscan.laser.profile import Profile

COMMENT_MARK: Final = "#"

SEPARATOR_SAMPLE_LINES: Final = 50
"""Lines that the separator is found from."""

FEWEST_NUMBERED_COLUMNS: Final = 5
"""Shorter rows 1, 2, 3 are heights."""

LONGEST_LINE_CHARACTERS: Final = 1_000_000
"""Characters: a profile has some thousand points."""

MOST_TABLE_CELLS: Final = 3_000_000
"""Of a table: some two thousand profiles. Each takes a hundred bytes while it is read."""

_DECIMAL_COMMA: Final = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table of text cells, read from a file.

    Parameters
    ----------
    rows : tuple of (int, list of str)
        Number of the line in the file, from 1, and its cells, stripped.
    decimal_comma : bool
        Whether numbers are written with a comma.
    """

    rows: tuple[tuple[int, list[str]], ...]
    decimal_comma: bool = False

    def parse_number(self, cell: str) -> float | None:
        """Parse a cell: finite number, NaN if empty or infinite, None if no number."""
        if not cell:
            return math.nan
        try:
            value = float(cell.replace(",", ".") if self.decimal_comma else cell)
        except ValueError:
            return None
        return math.nan if math.isinf(value) else value

    def parse_numbers(self, cells: list[str]) -> list[float | None]:
        """Parse several cells, each as `parse_number` does."""
        return [self.parse_number(cell) for cell in cells]


def parse_text_table(text: str) -> TextTable:
    """Parse a table: cells between commas, semicolons, tabs or blanks; ``#`` begins a comment.

    Raises
    ------
    csv.Error
        If it holds more than `MOST_TABLE_CELLS` cells or a line of more than
        `LONGEST_LINE_CHARACTERS` characters.
    """
    lines = [
        (number, line.split(COMMENT_MARK, 1)[0])
        for number, line in enumerate(text.splitlines(), start=1)
        if not line.lstrip().startswith(COMMENT_MARK)
    ]
    lines = [(number, line) for number, line in lines if line.strip(" ")]
    separator = _find_separator([line for _, line in lines[:SEPARATOR_SAMPLE_LINES]])
    rows = tuple(_split_cells(lines, separator))
    cells = [cell for _, row in rows[:SEPARATOR_SAMPLE_LINES] for cell in row]
    return TextTable(rows, separator != "," and any(map(_DECIMAL_COMMA.fullmatch, cells)))


def _find_separator(lines: list[str]) -> str | None:
    """What separates cells; None for blanks."""
    for mark in (";", "\t"):
        if any(mark in line for line in lines):
            return mark
    # Between blanks a comma may be the decimal one.
    rows = [line.split() for line in lines if "," in line]
    are_decimal = all(len(row) > 1 and all(map(_DECIMAL_COMMA.fullmatch, row)) for row in rows)
    return None if are_decimal else ","


def _split_cells(
    lines: list[tuple[int, str]], separator: str | None
) -> Iterator[tuple[int, list[str]]]:
    left = MOST_TABLE_CELLS
    for number, line in lines:
        if len(line) > LONGEST_LINE_CHARACTERS:
            raise csv.Error(f"line {number} has more than {LONGEST_LINE_CHARACTERS} characters")
        row = line.split() if separator is None else next(csv.reader([line], delimiter=separator))
        left -= len(row)
        if left < 0:
            raise csv.Error(f"it holds more than {MOST_TABLE_CELLS} cells; split the file")
        yield number, [cell.strip() for cell in row]


def is_column_numbering(values: list[float | None]) -> bool:
    """Whether numbers count columns: 0, 1, 2 … or 1, 2, 3 …, which a few heights may, too."""
    from_zero = values == [float(i) for i in range(len(values))]
    from_one = values == [float(i) for i in range(1, len(values) + 1)]
    return (from_zero and len(values) > 1) or (from_one and len(values) >= FEWEST_NUMBERED_COLUMNS)


GOCATOR_SECTIONS = {"profile": False, "rawprofile": True}
"""Sections that hold profiles, and whether their X values are in rows."""

METRES_PER_MM = 1e-3


def is_gocator_export(table: TextTable) -> bool:
    """Whether a table is a CSV export of a Gocator sensor."""
    return any(_section_title(row) in GOCATOR_SECTIONS for _, row in table.rows)


def _gocator_coordinates(table: TextTable, bad: list[str]) -> dict[str, dict[str, Array]]:
    """X and Z of each profile in metres, by its name and the axis; what can't be read goes to bad.

    One section named ``Profile`` (even spacing) has a table whose header ends in the X positions,
    with a row of ranges per frame; one named ``RawProfile`` has two rows per frame, its X and its Z
    values. Lengths are in millimetres; Z grows towards the sensor and counts from the middle of the
    range. Columns as in LMI's user manual, chapter "Replay to CSV".

    Parameters
    ----------
    table : TextTable
        All sections of a file.
    bad : list of str
        Receives what could not be read.
    """
    raw, names = None, None
    ranges: dict[str, dict[str, Array]] = {}
    header: list[float | None] = []
    for number, row in table.rows:
        title = _section_title(row)
        if title in GOCATOR_SECTIONS:
            raw, names = GOCATOR_SECTIONS[title], None
        elif len([cell for cell in row if cell]) == 1 and table.parse_number(row[0]) is None:
            raw = None  # another section
        elif raw is not None and "axis" in (low := [cell.lower() for cell in row]):
            names = low
            header = table.parse_numbers(row[low.index("axis") + 1 :])
        elif raw is not None and names is not None:
            at = names.index("axis")
            values = table.parse_numbers(row[at + 1 :])
            axis = row[at].lower() if len(row) > at else ""
            if axis not in ("x", "z"):
                continue
            if None in values or len(values) != len(header):
                bad.append(f"line {number}: is no row of {len(header)} numbers")
                continue
            frame = f"frame {row[names.index('frame')]}" if "frame" in names else f"line {number}"
            if "source" in names and row[names.index("source")] not in ("", "0"):
                frame += f", source {row[names.index('source')]}"
            ranges.setdefault(frame, {})[axis] = METRES_PER_MM * np.array(values, dtype=float)
            if not raw:
                x = [math.nan if value is None else value for value in header]
                ranges[frame]["x"] = METRES_PER_MM * np.array(x)
    return ranges


def _section_title(row: list[str]) -> str:
    """What a row names that has one cell only, in lower case."""
    full = [cell for cell in row if cell]
    return full[0].lower() if len(full) == 1 else ""


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
        add_matrix_profiles(file, table, [file.name], values[None], form)
    elif values.ndim == 2 and values.shape[1] != 2:
        add_matrix_profiles(file, table, names, values, form)
    elif values.ndim in (2, 3) and values.shape[-1] == 2:
        scale = file_format.metres_per_number(file, form.unit, "an array")
        several = values if values.ndim == 3 else values[None]
        z = file_format.heights_from_sensor(several[..., 1], scale, form, table)
        x = scale * file_format.without_invalid_codes(several[..., 0], form.invalid)
        for i, name in enumerate(names if values.ndim == 3 else [file.name]):
            table.profiles[name] = file_format.profile_of_columns(x[i], z[i])
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
    scale = file_format.metres_per_number(file, form.unit, "a PLY")
    try:
        points, _ = read_mesh_file(file)
    except ConfigurationError:
        raise
    except Exception as error:  # trimesh raises whatever its parser stumbles on
        raise ConfigurationError(f"is no PLY with points: {error}", file=file) from None
    if len(points) and not np.nanmax(np.abs(scale * points[:, 1])) <= OFF_PLANE_TOLERANCE:
        message = "its points are off the plane y = 0, so it is no profile in a sensor's frame"
        raise ConfigurationError(message, file=file)
    table = FileProfiles()
    z_s = file_format.heights_from_sensor(points[:, 2], scale, form, table)
    table.profiles[file.name] = file_format.profile_of_columns(scale * points[:, 0], z_s)
    return table


def add_matrix_profiles(
    file: Path, table: FileProfiles, names: Sequence[str], heights: Array, form: ProfileFormat
) -> None:
    """Add profiles of heights, shape (m, n), at columns a pitch apart, x = 0 in the middle."""
    scale = file_format.metres_per_number(file, form.unit, "a matrix of profiles")
    x = scale * x_of_columns(file, heights.shape[1], form, "a matrix of profiles")
    z = file_format.heights_from_sensor(heights, scale, form, table)
    for name, row in zip(names, z, strict=True):
        table.profiles[name] = file_format.profile_of_columns(x, row)


def x_of_columns(file: Path, count: int, form: ProfileFormat, what: str) -> Array:
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


PROFILE_COLUMNS: Final = ("profile", "frame", "index")
"""Names of a column that separates the profiles of one table."""

DEFAULT_POINT_COLUMNS: Final = ["x", "z"]
"""What two columns without names hold: no profile has two points."""


def profiles_of_text(file: Path, text: TextTable, form: ProfileFormat) -> FileProfiles:
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
    if form.pitch is None and len(first) == len(DEFAULT_POINT_COLUMNS):
        return _read_columns(
            file, replace(text, rows=((0, DEFAULT_POINT_COLUMNS), *text.rows)), form
        )
    return _read_rows(file, text, form)


def _read_gocator(text: TextTable, form: ProfileFormat) -> FileProfiles:
    """Z grows towards the sensor, from mid-range, in millimetres, unless the options differ."""
    offset, table = file_format.ASSUMED_MID_RANGE, FileProfiles(notes=[file_format.MID_RANGE_NOTE])
    if form.z_offset is not None:
        offset = form.z_offset * file_format.METRES_PER_UNIT[form.unit or "mm"]
        table.notes.clear()
    for frame, axes in _gocator_coordinates(text, table.bad).items():
        if axes.keys() >= {"x", "z"}:
            height = file_format.without_invalid_codes(axes["z"], form.invalid)
            z_s = offset + -form.z_scale * height
            table.profiles[frame] = file_format.profile_of_columns(axes["x"], z_s)
        else:
            table.bad.append(f"{frame}: has no X values")
    return table


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
        add_matrix_profiles(file, table, names, np.array(heights), form)
    return table


def _read_columns(file: Path, text: TextTable, form: ProfileFormat) -> FileProfiles:
    """A point per row, in columns x and z; a column `PROFILE_COLUMNS` separates the profiles."""
    (header, first), *rows = text.rows
    names = [cell.lower() for cell in first]
    z_at, z_unit = _find_column(file, names, "z")
    pitched = form.pitch is not None and not any(_match_axis(name, "x") for name in names)
    x_at, x_unit = (z_at, z_unit) if pitched else _find_column(file, names, "x")
    x_scale, z_scale = (
        file_format.metres_per_number(
            file, unit or form.unit, "a column without a unit in its name"
        )
        for unit in (x_unit, z_unit)
    )
    group_at = next((names.index(name) for name in PROFILE_COLUMNS if name in names), None)
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
    together[:, 0] = file_format.without_invalid_codes(together[:, 0], form.invalid)
    z_s = file_format.heights_from_sensor(together[:, 1], z_scale, form, table)
    ends = np.cumsum([len(values) for values in points.values()])
    for name, end, values in zip(points, ends, points.values(), strict=True):
        part = slice(end - len(values), end)
        x_s = together[part, 0]
        if pitched:
            x_s = x_of_columns(file, len(values), form, "a table without a column x")
        table.profiles[name] = file_format.profile_of_columns(x_scale * x_s, z_s[part])
    return table


def _find_column(file: Path, names: Sequence[str], axis: str) -> tuple[int, str | None]:
    """Place of a column such as x, x_s or x_mm, and the unit in its name."""
    for i, name in enumerate(names):
        match = _match_axis(name, axis)
        if match:
            return i, match[1]
    found = ", ".join(names[:12])
    raise ConfigurationError(f"has no column {axis} (found: {found[:200]!r})", file=file)


def _match_axis(name: str, axis: str) -> re.Match[str] | None:
    units = "|".join(file_format.METRES_PER_UNIT)
    return re.fullmatch(rf"{axis}(?:_s)?(?:[_ ]*[\[(]?({units})[\])]?)?", name)


PROFILE_SUFFIXES: Final = (".csv", ".txt", ".tsv", ".dat", ".npy", ".ply")
"""Files of a folder that are read."""

MOST_PROFILE_FILE_BYTES: Final = 100_000_000
"""A larger file is no profile; it would fill the memory."""


def read_profiles(file: Path, form: ProfileFormat) -> FileProfiles:
    """Read every profile in a file, or in the files of a folder; what is bad is named.

    Parameters
    ----------
    file : Path
        Text whose first line names columns x and z (and profile, if there are many); text
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
    if form.unit is not None and form.unit not in file_format.METRES_PER_UNIT:
        known = ", ".join(file_format.METRES_PER_UNIT)
        raise ConfigurationError(f"unknown unit {form.unit!r}; one of {known}", key="units")
    for key, value in (("--z-scale", form.z_scale), ("--z-offset", form.z_offset or 0.0)):
        if not math.isfinite(value) or (key == "--z-scale" and value == 0):
            raise ConfigurationError(f"must be a number (found {value})", key=key)
    if file.is_dir():
        return _read_folder(file, form)
    table = _read_file(file, form)
    file_format.check_unit(file, table.profiles.values())
    file_format.check_height_scale(file, table.profiles.values())
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
    with file_format.explain_unreadable_table(file):
        check_file_size(file, MOST_PROFILE_FILE_BYTES, "profiles")
        suffix = file.suffix.lower()
        if suffix == ".mcap":
            raise ConfigurationError(
                "is a recording, not a table of profiles; to read the profiles of a scan again: "
                f"tjscan reprocess {file.parent}",
                file=file,
            )
        if suffix == ".ply":
            return read_ply_profile(file, form)
        if suffix == ".npy":
            return read_npy(file, form)
        return profiles_of_text(file, parse_text_table(file.read_text(encoding="utf-8-sig")), form)
