"""Words of URScript that calculate: functions of numbers, of lists and of poses."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from tjscan.core.frames import inverse_pose, pose
from tjscan_loopback.ur.urscript.tokens import ScriptError
from tjscan_loopback.ur.urscript.values import (
    Pose,
    finite,
    integer,
    number,
    numbers,
    pose_matrix,
    pose_of_matrix,
    six,
)


def pose_trans(p_from: Any, p_from_to: Any) -> Pose:
    """Pose `p_from_to`, which is given in frame `p_from`, in the outer frame."""
    return pose_of_matrix(pose_matrix(p_from, "p_from") @ pose_matrix(p_from_to, "p_from_to"))


def pose_inv(p_from: Any) -> Pose:
    """Inverse of a pose."""
    return pose_of_matrix(inverse_pose(pose_matrix(p_from, "p_from")))


def pose_add(p_1: Any, p_2: Any) -> Pose:
    """Sum of two poses: of their positions, and their turns one after the other, in base axes."""
    one, two = pose_matrix(p_1, "p_1"), pose_matrix(p_2, "p_2")
    return pose_of_matrix(pose(one[:3, :3] @ two[:3, :3], one[:3, 3] + two[:3, 3]))


def pose_sub(p_to: Any, p_from: Any) -> Pose:
    """What turns and moves one pose to another: difference of positions, turn in base axes."""
    one, two = pose_matrix(p_to, "p_to"), pose_matrix(p_from, "p_from")
    return pose_of_matrix(pose(two[:3, :3].T @ one[:3, :3], one[:3, 3] - two[:3, 3]))


def pose_dist(p_from: Any, p_to: Any) -> float:
    """Distance of two poses: metres and radians together."""
    return float(np.linalg.norm(six(pose_sub(p_to, p_from), "p_to")))


def point_dist(p_from: Any, p_to: Any) -> float:
    """Distance of the positions of two poses, metres."""
    return float(np.linalg.norm((six(p_to, "p_to") - six(p_from, "p_from"))[:3]))


def interpolate_pose(p_from: Any, p_to: Any, alpha: Any) -> Pose:
    """Pose between two others: `p_from` if alpha is 0, `p_to` if it is 1."""
    one, two, share = (
        pose_matrix(p_from, "p_from"),
        pose_matrix(p_to, "p_to"),
        finite(alpha, "alpha"),
    )
    turn = Slerp([0, 1], Rotation.from_matrix(np.array([one[:3, :3], two[:3, :3]])))
    R = turn(min(max(share, 0.0), 1.0)).as_matrix()
    return pose_of_matrix(pose(R, one[:3, 3] + share * (two[:3, 3] - one[:3, 3])))


def rotvec2rpy(rotvec: Any) -> tuple[float, ...]:
    """Roll, pitch and yaw (about fixed axes) of a rotation vector, radians."""
    return numbers(Rotation.from_rotvec(_three(rotvec)).as_euler("xyz"))


def rpy2rotvec(rpy: Any) -> tuple[float, ...]:
    """Rotation vector of roll, pitch and yaw, radians."""
    return numbers(Rotation.from_euler("xyz", _three(rpy)).as_rotvec())


def norm(value: Any) -> float:
    """Length of a list, or absolute value of a number."""
    if isinstance(value, tuple):
        return math.sqrt(math.fsum(number(x) ** 2 for x in value))
    return abs(number(value))


def length(value: Any) -> int:
    """Number of a list's or text's items."""
    if not isinstance(value, tuple | str):
        raise ScriptError(f"{value!r} has no length")
    return len(value)


def to_str(value: Any) -> str:
    """A value as a text."""
    return str(value)


def _three(value: Any) -> tuple[float, ...]:
    if not isinstance(value, tuple) or len(value) != 3:
        raise ScriptError(f"three numbers are wanted (found {value!r})")
    return tuple(finite(x, "each") for x in value)


def _of_numbers(function: Callable[..., float]) -> Callable[..., float]:
    return lambda *values: function(*(number(value) for value in values))


CALCULATION_WORDS: Final[dict[str, Callable[..., Any]]] = {
    **{
        name: _of_numbers(getattr(math, name))
        for name in ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "pow")
    },
    "floor": lambda value: math.floor(number(value)),
    "ceil": lambda value: math.ceil(number(value)),
    "log": lambda base, value: math.log(number(value), number(base)),
    "d2r": _of_numbers(math.radians),
    "r2d": _of_numbers(math.degrees),
    "integer_to_binary_list": lambda value: tuple(
        bool(integer(value) >> bit & 1) for bit in range(32)
    ),
    **{
        word.__name__: word
        for word in (
            *(pose_trans, pose_inv, pose_add, pose_sub, pose_dist, point_dist, interpolate_pose),
            *(rotvec2rpy, rpy2rotvec, norm, length, to_str),
        )
    },
}
"""Words by name."""
