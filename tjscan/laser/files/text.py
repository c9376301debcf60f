"""Tables of numbers in text files: separators, decimal commas, comments and headers.

A Gocator's export consists of sections. One named ``Profile`` (even spacing) has a table whose
header ends in the X positions, with a row of ranges per frame; one named ``RawProfile`` has two
rows per frame, its X and its Z values. Lengths are in millimetres; Z grows towards the sensor and
counts from the middle of the range. Columns as in LMI's user manual, chapter "Replay to CSV".
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.frames import Array

COMMENT_MARK: Final = "#"

SEPARATOR_SAMPLE_LINES: Final = 50
"""Lines that the separator is found from."""

FEWEST_COUNTED_FROM_ONE: Final = 5
"""Shorter rows 1, 2, 3 are heights."""

LONGEST_LINE: Final = 1_000_000
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


def read_text_table(file: Path) -> TextTable:
    """Read a table: cells between commas, semicolons, tabs or blanks; ``#`` begins a comment.

    Raises
    ------
    UnicodeDecodeError, csv.Error, OSError
        If it is no text, holds more than `MOST_TABLE_CELLS` cells or a line of more than
        `LONGEST_LINE` characters, or can't be read.
    """
    lines = [
        (number, line.split(COMMENT_MARK, 1)[0])
        for number, line in enumerate(file.read_text(encoding="utf-8-sig").splitlines(), start=1)
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
    with_comma = [line for line in lines if "," in line]
    return None if all(_have_decimal_commas(line) for line in with_comma) else ","


def _have_decimal_commas(line: str) -> bool:
    """Whether every word of several is a number with a decimal comma."""
    words = line.split()
    return len(words) > 1 and all(_DECIMAL_COMMA.fullmatch(word) for word in words)


def _split_cells(
    lines: list[tuple[int, str]], separator: str | None
) -> Iterator[tuple[int, list[str]]]:
    left = MOST_TABLE_CELLS
    for number, line in lines:
        if len(line) > LONGEST_LINE:
            raise csv.Error(f"line {number} has more than {LONGEST_LINE} characters")
        row = line.split() if separator is None else next(csv.reader([line], delimiter=separator))
        left -= len(row)
        if left < 0:
            raise csv.Error(f"it holds more than {MOST_TABLE_CELLS} cells; split the file")
        yield number, [cell.strip() for cell in row]


def is_column_numbering(values: list[float | None]) -> bool:
    """Whether numbers count columns: 0, 1, 2 … or 1, 2, 3 …, which a few heights may, too."""
    from_zero = values == [float(i) for i in range(len(values))]
    from_one = values == [float(i) for i in range(1, len(values) + 1)]
    return (from_zero and len(values) > 1) or (from_one and len(values) >= FEWEST_COUNTED_FROM_ONE)


PROFILE_SECTIONS = {"profile": False, "rawprofile": True}
"""Sections that hold profiles, and whether their X values are in rows."""

METRES_PER_MM = 1e-3


def is_gocator_export(table: TextTable) -> bool:
    """Whether a table is a CSV export of a Gocator sensor."""
    return any(_section_title(row) in PROFILE_SECTIONS for _, row in table.rows)


def read_gocator_profiles(table: TextTable) -> tuple[dict[str, tuple[Array, Array]], list[str]]:
    """X and height of each profile in metres by name, and what could not be read.

    Parameters
    ----------
    table : TextTable
        All sections of a file.
    """
    found: dict[str, tuple[Array, Array]] = {}
    bad: list[str] = []
    raw, names = None, None
    ranges: dict[str, dict[str, Array]] = {}
    header: list[float | None] = []
    for number, row in table.rows:
        title = _section_title(row)
        if title in PROFILE_SECTIONS:
            raw, names = PROFILE_SECTIONS[title], None
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
    for frame, axes in ranges.items():
        if axes.keys() >= {"x", "z"}:
            found[frame] = (axes["x"], axes["z"])
        else:
            bad.append(f"{frame}: has no X values")
    return found, bad


def _section_title(row: list[str]) -> str:
    """What a row names that has one cell only, in lower case."""
    full = [cell for cell in row if cell]
    return full[0].lower() if len(full) == 1 else ""
