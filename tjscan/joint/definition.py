"""A joint's dimensions, as the core knows them: metres and radians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tjscan.core.frames import Array
from tjscan.joint.geometry import LegSurface


@dataclass(frozen=True, slots=True)
class JointDefinition:
    """A tubular joint in metres and radians; `tjscan.joint.checks.check` tells if it can be built.

    Parameters
    ----------
    name : str
        What its files are called.
    leg_radius, leg_wall, leg_length : float
        Outer radius, wall thickness, and length, which lies evenly about the brace's axis.
    brace_radius, brace_wall, brace_length : float
        Outer radius, wall thickness, and distance from where the axes cross to the free end.
    angle : float
        Between the axes, on the heel side.
    groove_table : tuple of (float, float)
        Local dihedral angle at the brace's outer wall, growing, and groove angle there.
        Between them the groove angle is interpolated, beyond them it stays.
    root_gap : float
        Distance of the land from the leg, square to the leg.
    root_face : float
        The land's share of the brace's wall.
    root_bead : float
        How far the root bead rises on the bevel, from the land's edge.
    """

    name: str
    leg_radius: float
    leg_wall: float
    leg_length: float
    brace_radius: float
    brace_wall: float
    brace_length: float
    angle: float
    groove_table: tuple[tuple[float, float], ...]
    root_gap: float
    root_face: float
    root_bead: float

    @property
    def leg(self) -> LegSurface:
        """The leg's outer surface."""
        return LegSurface(self.leg_radius, self.angle)

    @property
    def brace_inner_radius(self) -> float:
        """Radius of the brace's bore."""
        return self.brace_radius - self.brace_wall

    def groove_angle(self, dihedral: ArrayLike) -> Array:
        """Prescribed groove angle where the local dihedral angle is `dihedral`."""
        at, angle = np.transpose(self.groove_table)
        return np.asarray(np.interp(np.asarray(dihedral, dtype=float), at, angle))
