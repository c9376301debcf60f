"""Flange poses from a CSV file, and the recorded profiles that belong to them."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.calibration.posed_profile import PosedProfile
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import check_file_size
from tjscan.core.frames import Array, pose
from tjscan.laser.files import GROUP_COLUMNS, METRES_PER_UNIT
from tjscan.laser.profile import Profile

RADIANS_PER_UNIT: Final = {"rad": 1.0, "deg": math.pi / 180}
"""Radians in each unit of angle."""
MAX_FILE_BYTES: Final = 10_000_000
"""A larger file is no list of poses."""
QUATERNION_NORM_TOLERANCE: Final = 0.01
"""A quaternion whose length is further from one is not one."""

ROTATION_COLUMNS: Final[dict[str, tuple[str, ...]]] = {
    "quaternion": ("qx", "qy", "qz", "qw"),
    "rotation vector": ("rx", "ry", "rz"),
    "Euler angles": ("a", "b", "c"),
}
"""Columns of each notation of an orientation; angles have their unit in the name.

Euler angles turn about the moving z, y, x axes in turn: R = Rz(a) Ry(b) Rx(c).
"""


@dataclass(frozen=True, slots=True, eq=False)
class FlangePoseList:
    """Flange poses in the order of their file.

    Parameters
    ----------
    T_b_f : dict of str to ndarray, shape (4, 4)
        By what their column profile, frame or index holds, or else by their number.
    with_key : bool
        Whether there was such a column.
    """

    T_b_f: dict[str, Array]
    with_key: bool


def read_flange_poses(file: Path) -> FlangePoseList:
    """Read flange poses in frame b from a CSV file.

    Parameters
    ----------
    file : Path
        CSV whose header names position (``x_mm, y_mm, z_mm``; or m, um) and orientation: a
        quaternion ``qx, qy, qz, qw``, a rotation vector ``rx_deg, ry_deg, rz_deg`` or Euler
        angles ``a_deg, b_deg, c_deg`` (or rad); beside them ``profile``, ``frame`` or ``index``.

    Raises
    ------
    ConfigurationError
        If the file is missing, or a column or a number is missing or wrong.
    """
    names, rows = _read_table(file)
    read = _reader(file, names)
    key_at = next((names.index(name) for name in GROUP_COLUMNS if name in names), None)
    poses: dict[str, Array] = {}
    for number, row in enumerate(rows, start=1):
        key = str(number) if key_at is None else _key(row[key_at])
        if key in poses:
            raise ConfigurationError(f"{names[key_at or 0]} {key} stands there twice", file=file)
        try:
            poses[key] = read(row)
        except ValueError as error:
            raise ConfigurationError(f"pose {number}: {error}", file=file) from None
    return FlangePoseList(poses, key_at is not None)


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
        PosedProfile(name, poses.T_b_f[key], profile)
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


def _position(file: Path, names: Sequence[str]) -> list[tuple[int, float]]:
    columns = _columns(names, ("x", "y", "z"), METRES_PER_UNIT)
    if columns is None:
        raise ConfigurationError(
            f"has no columns x_mm, y_mm, z_mm (found: {', '.join(names[:12])})", file=file
        )
    return columns


def _reader(file: Path, names: Sequence[str]) -> Callable[[Sequence[str]], Array]:
    """How to make a pose of a row, from what the header names."""
    position = _position(file, names)
    found = {
        notation: columns
        for notation, axes in ROTATION_COLUMNS.items()
        if (columns := _columns(names, axes, {} if axes[0] == "qx" else RADIANS_PER_UNIT))
        is not None
    }
    if len(found) != 1:
        raise ConfigurationError(
            "needs the columns of one orientation: qx, qy, qz, qw, or rx_deg, ry_deg, rz_deg, or "
            f"a_deg, b_deg, c_deg (found: {', '.join(names[:12])})",
            file=file,
        )
    ((notation, columns),) = found.items()

    def read(row: Sequence[str]) -> Array:
        p = np.array([scale * _finite(row[k]) for k, scale in position])
        values = np.array([scale * _finite(row[k]) for k, scale in columns])
        return pose(_rotation(notation, values).as_matrix(), p)

    return read


def _rotation(notation: str, values: Array) -> Rotation:
    if notation == "quaternion":
        if not abs(np.linalg.norm(values) - 1) < QUATERNION_NORM_TOLERANCE:
            raise ValueError(f"its quaternion has length {np.linalg.norm(values):.3f}, not 1")
        return Rotation.from_quat(values)
    if notation == "rotation vector":
        return Rotation.from_rotvec(values)
    return Rotation.from_euler("ZYX", values)


def _columns(
    names: Sequence[str], axes: Sequence[str], units: Mapping[str, float]
) -> list[tuple[int, float]] | None:
    """Place and unit of each axis' column; None where one is missing."""
    found = []
    ending = rf"_({'|'.join(units)})" if units else "()"
    for axis in axes:
        matches = ((i, re.fullmatch(axis + ending, name)) for i, name in enumerate(names))
        first = next(((i, units.get(m[1], 1.0)) for i, m in matches if m), None)
        if first is None:
            return None
        found.append(first)
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
