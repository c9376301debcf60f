"""A joint's TOML file, millimetres and degrees, and what makes a joint one that can be built."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final, NoReturn, Self

import numpy as np
from pydantic import Field, Strict, field_validator, model_validator

from tjscan.core.config import StrictFileModel, add_file_to_errors, read_toml, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.joint.definition import (
    NO_IMPERFECTIONS,
    NO_TOLERANCE_STATED,
    FitUpTolerance,
    Imperfections,
    JointDefinition,
)
from tjscan.joint.edges import JointGrooveSections
from tjscan.joint.geometry import cylindrical_to_j

METRES_PER_MM: Final = 1e-3

LENGTH_KEYS: Final = {
    "leg_radius": ("leg", "outer_diameter_mm", METRES_PER_MM / 2),
    "leg_length": ("leg", "length_mm", METRES_PER_MM),
    "leg_wall": ("leg", "wall_mm", METRES_PER_MM),
    "brace_radius": ("brace", "outer_diameter_mm", METRES_PER_MM / 2),
    "brace_length": ("brace", "length_mm", METRES_PER_MM),
    "brace_wall": ("brace", "wall_mm", METRES_PER_MM),
    "root_opening": ("groove", "root_opening_mm", METRES_PER_MM),
    "root_face": ("groove", "root_face_mm", METRES_PER_MM),
    "root_bead": ("groove", "root_bead_mm", METRES_PER_MM),
}
"""Table, key and unit in the file, of each length of a definition."""

MOST_RADIUS_RATIO: Final = 1 / 1.05 * (1 + 1e-9)  # room for rounding
"""Largest ratio of brace to leg: at 1 the dihedral angle runs to 180° and the groove opens flat."""

LEAST_BRACE_ANGLE, MOST_BRACE_ANGLE = np.deg2rad(45.0), np.deg2rad(90.0)
LEAST_GROOVE_ANGLE, MOST_GROOVE_ANGLE = np.deg2rad(20.0), np.deg2rad(90.0)

LEAST_BORE_RADIUS: Final = 5e-3
"""Least radius of a tube's bore."""

LEAST_BEVEL_ANGLE: Final = np.deg2rad(10.0)
"""Least angle between the bevel and the brace's wall."""

LEAST_FREE_BEVEL: Final = 2e-3
"""Least length of bevel that the root bead must leave free."""

LEAST_ROOT_WIDTH: Final = 1e-3
"""Least width of the root bead's face."""

LEAST_TUBE_BEYOND_GROOVE: Final = 20e-3
"""Least length of brace and leg beyond the groove, for a scan to see a wall there."""

LEAST_SEAM_TO_ROOT: Final = 2e-3
"""Least distance of a seam weld's cap from the root's corner on the leg."""

CHECKED_AZIMUTHS: Final = np.linspace(0, 2 * np.pi, 720, endpoint=False)


def check_buildable(definition: JointDefinition) -> None:
    """Refuse a joint that can't be built.

    Raises
    ------
    ConfigurationError
        Naming the key of the joint file that is wrong.
    """
    _check_tubes(definition)
    _check_groove_table(definition)
    with np.errstate(divide="ignore", invalid="ignore"):
        sections = JointGrooveSections(definition, CHECKED_AZIMUTHS)
    _check_bevel(sections)
    _check_root(definition, sections)
    _check_lengths(definition, sections)
    _check_seams(definition, sections)


def _check_tubes(d: JointDefinition) -> None:
    for name, (table, key, _) in LENGTH_KEYS.items():
        value = getattr(d, name)
        if not 0 <= value < np.inf and key != "wall_mm":
            _raise_wrong_key(f"{table}.{key}", f"{_to_mm(value)} is no length")
    for key, radius, wall in (
        ("leg.wall_mm", d.leg_radius, d.leg_wall),
        ("brace.wall_mm", d.brace_radius, d.brace_wall),
    ):
        if not 0 < wall <= radius - LEAST_BORE_RADIUS:
            most = _to_mm(radius - LEAST_BORE_RADIUS)
            _raise_wrong_key(
                key, f"a wall of {_to_mm(wall)} leaves no bore; stay at or below {most}"
            )
    if d.brace_radius > MOST_RADIUS_RATIO * d.leg_radius:
        most = _to_mm(2 * MOST_RADIUS_RATIO * d.leg_radius)
        _raise_wrong_key(
            "brace.outer_diameter_mm",
            f"{_to_mm(2 * d.brace_radius)} is too wide for a leg of {_to_mm(2 * d.leg_radius)}: "
            f"the groove opens flat at the saddle; stay at or below {most}",
        )
    if not LEAST_BRACE_ANGLE <= d.angle <= MOST_BRACE_ANGLE:
        _raise_wrong_key(
            "brace.angle_deg",
            f"{_to_deg(d.angle)} is out of range; the angle on the heel side is between "
            f"{_to_deg(LEAST_BRACE_ANGLE)} and {_to_deg(MOST_BRACE_ANGLE)}",
        )


def _check_groove_table(d: JointDefinition) -> None:
    key = "groove.angle_deg"
    table = np.asarray(d.groove_table, dtype=float)
    if table.ndim != 2 or table.shape[1] != 2 or not np.isfinite(table).all():
        _raise_wrong_key(key, "is a list of at least one pair [dihedral_deg, groove_deg]")
    if np.any(np.diff(table[:, 0]) <= 0):
        _raise_wrong_key(key, "its dihedral angles must grow from pair to pair")
    for angle in table[:, 1]:
        if not LEAST_GROOVE_ANGLE <= angle <= MOST_GROOVE_ANGLE:
            _raise_wrong_key(
                key,
                f"a groove angle of {_to_deg(angle)} is out of range; stay between "
                f"{_to_deg(LEAST_GROOVE_ANGLE)} and {_to_deg(MOST_GROOVE_ANGLE)}",
            )
    widest = min(d.brace_wall, d.brace_inner_radius / 2)
    if d.root_opening > widest:
        _raise_wrong_key(
            "groove.root_opening_mm",
            f"{_to_mm(d.root_opening)} is too wide for this brace; stay at or below "
            f"{_to_mm(widest)}",
        )
    if d.root_face >= d.brace_wall - LEAST_FREE_BEVEL:
        most = _to_mm(d.brace_wall - LEAST_FREE_BEVEL)
        _raise_wrong_key(
            "groove.root_face_mm",
            f"{_to_mm(d.root_face)} of a wall of {_to_mm(d.brace_wall)} leaves no bevel; "
            f"stay below {most}",
        )


def _check_bevel(s: JointGrooveSections) -> None:
    sharpness = np.arctan2(s.bevel[:, 0], s.bevel[:, 1])
    i = int(np.argmin(sharpness))
    if sharpness[i] < LEAST_BEVEL_ANGLE:
        _raise_wrong_key(
            "groove.angle_deg",
            f"a groove angle of {_to_deg(s.groove_angle[i])} where the local dihedral angle is "
            f"{_to_deg(s.dihedral[i])} leaves no bevel on the brace; make it smaller there by at "
            f"least {_to_deg(LEAST_BEVEL_ANGLE - sharpness[i])}",
        )


def _check_root(d: JointDefinition, s: JointGrooveSections) -> None:
    free = float(np.min(s.bevel_length)) - d.root_bead
    if free < LEAST_FREE_BEVEL:
        most = _to_mm(d.root_bead + free - LEAST_FREE_BEVEL)
        _raise_wrong_key(
            "groove.root_bead_mm",
            f"{_to_mm(d.root_bead)} covers the bevel, which is {_to_mm(free + d.root_bead)} long; "
            f"stay at or below {most}",
        )
    width = float(np.min(s.root_width))
    if not width >= LEAST_ROOT_WIDTH:
        _raise_wrong_key(
            "groove.root_opening_mm",
            f"opening and bead leave a root only {_to_mm(width)} wide; widen it or raise the bead "
            f"until it is {_to_mm(LEAST_ROOT_WIDTH)}",
        )


def groove_extent(d: JointDefinition, s: JointGrooveSections) -> tuple[float, float]:
    """How far the groove reaches up the brace and along the leg, metres from where axes cross."""
    foot = d.leg_surface.points_j(s.phi, d.brace_radius) @ d.leg_surface.axis
    root = cylindrical_to_j(s.phi, s.p4[:, 0], s.p4[:, 1]) @ d.leg_surface.axis
    return float(np.max(s.p2[:, 1])), float(np.max(np.abs((foot, root))))


def _check_lengths(d: JointDefinition, s: JointGrooveSections) -> None:
    up, along = groove_extent(d, s)
    top = up + LEAST_TUBE_BEYOND_GROOVE
    if d.brace_length < top:
        _raise_wrong_key(
            "brace.length_mm",
            f"{_to_mm(d.brace_length)} ends in the groove; from where the axes cross it takes at "
            f"least {_to_mm(top)}",
        )
    least = 2 * (along + LEAST_TUBE_BEYOND_GROOVE)
    if d.leg_length < least:
        _raise_wrong_key(
            "leg.length_mm",
            f"{_to_mm(d.leg_length)} doesn't hold the intersection; "
            f"it takes at least {_to_mm(least)}",
        )


def _check_seams(d: JointDefinition, s: JointGrooveSections) -> None:
    reach = float(np.max(s.p4[:, 0])) + LEAST_SEAM_TO_ROOT
    for i, seam in enumerate(d.imperfections.seams):
        y = abs(d.leg_radius * np.sin(seam.at)) - seam.width / 2
        if np.cos(seam.at) > 0 and y < reach:
            least = np.arcsin(min(1.0, (reach + seam.width / 2) / d.leg_radius))
            _raise_wrong_key(
                f"imperfections.seams.{i}.at_deg",
                f"at {_to_deg(seam.at)} the cap runs into the groove, where it would be ground "
                f"off; keep it {_to_deg(least)} or more from the top of the leg",
            )


def _raise_wrong_key(key: str, message: str) -> NoReturn:
    raise ConfigurationError(message, key=key)


def _to_mm(metres: float) -> str:
    return f"{1e3 * metres:.4g} mm"


def _to_deg(radians: float) -> str:
    return f"{np.rad2deg(radians):.4g}°"


LengthMm = Annotated[float, Field(gt=0.0, le=20_000.0)]
SmallLengthMm = Annotated[float, Field(ge=0.0, le=100.0)]
AnglePairDeg = Annotated[tuple[float, float], Strict(False)]  # TOML knows lists only


class LegDimensions(StrictFileModel):
    """The table [leg] of a joint's file: the tube that runs through."""

    outer_diameter_mm: LengthMm
    wall_mm: LengthMm
    length_mm: LengthMm


class BraceDimensions(LegDimensions):
    """The table [brace] of a joint's file: the tube that is welded on."""

    angle_deg: float = 90.0


OLDER_OPENING_KEY: Final = "root_gap_mm"


class GrooveDimensions(StrictFileModel):
    """The table [groove] of a joint's file: the prepared brace end and the root bead."""

    angle_deg: Annotated[tuple[AnglePairDeg, ...], Strict(False), Field(max_length=1000)]
    root_opening_mm: SmallLengthMm
    root_face_mm: SmallLengthMm
    root_bead_mm: SmallLengthMm

    @field_validator("angle_deg", mode="before")
    @classmethod
    def _refuse_one_angle(cls, angles: Any) -> Any:
        if isinstance(angles, int | float):
            raise ValueError(
                f"must be pairs of dihedral and groove angle; [[90.0, {angles}]] is {angles}° all "
                "round"
            )
        return angles

    @model_validator(mode="before")
    @classmethod
    def _read_older_name(cls, table: Any) -> Any:
        """Read a file that calls the root opening (AWS A3.0) a gap."""
        if isinstance(table, dict) and OLDER_OPENING_KEY in table:
            return {
                "root_opening_mm" if key == OLDER_OPENING_KEY else key: one
                for key, one in table.items()
            }
        return table


class JointFile(StrictFileModel):
    """A joint as its TOML file describes it, in millimetres and degrees."""

    leg: LegDimensions
    brace: BraceDimensions
    groove: GrooveDimensions
    tolerance: FitUpTolerance | None = None
    imperfections: Imperfections | None = None

    @classmethod
    def from_definition(cls, definition: JointDefinition) -> Self:
        """Convert a joint's definition to its file."""
        d = definition
        groove_table = tuple((_rounded_deg(a), _rounded_deg(b)) for a, b in d.groove_table)
        tables: dict[str, Any] = {
            "leg": {},
            "brace": {"angle_deg": _rounded_deg(d.angle)},
            "groove": {"angle_deg": groove_table},
        }
        for name, (table, key, metres) in LENGTH_KEYS.items():
            tables[table][key] = _rounded(getattr(d, name) / metres)
        if d.tolerance != NO_TOLERANCE_STATED:
            tables["tolerance"] = d.tolerance
        if d.imperfections != NO_IMPERFECTIONS:
            tables["imperfections"] = d.imperfections
        return cls.model_validate(tables)

    def definition(self, name: str) -> JointDefinition:
        """Convert the file to the joint's definition, in metres and radians.

        Raises
        ------
        ConfigurationError
            If such a joint can't be built.
        """
        lengths: dict[str, Any] = {
            field: getattr(getattr(self, table), key) * metres
            for field, (table, key, metres) in LENGTH_KEYS.items()
        }
        definition = JointDefinition(
            name=name,
            angle=float(np.deg2rad(self.brace.angle_deg)),
            groove_table=tuple(
                (float(np.deg2rad(psi)), float(np.deg2rad(angle)))
                for psi, angle in self.groove.angle_deg
            ),
            imperfections=self.imperfections or NO_IMPERFECTIONS,
            tolerance=self.tolerance or NO_TOLERANCE_STATED,
            **lengths,
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
    with add_file_to_errors(path):
        return file.definition(path.stem)


def _rounded(value: float) -> float:
    return round(value, 9)  # a picometre: undoes the rounding of the way in


def _rounded_deg(radians: float) -> float:
    return _rounded(float(np.rad2deg(radians)))
