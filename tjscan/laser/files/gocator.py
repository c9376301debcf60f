"""Profiles from the CSV that a Gocator's recordings are exported to.

The file consists of sections. One named ``Profile`` (even spacing) has a table whose header ends
in the X positions, with a row of ranges per frame; one named ``RawProfile`` has two rows per
frame, its X and its Z values. Lengths are in millimetres; Z grows towards the sensor and counts
from the middle of the range. Columns as in LMI's user manual, chapter "Replay to CSV".
"""

from __future__ import annotations

import math

import numpy as np

from tjscan.core.frames import Array
from tjscan.laser.files.text import TextTable

PROFILE_SECTIONS = {"profile": False, "rawprofile": True}
"""Sections that hold profiles, and whether their X values are in rows."""

METRES_PER_MM = 1e-3


def is_gocator_export(table: TextTable) -> bool:
    """Whether a table is a CSV export of a Gocator sensor."""
    return any(_title(row) in PROFILE_SECTIONS for _, row in table.rows)


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
        title = _title(row)
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


def _title(row: list[str]) -> str:
    """What a row names that has one cell only, in lower case."""
    full = [cell for cell in row if cell]
    return full[0].lower() if len(full) == 1 else ""
