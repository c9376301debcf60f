"""Numbers and poses as JSON messages hold them, checked when they are read."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np

from tjscan.core.frames import Array, readonly_copy

LARGEST_NUMBER: Final = 1e9
"""Metres, radians or seconds: what is larger was not measured."""

ORTHONORMALITY_TOLERANCE: Final = 1e-6
"""How far from a rotation the axes of a pose may be that was written to the last digit."""


def pose_to_list(T: Array) -> list[float]:
    """The sixteen numbers of a pose, row by row."""
    flat: list[float] = np.asarray(T, dtype=float).ravel().tolist()
    return flat


def pose_from_list(values: Any) -> Array:
    """The pose of sixteen numbers, shape (4, 4).

    Raises
    ------
    ValueError, TypeError
        If they are no pose.
    """
    numbers = to_finite_floats(values)
    if len(numbers) != 16:
        raise ValueError(f"a pose has 16 numbers, not {len(numbers)}")
    T = readonly_copy(np.reshape(numbers, (4, 4)))
    if not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=ORTHONORMALITY_TOLERANCE):
        raise ValueError("a pose has axes of length one, square to each other")
    if not np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0)):
        raise ValueError("the last row of a pose is 0 0 0 1")
    return T


def to_finite_floats(values: Iterable[Any]) -> list[float]:
    """Convert values to floats; refuse what is not finite, or larger than can be measured.

    Raises
    ------
    ValueError, TypeError
        If one is none, or is not finite, or is beyond `LARGEST_NUMBER`.
    """
    numbers = [float(value) for value in values]
    if not all(abs(number) <= LARGEST_NUMBER for number in numbers):
        raise ValueError(f"numbers that nothing measures: {numbers[:16]}")
    return numbers
