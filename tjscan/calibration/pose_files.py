"""Flange poses from a CSV file, and the recorded profiles that belong to them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
from pytransform3d import rotations

from tjscan.calibration.targets.target import PosedProfile
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import read_small_file
from tjscan.core.frames import Array, pose
from tjscan.laser.files.format import METRES_PER_UNIT, explain_unreadable_table
from tjscan.laser.files.read import PROFILE_COLUMNS, TextTable, parse_text_table
from tjscan.laser.profile import Profile

QUATERNION_NORM_TOLERANCE: Final = 0.01
"""A quaternion whose length is further from one is not one."""


@dataclass(frozen=True, slots=True)
class OrientationConvention:
    """Meaning of the numbers of an orientation.

    Parameters
    ----------
    columns : tuple of str
        Names of the columns, without units.
    meaning : str
        For messages.
    matrix : callable
        From the numbers (radians) to a rotation matrix, shape (3, 3).
    length_unit, angle_unit : str
        Of columns whose names state none, as the arm writes them; empty if a unit must be stated.
    """

    columns: tuple[str, ...]
    meaning: str
    matrix: Callable[[Array], Array]
    length_unit: str = ""
    angle_unit: str = ""


def _rotation_of_quaternion(wxyz: Array) -> Array:
    length = float(np.linalg.norm(wxyz))
    if not abs(length - 1) < QUATERNION_NORM_TOLERANCE:
        raise ValueError(f"its quaternion has length {length:.3f}, not 1")
    return np.asarray(rotations.matrix_from_quaternion(wxyz / length))


FANUC_CONVENTION: Final = OrientationConvention(
    ("w", "p", "r"),
    "FANUC W P R: about the fixed x, y, z axes in turn, R = Rz(R) Ry(P) Rx(W)",
    lambda wpr: np.asarray(rotations.matrix_from_euler(wpr, 0, 1, 2, extrinsic=True)),
    length_unit="mm",
    angle_unit="deg",
)
KUKA_CONVENTION: Final = OrientationConvention(
    ("a", "b", "c"),
    "KUKA A B C: about the moving z, y, x axes in turn, R = Rz(A) Ry(B) Rx(C)",
    lambda abc: np.asarray(rotations.matrix_from_euler(abc, 2, 1, 0, extrinsic=False)),
    length_unit="mm",
    angle_unit="deg",
)
UR_CONVENTION: Final = OrientationConvention(
    ("rx", "ry", "rz"),
    "UR rotation vector: along the axis, as long as the angle",
    lambda vector: np.asarray(rotations.matrix_from_compact_axis_angle(vector)),
    length_unit="m",
    angle_unit="rad",
)
ORIENTATION_CONVENTIONS: Final = (
    OrientationConvention(
        ("qx", "qy", "qz", "qw"),
        "quaternion, scalar last",
        lambda q: _rotation_of_quaternion(np.roll(q, 1)),
    ),
    OrientationConvention(
        ("q1", "q2", "q3", "q4"),
        "ABB quaternion, scalar first",
        _rotation_of_quaternion,
        length_unit="mm",
    ),
    FANUC_CONVENTION,
    KUKA_CONVENTION,
    UR_CONVENTION,
)
"""Distinguished by the names of their columns."""

_FILE_NUMBER: Final = re.compile(r"(\d+)\D*\.[A-Za-z]+$")
_FANUC_POSITION: Final = re.compile(r"P\[(\d+)[^\]]*\]\s*\{(.*?)\}\s*;", re.DOTALL)
_FANUC_GROUP: Final = re.compile(r"GP\d+\s*:")
_FANUC_FRAMES: Final = re.compile(r"UF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)")
_KUKA_POSITION: Final = re.compile(
    r"(?:E6POS|\bPOS|\bFRAME)\s+(\w+)\s*=\s*\{(?:\s*E6POS\s*:|\s*POS\s*:)?([^}]*)\}", re.IGNORECASE
)


def poses_of_fanuc_program(text: str) -> dict[str, Array]:
    """Poses of a FANUC TP program (``.ls``), shape (4, 4) each, by their number.

    Parameters
    ----------
    text : str
        The program, with its positions behind ``/POS``.

    Raises
    ------
    ValueError
        If there is none, or they are joint angles or count in different frames.
    """
    found: dict[str, Array] = {}
    frames = set()
    for number, body in _FANUC_POSITION.findall(text):
        if len(_FANUC_GROUP.findall(body)) > 1:
            raise ValueError(f"P[{number}] holds several motion groups; only one arm is read")
        T = _pose_of_position(body, "XYZWPR", r"\s*=\s*", FANUC_CONVENTION)
        if T is None:
            raise ValueError(
                f"P[{number}] holds no X Y Z W P R: teach it as a Cartesian position, not as joints"
            )
        frames |= set(_FANUC_FRAMES.findall(body))
        found[number] = T
    if len(frames) > 1:
        shown = ", ".join(f"UF {uf} UT {ut}" for uf, ut in sorted(frames))
        raise ValueError(f"its positions count in several frames ({shown}); record all in one")
    if not found:
        raise ValueError("holds no positions P[n] behind /POS")
    return found


def poses_of_kuka_data(text: str) -> dict[str, Array]:
    """Poses of a KUKA data list (``.dat``), shape (4, 4) each, by their names' numbers.

    Parameters
    ----------
    text : str
        With lines such as ``DECL E6POS XP1={X 1.0,Y 2.0,Z 3.0,A 4.0,B 5.0,C 6.0,...}``.

    Raises
    ------
    ValueError
        If there is none.
    """
    found: dict[str, Array] = {}
    for name, body in _KUKA_POSITION.findall(text):
        T = _pose_of_position(body, "XYZABC", r"\s+", KUKA_CONVENTION)
        if T is None:
            continue  # a tool's load, a frame's name
        digits = re.search(r"(\d+)$", name)
        key = digits[1].lstrip("0") or "0" if digits else name
        if key in found:
            raise ValueError(
                f"two positions are numbered {key} ({name}); keep one list in the file"
            )
        found[key] = T
    if not found:
        raise ValueError("holds no positions E6POS, POS or FRAME with X Y Z A B C")
    return found


def _pose_of_position(
    body: str, names: str, separator: str, convention: OrientationConvention
) -> Array | None:
    """Pose of a position in millimetres and degrees; None if one of the six numbers lacks."""
    number = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    found = [re.search(rf"\b{name}{separator}{number}", body) for name in names]
    values = np.array([float(one[1]) for one in found if one])
    if len(values) < len(names):
        return None
    return pose(convention.matrix(np.radians(values[3:])), 1e-3 * values[:3])


RADIANS_PER_UNIT: Final = {"rad": 1.0, "deg": math.pi / 180}
"""Radians in each unit of angle."""
PLAUSIBLE_REACH: Final = (0.03, 6.0)
"""Metres that a flange is from its base, from and to: less or more is another unit."""
MAX_POSE_LIST_BYTES: Final = 10_000_000
"""A larger file is no list of poses."""
ARM_PROGRAM_READERS: Final = {
    ".ls": (poses_of_fanuc_program, FANUC_CONVENTION),
    ".dat": (poses_of_kuka_data, KUKA_CONVENTION),
}
"""Files of arms that are no tables, by how their names end."""
POSE_FILE_SUFFIXES: Final = (".csv", ".txt", ".tsv", *ARM_PROGRAM_READERS)
"""How names of files of poses end."""


Columns = list[tuple[int, float]]
"""Place of each column, and the SI value of its unit."""


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
        Joint angles by the same keys, radians; empty if the file has none.
    others : dict of str to dict of str to ndarray, shape (4, 4)
        Poses that the same numbers mean by other conventions and units, by what to write for these.
    """

    T_b_f: dict[str, Array]
    with_key: bool
    convention: str
    q: dict[str, Array] = field(default_factory=dict)
    others: dict[str, dict[str, Array]] = field(default_factory=dict)


def read_flange_poses(file: Path) -> FlangePoseList:
    """Read flange poses in frame b from a CSV file, a FANUC or a KUKA program.

    Parameters
    ----------
    file : Path
        CSV whose header names position (``x_mm, y_mm, z_mm``; or m, um) and orientation, as one
        of `ORIENTATION_CONVENTIONS` has it (``w_deg, p_deg, r_deg``; or rad); columns of arms'
        makers need no units. Beside them ``profile``, ``frame`` or ``index``, and joint angles
        ``q1_deg``, ``q2_deg`` and so on (or rad). Or a file that ends in one of
        `ARM_PROGRAM_READERS`.

    Raises
    ------
    ConfigurationError
        If the file is missing, or a column or a number is missing or wrong.
    """
    with explain_unreadable_table(file):
        if (program := ARM_PROGRAM_READERS.get(file.suffix.lower())) is not None:
            read, convention = program
            poses = read(_read_text(file, errors="replace"))
            return FlangePoseList(poses, all(map(str.isdigit, poses)), convention.meaning)
        names, table = _read_table(file)
        convention, orientation = _find_orientation_columns(names)
        meaning, unit = convention.meaning, convention.length_unit
        bare = None if unit else _find_columns(names, "xyz", {})
        if bare is not None:
            places = (_values_of_row(table, row, bare) for _, row in table.rows)
            unit = next(iter(_plausible_units(places)), "")
            meaning += f"; {unit or 'no unit'} is assumed for x, y and z, as far as arms reach"
        position = _find_position_columns(names, unit)
        joints = _find_joint_columns(names)
        key_at = next((names.index(name) for name in PROFILE_COLUMNS if name in names), None)
        found = FlangePoseList({}, key_at is not None, meaning)
        for number, (_, row) in enumerate(table.rows, start=1):
            key = str(number) if key_at is None else _normalise_number(row[key_at])
            if key in found.T_b_f:
                raise ValueError(f"{names[key_at or 0]} {key} is there twice")
            try:
                p, values = (_values_of_row(table, row, at) for at in (position, orientation))
                found.T_b_f[key] = pose(convention.matrix(values), p)
                if joints:
                    found.q[key] = _values_of_row(table, row, joints)
            except ValueError as error:
                raise ValueError(f"pose {number}: {error}") from None
        at = [k for k, _ in (*position, *orientation)]
        plain = [_values_of_row(table, row, [(k, 1.0) for k in at]) for _, row in table.rows]
        found.others.update(_other_readings(dict(zip(found.T_b_f, plain, strict=True))))
    return found


def _other_readings(numbers: Mapping[str, Array]) -> dict[str, dict[str, Array]]:
    """Poses that numbers of a file mean, by what to write: of each position and orientation."""
    possible = _plausible_units(one[:3] for one in numbers.values())
    found: dict[str, dict[str, Array]] = {}
    for unit, metres in possible.items():
        for convention in ORIENTATION_CONVENTIONS:
            count = len(convention.columns)
            if any(len(one) != 3 + count for one in numbers.values()):
                continue
            for angle, radians in (RADIANS_PER_UNIT if count == 3 else {"": 1.0}).items():
                columns = (
                    *(f"{axis}_{unit}" for axis in "xyz"),
                    *(f"{axis}_{angle}".rstrip("_") for axis in convention.columns),
                )
                with suppress(ValueError):  # no quaternion
                    found[f"as {convention.meaning}: name the columns {', '.join(columns)}"] = {
                        key: pose(convention.matrix(radians * one[3:]), metres * one[:3])
                        for key, one in numbers.items()
                    }
    return found


def _plausible_units(positions: Iterable[Array]) -> dict[str, float]:
    """Metres per unit, by its name, of units in which an arm reaches so far: one or none."""
    away = float(np.median([np.linalg.norm(one) for one in positions]))
    nearest, farthest = PLAUSIBLE_REACH
    return {u: m for u, m in METRES_PER_UNIT.items() if nearest < m * away < farthest}


def read_points(file: Path, joints: int = 0) -> tuple[Array, Array]:
    """Read points, shape (n, 3), metres, and the joint angles at each, shape (n, joints), radians.

    Parameters
    ----------
    file : Path
        CSV with columns ``x_mm, y_mm, z_mm`` (or m, um) and, of `joints`, ``q1_deg``, ``q2_deg``
        (or rad) and so on.
    joints : int, optional
        Of the arm, if the points were measured on it.

    Raises
    ------
    ConfigurationError
        As `read_flange_poses` does.
    """
    with explain_unreadable_table(file):
        names, table = _read_table(file)
        position = _find_position_columns(names)
        angles = _find_joint_columns(names) if joints else []
        if len(angles) != joints:
            raise ValueError(
                f"the arm has {joints} joints, and the points have {len(angles)} joint angles "
                "beside them: columns q1_deg, q2_deg and so on"
            )
        try:
            both = np.array(
                [_values_of_row(table, row, position + angles) for _, row in table.rows]
            )
        except ValueError as error:
            raise ValueError(f"is no table of numbers: {error}") from None
        return both[:, :3], both[:, 3:]


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
    keys = [_normalise_number(_number_in_name(name)) for name in profiles]
    if not poses.with_key:
        if len(profiles) != len(poses.T_b_f):
            raise ConfigurationError(
                f"holds {len(poses.T_b_f)} poses for {len(profiles)} profiles, and no column "
                f"({', '.join(PROFILE_COLUMNS)}) that shows which belongs to which",
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


def _number_in_name(name: str) -> str:
    """The last word of a profile's name, or the last number of the file that it is alone in."""
    found = _FILE_NUMBER.search(name)
    return name.split()[-1] if found is None else found[1]


def _read_text(file: Path, errors: str = "strict") -> str:
    return read_small_file(file, MAX_POSE_LIST_BYTES, "a list of poses").decode("utf-8-sig", errors)


def _read_table(file: Path) -> tuple[list[str], TextTable]:
    """Lower-case names of the header, and the rows below it, of as many cells."""
    table = parse_text_table(_read_text(file))
    if len(table.rows) < 2:
        raise ValueError("holds nothing below a header")
    (_, header), *rows = table.rows
    names = [cell.lower() for cell in header]
    for number, (_, row) in enumerate(rows, start=1):
        if len(row) != len(names):
            raise ValueError(
                f"row {number} below the header has {len(row)} columns, the header {len(names)}"
            )
    return names, replace(table, rows=tuple(rows))


def _find_position_columns(names: Sequence[str], unit: str = "") -> Columns:
    columns = _find_columns(names, ("x", "y", "z"), METRES_PER_UNIT, unit)
    if columns is None:
        raise ValueError(f"has no columns x_mm, y_mm, z_mm (found: {', '.join(names[:12])})")
    return columns


def _find_orientation_columns(names: Sequence[str]) -> tuple[OrientationConvention, Columns]:
    """Convention that the header names, and its columns."""
    found = []
    for convention in ORIENTATION_CONVENTIONS:
        units = {} if len(convention.columns) == 4 else RADIANS_PER_UNIT
        columns = _find_columns(names, convention.columns, units, convention.angle_unit)
        if columns is not None:
            found.append((convention, columns))
    if len(found) != 1:
        raise ValueError(
            "needs the columns of one orientation: qx, qy, qz, qw, or q1, q2, q3, q4 (ABB), or "
            "w_deg, p_deg, r_deg (FANUC), or a_deg, b_deg, c_deg (KUKA), or rx_deg, ry_deg, rz_deg "
            f"(UR) (found: {', '.join(names[:12])})"
        )
    return found[0]


def _find_columns(
    names: Sequence[str], axes: Sequence[str], units: Mapping[str, float], unit: str = ""
) -> Columns | None:
    """Columns of the axes, `unit` counting if none is named; None if an axis has no column."""
    found: Columns = []
    for axis in axes:
        known = {f"{axis}_{name}": scale for name, scale in units.items()} or {axis: 1.0}
        if unit and known.keys().isdisjoint(names):
            known[axis] = units[unit]
        found += [(i, known[name]) for i, name in enumerate(names) if name in known][:1]
    return found if len(found) == len(axes) else None


def _find_joint_columns(names: Sequence[str]) -> Columns:
    """Columns ``q1_deg``, ``q2_deg`` and so on; as many as there are."""
    found: Columns = []
    while (one := _find_columns(names, (f"q{len(found) + 1}",), RADIANS_PER_UNIT)) is not None:
        found += one
    return found


def _values_of_row(table: TextTable, row: Sequence[str], columns: Columns) -> Array:
    """Numbers of a row in SI units."""
    values = []
    for k, scale in columns:
        value = table.parse_number(row[k])
        if value is None or not math.isfinite(value):
            raise ValueError(f"{row[k]!r} is no finite number")
        values.append(scale * value)
    return np.array(values)


def _normalise_number(cell: str) -> str:
    """The same word for 1, 1.0 and 1.000000."""
    try:
        value = float(cell)
    except ValueError:
        return cell.strip()
    return str(int(value)) if value.is_integer() else str(value)
