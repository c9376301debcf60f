"""Simple solids in place of things: what an arm must keep clear of, and what it carries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Gt, Le, MinLen

from tjscan.core.frames import Array, frozen_arrays
from tjscan.core.units import FARTHEST_MM, MM, EulerAngles, PoseSettings


@dataclass(frozen=True, slots=True)
class Box:
    """A box about its frame's origin.

    Parameters
    ----------
    size : tuple of float
        Lengths of its edges along x, y, z in metres.
    """

    size: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A cylinder about its frame's z axis, its middle at the origin.

    Parameters
    ----------
    radius, length : float
        Metres.
    """

    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class Capsule:
    """All that is within `radius` of a segment on the frame's z axis, its middle at the origin.

    Parameters
    ----------
    radius : float
        Metres.
    length : float
        Of the segment, in metres; the round ends come on top.
    """

    radius: float
    length: float


SolidShape = Box | Cylinder | Capsule


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class Solid:
    """A solid body: a shape, its pose and its name.

    Parameters
    ----------
    name : str
        What a refusal calls it.
    shape : Box, Cylinder or Capsule
        What it is like.
    T : ndarray, shape (4, 4)
        Its pose: in frame b of a solid in the cell, in frame f of one that the arm carries.
    """

    name: str
    shape: SolidShape
    T: Array


_LengthMm = Annotated[float, Gt(0), Le(FARTHEST_MM)]


@dataclass(frozen=True, slots=True, kw_only=True)
class SolidSettings(PoseSettings):
    """Settings of a simple solid; the axis of a cylinder or capsule is the z axis of its frame.

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
