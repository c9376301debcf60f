"""Simple solids that stand for things: what an arm must keep clear of, and what it carries."""

from __future__ import annotations

from dataclasses import dataclass

from tjscan.core.frames import Array, frozen_arrays


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
        Its pose: in frame b where it stands in the cell, in frame f where the arm carries it.
    """

    name: str
    shape: SolidShape
    T: Array
