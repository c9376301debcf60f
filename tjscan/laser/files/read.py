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
_BRACKETED_REMARK: Final = re.compile(r"\s*\([^()]*\s[^()]*\)\s*$")
"""Words between brackets behind the names of columns."""


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

    A comment just above the numbers that names as many columns, one of them x, y or z, counts as
    their header.

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
    table = TextTable(rows, separator != "," and any(map(_DECIMAL_COMMA.fullmatch, cells)))
    above = (
        _BRACKETED_REMARK.sub("", text.splitlines()[rows[0][0] - 2])
        if rows and rows[0][0] > 1
        else ""
    )
    if above.startswith(COMMENT_MARK) and None not in table.parse_numbers(rows[0][1]):
        (named,) = _split_cells([(rows[0][0] - 1, above.lstrip(f"{COMMENT_MARK} "))], separator)
        names = [cell.lower() for cell in named[1]]
        if len(names) == len(rows[0][1]) and any(_match_axis(name, "xyz") for name in names):
            return replace(table, rows=(named, *rows))
    return table


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


OFF_PLANE_SHARE: Final = 1e-6
"""Of the largest coordinate, that a point of a profile may be off the laser plane."""

MIN_POINTS_OF_ONE_Y: Final = 20
"""Fewer points a plane y are not profiles one behind the other, but any cloud."""

POINT_COORDINATES: Final = 3


def read_npy(file: Path, form: ProfileFormat) -> FileProfiles:
    """Heights, shape (n,) or (m, n), or points x, z, (n, 2) or (m, n, 2), or x, y, z, (n, 3)."""
    try:
        # Mapped, an array has no more elements than its file holds.
        found = np.lib.format.open_memmap(file, mode="r")
    except OSError:
        raise
    except Exception as error:  # its header is read as Python, which stumbles over many things
        raise ConfigurationError(f"is no array of numbers: {error}") from None
    if not isinstance(found, np.ndarray) or found.dtype.kind not in "iuf" or found.size == 0:
        raise ConfigurationError("is no array of numbers")
    values, table = found.astype(float), FileProfiles()
    values[np.isinf(values)] = np.nan
    names = [f"row {i + 1}" for i in range(len(values))]
    if values.ndim == 1:
        add_matrix_profiles(table, [file.name], values[None], form)
    elif values.ndim == 2 and values.shape[1] == POINT_COORDINATES < len(values):
        add_points(file, table, values, form)
    elif values.ndim == 2 and values.shape[1] != 2:
        add_matrix_profiles(table, names, values, form)
    elif values.ndim in (2, 3) and values.shape[-1] == 2:
        several = values if values.ndim == 3 else values[None]
        scale = file_format.metres_per_number(
            several[..., 0], several[..., 1], form, table, "an array"
        )
        z = file_format.heights_from_sensor(several[..., 1], scale, form, table)
        x = scale * file_format.without_invalid_codes(several[..., 0], form.invalid)
        for i, name in enumerate(names if values.ndim == 3 else [file.name]):
            table.profiles[name] = file_format.profile_of_columns(x[i], z[i])
    else:
        raise ConfigurationError(f"an array of shape {values.shape} is no profile")
    return table


def read_ply_profile(file: Path, form: ProfileFormat) -> FileProfiles:
    """The profiles that a PLY holds; raises as `add_points` does, or if it is no PLY."""
    try:
        points, _ = read_mesh_file(file)
    except ConfigurationError:
        raise
    except Exception as error:  # trimesh raises whatever its parser stumbles on
        raise ConfigurationError(f"is no PLY with points: {error}") from None
    table = FileProfiles()
    add_points(file, table, np.asarray(points), form)
    return table


def add_points(file: Path, table: FileProfiles, points: Array, form: ProfileFormat) -> None:
    """Add the profiles of points x, y, z, shape (n, 3), each in a plane of its own y.

    Raises
    ------
    ConfigurationError
        If they are of no profiles in a sensor's frame.
    """
    points = file_format.without_invalid_codes(points, form.invalid)
    (x, y, z), names = points.T, [file.name]
    groups = np.zeros(len(points), dtype=int)
    if np.nanmax(np.abs(y), initial=0.0) > OFF_PLANE_SHARE * np.nanmax(np.abs(points), initial=0.0):
        at, groups = np.unique(y, return_inverse=True)
        names = [f"y {value:g}" for value in at]
        if len(points) < MIN_POINTS_OF_ONE_Y * len(at):
            raise ConfigurationError(
                "its points are off the plane y = 0, and not in planes of one y each: it holds no "
                "profiles in a sensor's frame"
            )
    scale = file_format.metres_per_number(x, z, form, table, "a cloud of points")
    z_s = file_format.heights_from_sensor(z, scale, form, table)
    for k, name in enumerate(names):
        own = groups == k
        table.profiles[name] = file_format.profile_of_columns(scale * x[own], z_s[own])


def add_matrix_profiles(
    table: FileProfiles, names: Sequence[str], heights: Array, form: ProfileFormat
) -> None:
    """Add profiles of heights, shape (m, n), at columns a pitch apart, x = 0 in the middle.

    Without a pitch, a first row of even steps, unlike all others, holds the columns' x.
    """
    even = list(map(_is_evenly_spaced, heights)) if form.pitch is None else []
    if even[:1] == [True] and not any(even[1:]):
        table.notes.append(f"{names[0]} steps evenly: it holds the columns' x, and is no profile")
        x, heights, names = heights[0], heights[1:], names[1:]
    else:
        x = x_of_columns(heights.shape[1], form, "a matrix of profiles")
    scale = file_format.metres_per_number(x, heights, form, table, "a matrix of profiles")
    z = file_format.heights_from_sensor(heights, scale, form, table)
    for name, row in zip(names, z, strict=True):
        table.profiles[name] = file_format.profile_of_columns(scale * x, row)


def _is_evenly_spaced(row: Array) -> bool:
    """Whether numbers step by the same, to a hundredth or the rounding of two digits."""
    steps = np.diff(row)
    return len(row) >= FEWEST_NUMBERED_COLUMNS and bool(
        steps[0] != 0 and np.all(np.abs(steps - steps.mean()) < 0.1 * abs(steps.mean()))
    )


def x_of_columns(count: int, form: ProfileFormat, what: str) -> Array:
    """X of columns a pitch apart, in the file's unit."""
    if form.pitch is None:
        raise ConfigurationError(
            f"{what} needs the distance of its columns: --pitch, the width of a profile over its "
            f"{count - 1} steps. If its rows are points, name the columns in a first line: "
            "x_mm,z_mm"
        )
    if not 0 < form.pitch < math.inf:
        raise ConfigurationError(f"must be a positive number (found {form.pitch})", key="--pitch")
    return np.asarray(form.pitch * (np.arange(count) - (count - 1) / 2))


PROFILE_COLUMNS: Final = ("profile", "frame", "index")
"""Names of a column that separates the profiles of one table."""

UNNAMED_COLUMNS: Final = ["", ""]
"""Of points: no profile has two heights."""

MIN_SHARE_ONE_WAY, MAX_SHARE_OF_HEIGHTS = 0.98, 0.9
"""Of the steps from point to point that go the same way: of a column x, and of one that is not."""

_LENGTH_UNIT: Final = re.compile(r"(?<![a-z])(mm|um|m)(?![a-z])")


def profiles_of_text(file: Path, text: TextTable, form: ProfileFormat) -> FileProfiles:
    """The profiles of a table, whatever of the three kinds it is.

    Raises
    ------
    ConfigurationError
        If it is empty, or lacks a unit, a pitch or a column.
    """
    if not text.rows:
        raise ConfigurationError("is empty")
    if is_gocator_export(text):
        return _read_gocator(text, form)
    first = text.parse_numbers(text.rows[0][1])
    if None in first:
        return _read_columns(file, text, form)
    if form.pitch is None and len(first) == len(UNNAMED_COLUMNS):
        return _read_columns(file, replace(text, rows=((0, UNNAMED_COLUMNS), *text.rows)), form)
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
        add_matrix_profiles(table, names, np.array(heights), form)
    return table


def _read_columns(file: Path, text: TextTable, form: ProfileFormat) -> FileProfiles:
    """A point per row, in columns x and z; a column `PROFILE_COLUMNS` separates the profiles."""
    (header, first), *rows = text.rows
    names, table = [cell.lower() for cell in first], FileProfiles()
    (x_at, x_unit), (z_at, z_unit) = _find_axes(text, form, table)
    pitched = x_at == z_at
    group_at = next((names.index(name) for name in PROFILE_COLUMNS if name in names), None)
    for at in (i for i, name in enumerate(names) if _match_axis(name, "y")):
        values = {row[at] for _, row in rows if len(row) == len(names)}
        many = 1 < len(values) <= len(rows) / MIN_POINTS_OF_ONE_Y
        group_at = at if many and group_at is None and at not in (x_at, z_at) else group_at
    points = dict[str, list[tuple[float, float]]]()
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
    lengths = [len(values) for values in points.values()]
    if pitched:
        what = "a table without a column x"
        together[:, 0] = np.concatenate([x_of_columns(n, form, what) for n in lengths])
    unstated = replace(form, unit=form.unit or x_unit or z_unit)
    what = "a column without a unit in its name"
    scale = file_format.metres_per_number(together[:, 0], together[:, 1], unstated, table, what)
    x_scale, z_scale = (file_format.METRES_PER_UNIT.get(u or "", scale) for u in (x_unit, z_unit))
    z_s = file_format.heights_from_sensor(together[:, 1], z_scale, form, table)
    for name, end, count in zip(points, np.cumsum(lengths), lengths, strict=True):
        part = slice(end - count, end)
        x_s = x_scale * together[part, 0]
        table.profiles[name] = file_format.profile_of_columns(x_s, z_s[part])
    return table


def _find_axes(
    text: TextTable, form: ProfileFormat, table: FileProfiles
) -> tuple[tuple[int, str | None], tuple[int, str | None]]:
    """Place and unit of the columns x and z; the same twice where points have no x but a pitch.

    Where the names don't state them, and two columns of lengths vary, that which steps one way
    all along the profiles is x.
    """
    (_, first), *rows = text.rows
    names = [cell.lower() for cell in first]
    found = {
        axis: (names.index(name), match[1])
        for axis in "xz"
        for name in reversed(names)
        if (match := _match_axis(name, axis))
    }
    if "z" in found and ("x" in found or form.pitch is not None):
        return found.get("x", found["z"]), found["z"]
    numbers = [text.parse_numbers(row) for _, row in rows if len(row) == len(names)]
    values = np.array(numbers, dtype=float).reshape(-1, len(names))
    units = [match and match[1] for match in map(_LENGTH_UNIT.search, names)]
    lengths = [i for i, name in enumerate(names) if name not in PROFILE_COLUMNS]
    stated = [i for i in lengths if units[i]]
    both = [i for i in stated or lengths if len(np.unique(values[:, i])) > 1]
    steps = [step[step**2 > 0] for step in np.diff(values[:, both], axis=0).T]
    shares = [max(np.mean(step > 0), np.mean(step < 0)) for step in steps if len(step)]
    if len(shares) == len(UNNAMED_COLUMNS):
        x, z = np.argsort(shares)[::-1]
        if shares[x] > MIN_SHARE_ONE_WAY > MAX_SHARE_OF_HEIGHTS > shares[z]:
            x, z = both[x], both[z]
            x_name, z_name = (f"column {i + 1} {first[i]}".strip() for i in (x, z))
            table.notes.append(f"{x_name} is taken for x, because it steps one way, {z_name} for z")
            return (x, units[x]), (z, units[z])
    blank = bool(len(values)) and len(names) > 1 and not np.isfinite(values).any()
    if names == UNNAMED_COLUMNS or blank:
        return (0, None), (1, None)
    lacks = "z" if "z" not in found else "x"
    shown = ", ".join(names[:12])[:200]
    raise ConfigurationError(
        f"has no column {lacks} (found: {shown!r}): name them x_mm and z_mm in its first line"
    )


def _match_axis(name: str, axis: str) -> re.Match[str] | None:
    units = "|".join(file_format.METRES_PER_UNIT)
    return re.fullmatch(rf"[{axis}](?:_s)?(?:[_ ]*[\[(]?({units})[\])]?)?", name)


_DIGITS_IN_NAME: Final = re.compile(r"(\d+)", re.ASCII)

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
    table = _read_folder(file, form) if file.is_dir() else _read_file(file, form)
    if len(units := sorted(table.assumed_units)) > 1:
        raise ConfigurationError(f"seems to count in {' and '.join(units)}: --units", file=file)
    note = (
        f"no unit is stated: {units[0]} is assumed, in which the profiles are as wide and as far "
        "away as those of line lasers; --units states it"
        if units
        else ""
    )
    table.notes += [note] if note and note not in table.notes else []
    file_format.check_unit(file, table.profiles.values())
    file_format.check_height_scale(file, table.profiles.values())
    return table


def flip_heights(profile: Profile) -> Profile:
    """The profile that heights of the other sign would have given, as far from the sensor."""
    low, high = np.nanmin(profile.z_s), np.nanmax(profile.z_s)
    return Profile(profile.x_s, low + high - profile.z_s, profile.intensity, profile.time)


def _number_order(file: Path) -> list[tuple[int, str]]:
    """Sorts 9 before 10."""
    return [
        (int(word), "") if word.isdigit() else (0, word)
        for word in _DIGITS_IN_NAME.split(file.name)
    ]


def _read_folder(folder: Path, form: ProfileFormat) -> FileProfiles:
    """The profiles of all files in a folder, by name."""
    together = FileProfiles()
    for file in sorted(folder.iterdir(), key=_number_order):
        if file.suffix.lower() not in PROFILE_SUFFIXES or file.name in form.other_files:
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
        together.assumed_units |= table.assumed_units
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
