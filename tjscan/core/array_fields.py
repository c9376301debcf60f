"""Types of recorded fields: arrays with their shape, and numbers that may be unknown.

An annotation states the form of an array once; whatever writes and reads the dataclass follows it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tjscan.core.frames import Array


@dataclass(frozen=True, slots=True)
class ArrayForm:
    """Form of the numbers in a field.

    Parameters
    ----------
    shape : tuple of int
        Of the array, -1 for a length that varies; empty for a single number.
    may_be_unknown : bool
        Whether numbers may be NaN.
    is_pose : bool
        Whether it is the pose of a frame.
    """

    shape: tuple[int, ...] = (-1,)
    may_be_unknown: bool = False
    is_pose: bool = False


PoseMatrix = Annotated[Array, ArrayForm((4, 4), is_pose=True)]
FloatOrNan = Annotated[float, ArrayForm((), may_be_unknown=True)]
PlanarPoints = Annotated[Array, ArrayForm((-1, 2))]
PlanarPoses = Annotated[Array, ArrayForm((-1, 3))]
"""Rows of two numbers, such as x and y; and of three, such as x, y and heading."""
