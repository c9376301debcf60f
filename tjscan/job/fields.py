"""The words that job files share: lengths, vectors, poses."""

from __future__ import annotations

from typing import Annotated, Final

import numpy as np
from pydantic import Field

from tjscan.core.config import FileModel
from tjscan.core.frames import Array, from_euler_zyx

FARTHEST_MM: Final = 1e5
"""A hundred metres: nothing in a cell is further."""

Coordinate = Annotated[float, Field(ge=-FARTHEST_MM, le=FARTHEST_MM)]

Vector3 = Annotated[tuple[Coordinate, Coordinate, Coordinate], Field(strict=False)]

Fraction = Annotated[float, Field(ge=0, le=1)]

JointAngle = Annotated[float, Field(ge=-720, le=720)]

Length = Annotated[float, Field(gt=0, le=FARTHEST_MM)]

Lengths = Annotated[tuple[Length, ...], Field(strict=False, max_length=20)]


class PoseTable(FileModel):
    """A pose as controllers show it: position and Z-Y-X Euler angles."""

    position_mm: Vector3
    euler_zyx_deg: Vector3

    @property
    def T(self) -> Array:
        """The pose, shape (4, 4), metres."""
        return from_euler_zyx(
            1e-3 * np.array(self.position_mm), np.radians(np.array(self.euler_zyx_deg))
        )
