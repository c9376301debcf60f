"""Poses as arms write them: what each maker's numbers mean, and the programs that hold them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from pytransform3d.rotations import (
    matrix_from_compact_axis_angle,
    matrix_from_euler,
    matrix_from_quaternion,
)

from tjscan.core.frames import Array, pose

QUATERNION_NORM_TOLERANCE: Final = 0.01
"""A quaternion whose length is further from one is not one."""


@dataclass(frozen=True, slots=True)
class OrientationConvention:
    """What the numbers of an orientation mean.

    Parameters
    ----------
    columns : tuple of str
        Names of the columns, without units.
    meaning : str
        For messages.
    matrix : callable
        From the numbers (radians) to a rotation matrix, shape (3, 3).
    length_unit, angle_unit : str
        Of columns whose names state none, as the arm writes them; nothing where a unit must be
        stated.
    """

    columns: tuple[str, ...]
    meaning: str
    matrix: Callable[[Array], Array]
    length_unit: str = ""
    angle_unit: str = ""


def _from_quaternion(wxyz: Array) -> Array:
    length = float(np.linalg.norm(wxyz))
    if not abs(length - 1) < QUATERNION_NORM_TOLERANCE:
        raise ValueError(f"its quaternion has length {length:.3f}, not 1")
    return np.asarray(matrix_from_quaternion(wxyz / length))


def _from_zyx(abc: Array) -> Array:
    return np.asarray(matrix_from_euler(abc, 2, 1, 0, extrinsic=False))


def _from_fixed_xyz(wpr: Array) -> Array:
    return np.asarray(matrix_from_euler(wpr, 0, 1, 2, extrinsic=True))


def _from_rotation_vector(vector: Array) -> Array:
    return np.asarray(matrix_from_compact_axis_angle(vector))


CONVENTIONS: Final = (
    OrientationConvention(
        ("qx", "qy", "qz", "qw"),
        "quaternion, scalar last",
        lambda q: _from_quaternion(np.roll(q, 1)),
    ),
    OrientationConvention(
        ("q1", "q2", "q3", "q4"),
        "ABB quaternion, scalar first",
        _from_quaternion,
        length_unit="mm",
    ),
    OrientationConvention(
        ("w", "p", "r"),
        "FANUC W P R: about the fixed x, y, z axes in turn, R = Rz(R) Ry(P) Rx(W)",
        _from_fixed_xyz,
        length_unit="mm",
        angle_unit="deg",
    ),
    OrientationConvention(
        ("a", "b", "c"),
        "KUKA A B C: about the moving z, y, x axes in turn, R = Rz(A) Ry(B) Rx(C)",
        _from_zyx,
        length_unit="mm",
        angle_unit="deg",
    ),
    OrientationConvention(
        ("rx", "ry", "rz"),
        "UR rotation vector: along the axis, as long as the angle",
        _from_rotation_vector,
        length_unit="m",
        angle_unit="rad",
    ),
)
"""Told apart by the names of their columns."""

FANUC: Final = CONVENTIONS[2]
KUKA: Final = CONVENTIONS[3]

_FANUC_POSITION: Final = re.compile(r"P\[(\d+)[^\]]*\]\s*\{(.*?)\}\s*;", re.DOTALL)
_FANUC_GROUP: Final = re.compile(r"GP\d+\s*:")
_FANUC_FRAMES: Final = re.compile(r"UF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)")
_NUMBER: Final = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_KUKA_POSITION: Final = re.compile(
    r"(?:E6POS|\bPOS|\bFRAME)\s+(\w+)\s*=\s*\{(?:\s*E6POS\s*:|\s*POS\s*:)?([^}]*)\}", re.IGNORECASE
)


def poses_of_fanuc_program(text: str) -> dict[str, Array]:
    """Poses of a FANUC TP program (``.ls``), shape (4, 4) each, by their number.

    Parameters
    ----------
    text : str
        The program; its positions stand behind ``/POS``.

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
        values = [re.search(rf"\b{name}\s*=\s*{_NUMBER}", body) for name in "XYZWPR"]
        if any(value is None for value in values):
            raise ValueError(
                f"P[{number}] holds no X Y Z W P R: teach it as a Cartesian position, not as joints"
            )
        frames |= set(_FANUC_FRAMES.findall(body))
        found[number] = _pose(np.array([float(v[1]) for v in values if v]), FANUC)
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
        values = [re.search(rf"\b{axis}\s+{_NUMBER}", body) for axis in "XYZABC"]
        if any(value is None for value in values):
            continue  # a tool's load, a frame's name
        digits = re.search(r"(\d+)$", name)
        key = digits[1].lstrip("0") or "0" if digits else name
        if key in found:
            raise ValueError(
                f"two positions are numbered {key} ({name}); keep one list in the file"
            )
        found[key] = _pose(np.array([float(v[1]) for v in values if v]), KUKA)
    if not found:
        raise ValueError("holds no positions E6POS, POS or FRAME with X Y Z A B C")
    return found


def _pose(numbers: Array, convention: OrientationConvention) -> Array:
    return pose(convention.matrix(np.radians(numbers[3:])), 1e-3 * numbers[:3])
