"""A joint's dimensions: as a TOML file in millimetres and degrees, and as the core knows them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, Strict

from tjscan.config import FileModel, read_toml, validate
from tjscan.errors import ConfigurationError
from tjscan.frames import Array
from tjscan.joint.checks import check
from tjscan.joint.geometry import LegSurface

MM = 1e-3

Length = Annotated[float, Field(gt=0.0, le=20_000.0)]
Small = Annotated[float, Field(ge=0.0, le=100.0)]
Pair = Annotated[tuple[float, float], Strict(False)]  # TOML knows lists only


@dataclass(frozen=True, slots=True)
class JointDefinition:
    """A tubular joint that can be built, in metres and radians.

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

    Raises
    ------
    ConfigurationError
        If such a joint can't be built; its key is the one of a joint file.
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

    def __post_init__(self) -> None:
        check(self)

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


class LegTable(FileModel):
    """``[leg]``: the member that runs through."""

    outer_diameter_mm: Length
    wall_mm: Length
    length_mm: Length


class BraceTable(FileModel):
    """``[brace]``: the member that is welded on. Its length runs from where the axes cross."""

    outer_diameter_mm: Length
    wall_mm: Length
    length_mm: Length
    angle_deg: float = 90.0


class GrooveTable(FileModel):
    """``[groove]``: the prepared brace end and the root bead."""

    angle_deg: Annotated[tuple[Pair, ...], Strict(False)]
    root_gap_mm: Small
    root_face_mm: Small
    root_bead_mm: Small


class JointFile(FileModel):
    """A joint as its TOML file tells it, in millimetres and degrees."""

    leg: LegTable
    brace: BraceTable
    groove: GrooveTable

    @classmethod
    def of(cls, definition: JointDefinition) -> Self:
        """The file that defines a joint."""
        d = definition
        return cls(
            leg=LegTable(
                outer_diameter_mm=_mm(2 * d.leg_radius),
                wall_mm=_mm(d.leg_wall),
                length_mm=_mm(d.leg_length),
            ),
            brace=BraceTable(
                outer_diameter_mm=_mm(2 * d.brace_radius),
                wall_mm=_mm(d.brace_wall),
                length_mm=_mm(d.brace_length),
                angle_deg=_deg(d.angle),
            ),
            groove=GrooveTable(
                angle_deg=tuple((_deg(psi), _deg(groove)) for psi, groove in d.groove_table),
                root_gap_mm=_mm(d.root_gap),
                root_face_mm=_mm(d.root_face),
                root_bead_mm=_mm(d.root_bead),
            ),
        )

    def definition(self, name: str) -> JointDefinition:
        """The joint, in metres and radians.

        Raises
        ------
        ConfigurationError
            If such a joint can't be built.
        """
        leg, brace, groove = self.leg, self.brace, self.groove
        return JointDefinition(
            name=name,
            leg_radius=leg.outer_diameter_mm / 2 * MM,
            leg_wall=leg.wall_mm * MM,
            leg_length=leg.length_mm * MM,
            brace_radius=brace.outer_diameter_mm / 2 * MM,
            brace_wall=brace.wall_mm * MM,
            brace_length=brace.length_mm * MM,
            angle=float(np.deg2rad(brace.angle_deg)),
            groove_table=tuple(
                (float(np.deg2rad(psi)), float(np.deg2rad(angle)))
                for psi, angle in groove.angle_deg
            ),
            root_gap=groove.root_gap_mm * MM,
            root_face=groove.root_face_mm * MM,
            root_bead=groove.root_bead_mm * MM,
        )


def read_joint(path: Path) -> JointDefinition:
    """Read a joint's definition; it is named after its file.

    Raises
    ------
    ConfigurationError
        If the file can't be read, or such a joint can't be built.
    """
    file = validate(JointFile, read_toml(path), path)
    try:
        return file.definition(path.stem)
    except ConfigurationError as error:
        raise ConfigurationError(error.message, file=path, key=error.key) from None


def _mm(metres: float) -> float:
    return round(metres / MM, 9)  # a picometre: undoes the rounding of the way in


def _deg(radians: float) -> float:
    return round(float(np.rad2deg(radians)), 9)
