"""Poses as arms write them: the meaning of each maker's numbers, and programs with poses."""

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


def _from_quaternion(wxyz: Array) -> Array:
    length = float(np.linalg.norm(wxyz))
    if not abs(length - 1) < QUATERNION_NORM_TOLERANCE:
        raise ValueError(f"its quaternion has length {length:.3f}, not 1")
    return np.asarray(matrix_from_quaternion(wxyz / length))


FANUC_CONVENTION: Final = OrientationConvention(
    ("w", "p", "r"),
    "FANUC W P R: about the fixed x, y, z axes in turn, R = Rz(R) Ry(P) Rx(W)",
    lambda wpr: np.asarray(matrix_from_euler(wpr, 0, 1, 2, extrinsic=True)),
    length_unit="mm",
    angle_unit="deg",
)
KUKA_CONVENTION: Final = OrientationConvention(
    ("a", "b", "c"),
    "KUKA A B C: about the moving z, y, x axes in turn, R = Rz(A) Ry(B) Rx(C)",
    lambda abc: np.asarray(matrix_from_euler(abc, 2, 1, 0, extrinsic=False)),
    length_unit="mm",
    angle_unit="deg",
)
ORIENTATION_CONVENTIONS: Final = (
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
    FANUC_CONVENTION,
    KUKA_CONVENTION,
    OrientationConvention(
        ("rx", "ry", "rz"),
        "UR rotation vector: along the axis, as long as the angle",
        lambda vector: np.asarray(matrix_from_compact_axis_angle(vector)),
        length_unit="m",
        angle_unit="rad",
    ),
)
"""Distinguished by the names of their columns."""

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
