"""A joint's dimensions, as the core knows them: metres and radians."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import ArrayLike

from tjscan.core.frames import Array
from tjscan.joint.geometry import LegSurface
from tjscan.joint.imperfections import NO_IMPERFECTIONS, Imperfections, interpolate_around_joint
from tjscan.joint.oval import Ellipse, OvalLegSurface, semi_axes_same_circumference


@dataclass(frozen=True, slots=True)
class FitUpTolerance:
    """Largest difference of a measured fit-up from its drawing, to either side; metres, radians.

    Parameters
    ----------
    groove_angle : float
        Radians.
    root_opening : float
        Also of the root bead's width, if one is laid.
    root_face, depth : float
    high_low : float
        By which brace or leg may stand out of where they are drawn, or in.
    """

    groove_angle: float = inf
    root_opening: float = inf
    root_face: float = inf
    depth: float = inf
    high_low: float = inf


NOT_STATED = FitUpTolerance()
"""Of a drawing that states none."""


@dataclass(frozen=True, slots=True)
class JointDefinition:
    """Definition of a tubular joint: dimensions of leg, brace and groove; metres and radians.

    Parameters
    ----------
    name : str
        What its files are called.
    leg_radius, leg_wall, leg_length : float
        Outer radius, wall thickness, and length, half to either side of the brace's axis.
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
    imperfections : Imperfections
        What makes the joint as built differ from its drawing, which all else describes.
    tolerance : FitUpTolerance
        How far its fit-up may be from the drawing.
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
    imperfections: Imperfections = NO_IMPERFECTIONS
    tolerance: FitUpTolerance = NOT_STATED

    @property
    def leg_surface(self) -> LegSurface:
        """Outer surface of the leg."""
        oval = self.imperfections.leg_ovality
        if oval.ovality == 0:
            return LegSurface(self.leg_radius, self.angle)
        return OvalLegSurface.from_ovality(self.leg_radius, self.angle, oval.ovality, oval.widest)

    @property
    def brace_inner_radius(self) -> float:
        """Radius of the brace's bore."""
        return self.brace_radius - self.brace_wall

    def groove_angle_at(self, dihedral: ArrayLike) -> Array:
        """Prescribed groove angle where the local dihedral angle is `dihedral`."""
        at, angle = np.transpose(self.groove_table)
        return np.asarray(np.interp(np.asarray(dihedral, dtype=float), at, angle))

    def brace_wall_radius(self, phi: Array, z: ArrayLike) -> Array:
        """Distance of the brace's outer wall from its nominal axis at azimuths and heights, (n,).

        Parameters
        ----------
        phi : ndarray, shape (n,)
            Azimuths in radians.
        z : array_like, shape (n,) or ()
            In frame j, in metres.
        """
        if self.imperfections.is_brace_nominal:
            return np.full_like(phi, self.brace_radius)
        oval, off = self.imperfections.brace_ovality, self.imperfections.misfit
        lean = np.tan(off.tilt) * np.broadcast_to(z, phi.shape)
        centre = np.outer(
            np.ones_like(phi),
            off.offset * np.array((np.cos(off.offset_towards), np.sin(off.offset_towards))),
        ) + np.outer(lean, (np.cos(off.tilt_towards), np.sin(off.tilt_towards)))
        ellipse = Ellipse(
            *semi_axes_same_circumference(self.brace_radius, oval.ovality), oval.widest
        )
        return ellipse.radius_in_direction(phi, centre)

    def root_opening_at(self, phi: Array) -> ArrayLike:
        """Distance of the land from the leg at azimuths, in metres, shape (n,) or ()."""
        more = self.imperfections.root.opening
        return (
            self.root_gap if more == (0.0,) else self.root_gap + interpolate_around_joint(more, phi)
        )
