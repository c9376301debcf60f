"""Values of URScript: numbers, truth values, texts, lists and poses; none of them ever changes."""

from __future__ import annotations

import operator
from collections.abc import Callable
from math import fmod, isfinite
from typing import Any, Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.frames import Array
from tjscan_loopback.ur.urscript.tokens import ScriptError


class Pose(tuple[float, ...]):
    """A pose: a position in metres and a rotation vector in radians, six numbers."""

    __slots__ = ()


_ARITHMETIC_SIGNS: Final[dict[str, Callable[[float, float], float]]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "%": fmod,
    "<": operator.lt,
    ">": operator.gt,
    "<=": operator.le,
    ">=": operator.ge,
}


def calculate(sign: str, left: Any, right: Any) -> Any:
    """Result of an operation on two numbers, or of comparing two values for equality."""
    if sign in ("==", "!="):
        return (left == right) == (sign == "==")
    return _ARITHMETIC_SIGNS[sign](number(left), number(right))


def number(value: Any) -> float:
    """A value as a number; raises ScriptError if it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ScriptError(f"a number is wanted (found {value!r})")
    return value


def integer(value: Any) -> int:
    """A value as a whole number; raises ScriptError if it is none."""
    if number(value) != int(value):
        raise ScriptError(f"a whole number is wanted (found {value!r})")
    return int(value)


def finite(value: Any, name: str, *, least: float | None = None) -> float:
    """A value as a finite number, above `least` where that is given; else ScriptError."""
    found = float(number(value))
    if not isfinite(found) or (least is not None and found <= least):
        above = "" if least is None else f" above {least:g}"
        raise ScriptError(f"{name} is a finite number{above} (found {value!r})")
    return found


def truth(value: Any) -> bool:
    """A value as a truth value: numbers are true unless zero."""
    if isinstance(value, bool | int | float):
        return bool(value)
    raise ScriptError(f"True or False is wanted (found {value!r})")


def item(value: Any, index: Any) -> Any:
    """Item of a list or pose; raises ScriptError if it has none there."""
    if not isinstance(value, tuple):
        raise ScriptError(f"{value!r} has no items")
    i = integer(index)
    if not 0 <= i < len(value):
        raise ScriptError(f"there is no item {i} in {value!r}")
    return value[i]


def with_item(value: Any, index: Any, new: Any) -> Any:
    """A list or pose with one item replaced; raises ScriptError if it has none there."""
    item(value, index)
    i = integer(index)
    return type(value)((*value[:i], new, *value[i + 1 :]))


def six(value: Any, name: str) -> Array:
    """Six finite numbers, shape (6,), of a list or pose; else ScriptError."""
    if not isinstance(value, tuple) or len(value) != 6:
        raise ScriptError(f"{name} is six numbers (found {value!r})")
    return np.array([finite(number_, name) for number_ in value])


def pose_matrix(value: Any, name: str) -> Array:
    """Matrix of a pose, shape (4, 4); raises ScriptError if it is none."""
    if not isinstance(value, Pose):
        raise ScriptError(f"{name} is a pose (found {value!r})")
    return pose_vector.pose_from_vector(six(value, name))


def pose_of_matrix(T: Array) -> Pose:
    """Pose of a matrix, shape (4, 4)."""
    return Pose(pose_vector.pose_to_vector(T).tolist())


def numbers(values: Array) -> tuple[float, ...]:
    """List of the numbers of an array, shape (n,)."""
    return tuple(float(value) for value in values)
