"""Flange poses from a CSV file, and the recorded profiles that belong to them."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.calibration.arm_formats import (
    CONVENTIONS,
    FANUC,
    KUKA,
    OrientationConvention,
    poses_of_fanuc_program,
    poses_of_kuka_data,
)
from tjscan.calibration.targets.target import PosedProfile
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import check_file_size
from tjscan.core.frames import Array, pose
from tjscan.laser.files.format import METRES_PER_UNIT
from tjscan.laser.files.tables import GROUP_COLUMNS
from tjscan.laser.profile import Profile

RADIANS_PER_UNIT: Final = {"rad": 1.0, "deg": math.pi / 180}
"""Radians in each unit of angle."""
MAX_FILE_BYTES: Final = 10_000_000
"""A larger file is no list of poses."""
PROGRAMS: Final = {".ls": (poses_of_fanuc_program, FANUC), ".dat": (poses_of_kuka_data, KUKA)}
"""Files of arms that are no tables, by how their names end."""


@dataclass(frozen=True, slots=True, eq=False)
class FlangePoseList:
    """Flange poses in the order of their file.

    Parameters
    ----------
    T_b_f : dict of str to ndarray, shape (4, 4)
        By what their column profile, frame or index holds, or else by their number.
    with_key : bool
        Whether there was such a column.
    convention : str
        How orientations were read, for messages.
    q : dict of str to ndarray, shape (joints,)
        Joint angles by the same keys, radians; empty where the file has none.
    """

    T_b_f: dict[str, Array]
    with_key: bool
    convention: str
    q: dict[str, Array] = field(default_factory=dict)


def read_flange_poses(file: Path) -> FlangePoseList:
    """Read flange poses in frame b from a CSV file, a FANUC or a KUKA program.

    Parameters
    ----------
    file : Path
        CSV whose header names position (``x_mm, y_mm, z_mm``; or m, um) and orientation, as one
        of `CONVENTIONS` has it (``w_deg, p_deg, r_deg``; or rad); columns of arms' makers need no
        units. Beside them ``profile``, ``frame`` or ``index``, and joint angles ``q1_deg``,
        ``q2_deg`` and so on (or rad). Or a file that ends in one of
        `PROGRAMS`.

    Raises
    ------
    ConfigurationError
        If the file is missing, or a column or a number is missing or wrong.
    """
    program = PROGRAMS.get(file.suffix.lower())
    if program is not None:
        return _read_program(file, *program)
    names, rows = _read_table(file)
    convention, read = _reader(file, names)
    key_at = next((names.index(name) for name in GROUP_COLUMNS if name in names), None)
    joints = _joint_columns(names)
    poses: dict[str, Array] = {}
    q: dict[str, Array] = {}
    for number, row in enumerate(rows, start=1):
        key = str(number) if key_at is None else _key(row[key_at])
        if key in poses:
            raise ConfigurationError(f"{names[key_at or 0]} {key} stands there twice", file=file)
        try:
            poses[key] = read(row)
            if joints:
                q[key] = np.array([scale * _finite(row[k]) for k, scale in joints])
        except ValueError as error:
            raise ConfigurationError(f"pose {number}: {error}", file=file) from None
    return FlangePoseList(poses, key_at is not None, convention.meaning, q)


def _read_program(
    file: Path, read: Callable[[str], dict[str, Array]], convention: OrientationConvention
) -> FlangePoseList:
    try:
        check_file_size(file, MAX_FILE_BYTES, "a list of poses")
        poses = read(file.read_text(encoding="utf-8-sig", errors="replace"))
    except FileNotFoundError:
        raise ConfigurationError("there is no such file", file=file) from None
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None
    except ValueError as error:
        raise ConfigurationError(str(error), file=file) from None
    return FlangePoseList(poses, all(key.isdigit() for key in poses), convention.meaning)


def read_points_in_base_frame(file: Path) -> Array:
    """Read points in frame b, shape (n, 3), metres, from CSV columns ``x_mm, y_mm, z_mm``.

    Raises
    ------
    ConfigurationError
        As `read_flange_poses` does.
    """
    names, rows = _read_table(file)
    columns = _position(file, names)
    try:
        return np.array([[scale * _finite(row[k]) for k, scale in columns] for row in rows])
    except ValueError as error:
        raise ConfigurationError(f"is no table of numbers: {error}", file=file) from None


def pair_profiles_with_poses(
    profiles: Mapping[str, Profile], poses: FlangePoseList, file: Path
) -> list[PosedProfile]:
    """Pair each profile with its flange pose: by number, or in their order.

    Parameters
    ----------
    profiles : mapping of str to Profile
        As `read_profiles` names them.
    poses : FlangePoseList
        As many.
    file : Path
        The poses' file, for messages.

    Raises
    ------
    ConfigurationError
        If one lacks its counterpart.
    """
    keys = [_key(name.split()[-1]) for name in profiles]
    if not poses.with_key:
        if len(profiles) != len(poses.T_b_f):
            raise ConfigurationError(
                f"holds {len(poses.T_b_f)} poses for {len(profiles)} profiles, and no column "
                f"({', '.join(GROUP_COLUMNS)}) that shows which belongs to which",
                file=file,
            )
        keys = list(poses.T_b_f)
    alone = sorted(set(keys) ^ set(poses.T_b_f))
    if alone:
        raise ConfigurationError(
            f"number {', '.join(alone[:8])} has a profile or a pose, but not both", file=file
        )
    return [
        PosedProfile(name, poses.T_b_f[key], profile, poses.q.get(key))
        for key, (name, profile) in zip(keys, profiles.items(), strict=True)
    ]


def _read_table(file: Path) -> tuple[list[str], list[list[str]]]:
    """Lower-case names of the header, and rows of as many cells."""
    try:
        check_file_size(file, MAX_FILE_BYTES, "a list of poses")
        with file.open(newline="", encoding="utf-8-sig") as stream:
            rows = [row for row in csv.reader(stream) if any(cell.strip() for cell in row)]
    except FileNotFoundError:
        raise ConfigurationError("there is no such file", file=file) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigurationError(f"is no table of numbers: {error}", file=file) from None
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None
    if len(rows) < 2:
        raise ConfigurationError("holds nothing below a header", file=file)
    names = [cell.strip().lstrip("# ").lower() for cell in rows[0]]
    for number, row in enumerate(rows[1:], start=1):
        if len(row) != len(names):
            raise ConfigurationError(
                f"row {number} below the header has {len(row)} columns, the header {len(names)}",
                file=file,
            )
    return names, rows[1:]


def _position(file: Path, names: Sequence[str], unit: str = "") -> list[tuple[int, float]]:
    columns = _columns(names, ("x", "y", "z"), METRES_PER_UNIT, unit)
    if columns is None:
        raise ConfigurationError(
            f"has no columns x_mm, y_mm, z_mm (found: {', '.join(names[:12])})", file=file
        )
    return columns


def _reader(
    file: Path, names: Sequence[str]
) -> tuple[OrientationConvention, Callable[[Sequence[str]], Array]]:
    """What the header names mean, and how to make a pose of a row."""
    found = [
        (convention, columns)
        for convention in CONVENTIONS
        if (columns := _orientation(names, convention)) is not None
    ]
    if len(found) != 1:
        raise ConfigurationError(
            "needs the columns of one orientation: qx, qy, qz, qw, or q1, q2, q3, q4 (ABB), or "
            "w_deg, p_deg, r_deg (FANUC), or a_deg, b_deg, c_deg (KUKA), or rx_deg, ry_deg, rz_deg "
            f"(UR) (found: {', '.join(names[:12])})",
            file=file,
        )
    ((convention, columns),) = found
    position = _position(file, names, convention.length_unit)

    def read(row: Sequence[str]) -> Array:
        p = np.array([scale * _finite(row[k]) for k, scale in position])
        values = np.array([scale * _finite(row[k]) for k, scale in columns])
        return pose(convention.matrix(values), p)

    return convention, read


def _orientation(
    names: Sequence[str], convention: OrientationConvention
) -> list[tuple[int, float]] | None:
    units = {} if len(convention.columns) == 4 else RADIANS_PER_UNIT
    return _columns(names, convention.columns, units, convention.angle_unit)


def _columns(
    names: Sequence[str], axes: Sequence[str], units: Mapping[str, float], unit: str = ""
) -> list[tuple[int, float]] | None:
    """Place and unit of each axis' column, `unit` where none is named; None where one lacks."""
    found = []
    ending = rf"_({'|'.join(units)})" if units else "()"
    for axis in axes:
        matches = ((i, re.fullmatch(axis + ending, name)) for i, name in enumerate(names))
        first = next(((i, units.get(m[1], 1.0)) for i, m in matches if m), None)
        if first is None and unit and axis in names:
            first = (names.index(axis), units[unit])
        if first is None:
            return None
        found.append(first)
    return found


def _joint_columns(names: Sequence[str]) -> list[tuple[int, float]]:
    """Place and unit of the columns ``q1_deg``, ``q2_deg`` and so on; as many as there are."""
    found: list[tuple[int, float]] = []
    while (one := _columns(names, (f"q{len(found) + 1}",), RADIANS_PER_UNIT)) is not None:
        found += one
    return found


def _finite(cell: str) -> float:
    value = float(cell)
    if not math.isfinite(value):
        raise ValueError(f"{cell.strip()!r} is no finite number")
    return value


def _key(cell: str) -> str:
    """The same word for 1, 1.0 and 1.000000."""
    try:
        value = float(cell)
    except ValueError:
        return cell.strip()
    return str(int(value)) if value.is_integer() else str(value)
