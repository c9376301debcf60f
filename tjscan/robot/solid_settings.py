"""Simple solids as files state them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Gt, Le, MinLen

from tjscan.core.units import FARTHEST_MM, MM, EulerAngles, PoseSettings
from tjscan.robot.solids import Box, Capsule, Cylinder, Solid, SolidShape

_LengthMm = Annotated[float, Gt(0), Le(FARTHEST_MM)]


@dataclass(frozen=True, slots=True, kw_only=True)
class SolidSettings(PoseSettings):
    """Settings of a simple solid; cylinder and capsule lie along the z axis of its frame.

    Parameters
    ----------
    name : str
        What messages call it.
    kind : str
        Box, cylinder or capsule.
    size : tuple of float, optional
        Of a box along x, y and z, metres.
    radius, length : float, optional
        Of a cylinder or capsule, metres.
    """

    euler_zyx: EulerAngles = (0.0, 0.0, 0.0)
    name: Annotated[str, MinLen(1)]
    kind: Literal["box", "cylinder", "capsule"]
    size: Annotated[tuple[_LengthMm, _LengthMm, _LengthMm] | None, MM] = None
    radius: Annotated[_LengthMm | None, MM] = None
    length: Annotated[_LengthMm | None, MM] = None

    def __post_init__(self) -> None:
        is_box = self.kind == "box"
        round_sizes = (self.radius, self.length)
        if is_box != (self.size is not None) or any(is_box != (s is None) for s in round_sizes):
            raise ValueError(
                f"a {self.kind} takes {'size_mm' if is_box else 'radius_mm and length_mm'} alone"
            )

    @property
    def solid(self) -> Solid:
        """The solid as collision checks take it, in its place."""
        return Solid(self.name, self._shape, self.T)

    @property
    def _shape(self) -> SolidShape:
        if self.size is not None:
            return Box(self.size)
        shape = Cylinder if self.kind == "cylinder" else Capsule
        return shape(self.radius or 0.0, self.length or 0.0)
