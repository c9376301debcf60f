"""A joint's dimensions, and its imperfections as built: metres and radians.

A table ``[imperfections]`` of a joint file holds the imperfections; a joint without it is ideal.
Azimuths run about the brace's axis as everywhere, and clock angles about the leg's axis, from
the line next to the brace towards growing y.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
import scipy  # its parts are loaded at first use
from annotated_types import Ge, Gt, Le, Len
from numpy.typing import ArrayLike

from tjscan.core.frames import Array
from tjscan.core.units import DEG, LIST_OR_WORD_IN_FILE, MM, PER_M, PERCENT_UNIT, SettingsTable
from tjscan.joint.geometry import Ellipse, LegSurface, OvalLegSurface, semi_axes_same_circumference

Azimuth = Annotated[float, Ge(-360.0), Le(360.0), DEG]
ValuesRoundJoint = Annotated[tuple[float, ...], Len(1, 360), MM]
"""Values at even azimuths from 0 on, joined smoothly all round, in metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ovality(SettingsTable):
    """A tube out of round: its section is an ellipse of the same circumference.

    Parameters
    ----------
    ovality : float
        Largest minus smallest outer diameter, as a share of the nominal one.
    widest : float
        Direction of the largest diameter, in radians: an azimuth for the brace, a clock angle
        for the leg.
    """

    ovality: Annotated[float, Ge(0.0), Le(5.0), PERCENT_UNIT] = 0.0
    widest: Azimuth = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BraceMisfit(SettingsTable):
    """Misfit of the brace: its axis off its nominal place.

    Parameters
    ----------
    offset : float
        Shift square to the axis, in metres.
    offset_towards : float
        Azimuth of the shift, in radians.
    tilt : float
        Angle between the axis and its nominal direction, about the nominal crossing of the axes.
        Sections square to the nominal axis stay what they are.
    tilt_towards : float
        Azimuth that the brace leans to, in radians.
    """

    offset: Annotated[float, Ge(0.0), Le(20.0), MM] = 0.0
    offset_towards: Azimuth = 0.0
    tilt: Annotated[float, Ge(0.0), Le(2.0), DEG] = 0.0
    tilt_towards: Azimuth = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RootAsFitted(SettingsTable):
    """Root opening as fitted up, which may differ from the drawing.

    Parameters
    ----------
    is_open : bool
        Whether there is no root bead yet: one looks through the root opening.
    opening : tuple of float
        What the root opening has more (or less) than the nominal one, round the joint.
    bead_height : tuple of float
        How far the root bead's face rises over (or sags below) its chord, round the joint.
    """

    is_open: bool = False
    opening: ValuesRoundJoint = (0.0,)
    bead_height: ValuesRoundJoint = (0.0,)


@dataclass(frozen=True, slots=True, kw_only=True)
class TackWeld(SettingsTable):
    """A tack weld over the root.

    Parameters
    ----------
    at : float
        Azimuth of its middle, in radians.
    length : float
        Along the root, in metres.
    height : float
        How far it rises on bevel and leg beyond the root's corners, in metres.
    """

    at: Azimuth
    length: Annotated[float, Ge(5.0), Le(500.0), MM] = 0.03
    height: Annotated[float, Ge(1.0), Le(30.0), MM] = 0.005


@dataclass(frozen=True, slots=True, kw_only=True)
class SeamWeldCap(SettingsTable):
    """The cap of a seam weld along the leg.

    Parameters
    ----------
    at : float
        Clock angle, in radians.
    width, height : float
        Of the cap, in metres.
    """

    at: Azimuth
    width: Annotated[float, Ge(2.0), Le(60.0), MM] = 0.014
    height: Annotated[float, Gt(0.0), Le(10.0), MM] = 0.0025


@dataclass(frozen=True, slots=True, kw_only=True)
class BevelAsCut(SettingsTable):
    """Bevel as cut, which may differ from the drawing.

    Parameters
    ----------
    facet_angle : float
        Angle between two facets, in radians; positive makes the bevel convex.
    facet_at : float
        Share of the bevel, from the root bead, at which they meet.
    scallop_depth, scallop_length : float
        Of the scallops that flame-cutting leaves, from crest to valley and from crest to crest
        along the section, in metres.
    """

    facet_angle: Annotated[float, Ge(-20.0), Le(20.0), DEG] = 0.0
    facet_at: Annotated[float, Ge(0.1), Le(0.9)] = 0.5
    scallop_depth: Annotated[float, Ge(0.0), Le(2.0), MM] = 0.0
    scallop_length: Annotated[float, Ge(0.5), Le(50.0), MM] = 0.004


@dataclass(frozen=True, slots=True, kw_only=True)
class MillScale(SettingsTable):
    """Mill scale on the tubes' outer sides that has partly flaked off.

    Parameters
    ----------
    thickness : float
        In metres.
    patch : float
        Typical size of a patch, in metres.
    coverage : float
        Share of the surface that it covers.
    seed : int
        Of the places.
    """

    thickness: Annotated[float, Ge(0.0), Le(2.0), MM] = 0.0
    patch: Annotated[float, Ge(1.0), Le(500.0), MM] = 0.01
    coverage: Annotated[float, Gt(0.0), Le(0.99)] = 0.4
    seed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Spatter(SettingsTable):
    """Drops of weld metal on wall, bevel and leg.

    Parameters
    ----------
    density : float
        Drops per metre of groove.
    radius : tuple of float
        Smallest and largest, in metres.
    reach : float
        How far beside the groove they are, in metres.
    seed : int
        Of the places.
    """

    density: Annotated[float, Ge(0.0), Le(2000.0), PER_M] = 0.0
    radius: Annotated[tuple[float, float], MM] = (0.0004, 0.0015)
    reach: Annotated[float, Gt(0.0), Le(200.0), MM] = 0.03
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.radius[0] <= self.radius[1] <= 0.02:
            raise ValueError("radius_mm is the smallest and the largest radius, at most 20 mm")


@dataclass(frozen=True, slots=True, kw_only=True)
class Imperfections(SettingsTable):
    """All that makes a joint differ from its drawing; by default nothing does.

    Parameters
    ----------
    leg_ovality, brace_ovality : Ovality
    misfit : BraceMisfit
    root : RootAsFitted
    bevel : BevelAsCut
    tacks : tuple of TackWeld
    seams : tuple of SeamWeldCap
    scale : MillScale
    spatter : Spatter
    """

    leg_ovality: Ovality = Ovality()
    brace_ovality: Ovality = Ovality()
    misfit: BraceMisfit = BraceMisfit()
    root: RootAsFitted = RootAsFitted()
    bevel: BevelAsCut = BevelAsCut()
    tacks: Annotated[tuple[TackWeld, ...], Len(0, 200), LIST_OR_WORD_IN_FILE] = ()
    seams: Annotated[tuple[SeamWeldCap, ...], Len(0, 8), LIST_OR_WORD_IN_FILE] = ()
    scale: MillScale = MillScale()
    spatter: Spatter = Spatter()

    @property
    def is_brace_nominal(self) -> bool:
        """Whether the brace is a round tube in its nominal place."""
        return self.brace_ovality.ovality == self.misfit.offset == self.misfit.tilt == 0


NO_IMPERFECTIONS: Final = Imperfections()
"""A joint as drawn."""


def interpolate_around_joint(values: tuple[float, ...], phi: Array) -> Array:
    """Interpolate values at even azimuths to azimuths, shape (n,): a periodic cubic spline."""
    if len(values) == 1:
        return np.full_like(phi, values[0])
    at = np.linspace(0, 2 * np.pi, len(values) + 1)
    spline = scipy.interpolate.CubicSpline(at, (*values, values[0]), bc_type="periodic")
    return np.asarray(spline(np.mod(phi, 2 * np.pi)))


_TolerableLength = Annotated[float | None, Gt(0), Le(100), MM]


@dataclass(frozen=True, slots=True, kw_only=True)
class FitUpTolerance(SettingsTable):
    """The table [tolerance] of a joint's file: how far its fit-up may be from what is drawn.

    To either side, in metres and radians; None if it is not stated.

    Parameters
    ----------
    groove_angle : float, optional
        Of the angle between bevel and leg, radians.
    root_opening : float, optional
        Also of the root bead's width, if one is laid.
    root_face, depth : float, optional
        Of the land's height, and of the groove from its root to its opening.
    high_low : float, optional
        By which brace or leg may be further out than drawn, or further in.
    """

    groove_angle: Annotated[float | None, Gt(0), Le(90), DEG] = None
    root_opening: _TolerableLength = None
    root_face: _TolerableLength = None
    depth: _TolerableLength = None
    high_low: _TolerableLength = None


NO_TOLERANCE_STATED = FitUpTolerance()
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
    root_opening : float
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
    root_opening: float
    root_face: float
    root_bead: float
    imperfections: Imperfections = NO_IMPERFECTIONS
    tolerance: FitUpTolerance = NO_TOLERANCE_STATED

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

    def groove_angle_for_dihedral(self, dihedral: ArrayLike) -> Array:
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
        towards = np.array((np.cos(off.offset_towards), np.sin(off.offset_towards)))
        centre = np.outer(np.ones_like(phi), off.offset * towards)
        centre = centre + np.outer(lean, (np.cos(off.tilt_towards), np.sin(off.tilt_towards)))
        semi_axes = semi_axes_same_circumference(self.brace_radius, oval.ovality)
        return Ellipse(*semi_axes, oval.widest).radius_in_direction(phi, centre)

    def root_opening_at(self, phi: Array) -> ArrayLike:
        """Distance of the land from the leg at azimuths, in metres, shape (n,) or ()."""
        more = self.imperfections.root.opening
        if more == (0.0,):
            return self.root_opening
        return self.root_opening + interpolate_around_joint(more, phi)
