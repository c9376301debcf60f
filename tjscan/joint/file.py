"""A joint's TOML file: millimetres and degrees, checked."""

from __future__ import annotations

from dataclasses import asdict
from math import inf, isfinite, radians
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, Strict

from tjscan.core.config import StrictFileModel, read_toml, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.joint.checks import check_buildable
from tjscan.joint.definition import NOT_STATED, FitUpTolerance, JointDefinition
from tjscan.joint.imperfections import NO_IMPERFECTIONS, Imperfections

METRES_PER_MM = 1e-3

LengthMm = Annotated[float, Field(gt=0.0, le=20_000.0)]
SmallLengthMm = Annotated[float, Field(ge=0.0, le=100.0)]
TolerableLengthMm = Annotated[float, Field(gt=0.0, le=100.0)]
AnglePairDeg = Annotated[tuple[float, float], Strict(False)]  # TOML knows lists only


class LegDimensions(StrictFileModel):
    """The table [leg] of a joint's file: the tube that runs through."""

    outer_diameter_mm: LengthMm
    wall_mm: LengthMm
    length_mm: LengthMm


class BraceDimensions(StrictFileModel):
    """The table [brace] of a joint's file: the tube that is welded on."""

    outer_diameter_mm: LengthMm
    wall_mm: LengthMm
    length_mm: LengthMm
    angle_deg: float = 90.0


class GrooveDimensions(StrictFileModel):
    """The table [groove] of a joint's file: the prepared brace end and the root bead."""

    angle_deg: Annotated[tuple[AnglePairDeg, ...], Strict(False), Field(max_length=1000)]
    root_gap_mm: SmallLengthMm
    root_face_mm: SmallLengthMm
    root_bead_mm: SmallLengthMm


class TolerancesOfFitUp(StrictFileModel):
    """The table [tolerance] of a joint's file: how far its fit-up may lie from what is drawn."""

    groove_angle_deg: Annotated[float, Field(gt=0.0, le=90.0)] | None = None
    root_opening_mm: TolerableLengthMm | None = None
    root_face_mm: TolerableLengthMm | None = None
    depth_mm: TolerableLengthMm | None = None
    high_low_mm: TolerableLengthMm | None = None

    @classmethod
    def from_tolerance(cls, tolerance: FitUpTolerance) -> Self:
        """Convert the definition's tolerance to its table."""
        stated = {name: value for name, value in asdict(tolerance).items() if isfinite(value)}
        angle = stated.pop("groove_angle", None)
        lengths = {f"{name}_mm": _mm(value) for name, value in stated.items()}
        return cls(groove_angle_deg=None if angle is None else _deg(angle), **lengths)

    def tolerance(self) -> FitUpTolerance:
        """Convert the table to the definition's tolerance, in metres and radians."""
        stated = self.model_dump(exclude_none=True)
        angle = stated.pop("groove_angle_deg", inf)
        lengths = {key.removesuffix("_mm"): value * METRES_PER_MM for key, value in stated.items()}
        return FitUpTolerance(groove_angle=radians(angle), **lengths)


class JointFile(StrictFileModel):
    """A joint as its TOML file describes it, in millimetres and degrees."""

    leg: LegDimensions
    brace: BraceDimensions
    groove: GrooveDimensions
    tolerance: TolerancesOfFitUp | None = None
    imperfections: Imperfections | None = None

    @classmethod
    def from_definition(cls, definition: JointDefinition) -> Self:
        """Convert a joint's definition to its file."""
        d = definition
        return cls(
            leg=LegDimensions(
                outer_diameter_mm=_mm(2 * d.leg_radius),
                wall_mm=_mm(d.leg_wall),
                length_mm=_mm(d.leg_length),
            ),
            brace=BraceDimensions(
                outer_diameter_mm=_mm(2 * d.brace_radius),
                wall_mm=_mm(d.brace_wall),
                length_mm=_mm(d.brace_length),
                angle_deg=_deg(d.angle),
            ),
            groove=GrooveDimensions(
                angle_deg=tuple((_deg(psi), _deg(groove)) for psi, groove in d.groove_table),
                root_gap_mm=_mm(d.root_gap),
                root_face_mm=_mm(d.root_face),
                root_bead_mm=_mm(d.root_bead),
            ),
            tolerance=None
            if d.tolerance == NOT_STATED
            else TolerancesOfFitUp.from_tolerance(d.tolerance),
            imperfections=None if d.imperfections == NO_IMPERFECTIONS else d.imperfections,
        )

    def definition(self, name: str) -> JointDefinition:
        """Convert the file to the joint's definition, in metres and radians.

        Raises
        ------
        ConfigurationError
            If such a joint can't be built.
        """
        leg, brace, groove = self.leg, self.brace, self.groove
        definition = JointDefinition(
            name=name,
            leg_radius=leg.outer_diameter_mm / 2 * METRES_PER_MM,
            leg_wall=leg.wall_mm * METRES_PER_MM,
            leg_length=leg.length_mm * METRES_PER_MM,
            brace_radius=brace.outer_diameter_mm / 2 * METRES_PER_MM,
            brace_wall=brace.wall_mm * METRES_PER_MM,
            brace_length=brace.length_mm * METRES_PER_MM,
            angle=float(np.deg2rad(brace.angle_deg)),
            groove_table=tuple(
                (float(np.deg2rad(psi)), float(np.deg2rad(angle)))
                for psi, angle in groove.angle_deg
            ),
            root_gap=groove.root_gap_mm * METRES_PER_MM,
            root_face=groove.root_face_mm * METRES_PER_MM,
            root_bead=groove.root_bead_mm * METRES_PER_MM,
            imperfections=self.imperfections or NO_IMPERFECTIONS,
            tolerance=NOT_STATED if self.tolerance is None else self.tolerance.tolerance(),
        )
        check_buildable(definition)
        return definition


def read_joint(path: Path) -> JointDefinition:
    """Read a joint's definition; it is named after its file.

    Raises
    ------
    ConfigurationError
        If the file can't be read, or such a joint can't be built.
    """
    file = validate_table(JointFile, read_toml(path), path)
    try:
        return file.definition(path.stem)
    except ConfigurationError as error:
        raise ConfigurationError(error.message, file=path, key=error.key) from None


def _mm(metres: float) -> float:
    return round(metres / METRES_PER_MM, 9)  # a picometre: undoes the rounding of the way in


def _deg(radians: float) -> float:
    return round(float(np.rad2deg(radians)), 9)
