"""The options of ``tjscan calibrate`` for recorded profiles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal

from cyclopts import Parameter


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedProfileOptions:
    """Options for recorded profiles.

    Parameters
    ----------
    lines
        Recorded profiles: CSV with columns x, z and profile, or with a profile per row. Once for
        each target: all of them are solved together.
    poses
        Their flange poses: CSV with position and quaternion, rotation vector or Euler angles.
    target
        What each of the recordings shows, in their order: roof, ball, ball=RADIUS, plane,
        plane=A,B,C,D or touched=FILE.
    plane
        The board A,B,C,D in frame b: A x + B y + C z + D = 0 in millimetres.
    touched
        Points touched on the board: CSV with columns x_mm, y_mm, z_mm in frame b.
    unknown_plane
        Find the board together with the sensor.
    sphere_radius_mm
        The target is a ball of this radius.
    unknown_sphere
        The target is a ball; find its radius too.
    roof_edge
        The target is a roof edge: two planes that meet.
    fixed_sensor
        The sensor stands fixed in the room, and the arm carries the target.
    units
        Unit of length of the profiles, where the names of the columns do not state it.
    pitch
        Distance of the columns of a matrix, in that unit.
    invalid
        A value that stands for no point, beside NaN and nothing.
    range_mm
        Standard deviation of a point along z; 0.03 where left out.
    correlation_columns
        Columns after which the correlation of those errors has fallen to 1/e; 4.
    position_mm
        Standard deviation of the flange's position, each axis; 0.05.
    rotation_deg
        Standard deviation of its orientation, about each axis; 0.01.
    touch_mm
        Standard deviation of a touched point, each axis; 0.05.
    geometry_mm
        Standard deviation of the flange's position that the arm's own geometry leaves, alike at
        poses that are alike; 0.3.
    arm_model
        Calibrate the kinematics of this arm, a model or the path of its URDF, with the sensor: the
        poses have joint angles beside them, q1_deg, q2_deg and so on.
    arm_id
        The arm it holds for; a scan with another refuses it.
    laser_id
        The laser it holds for.
    """

    lines: list[Path] | None = None
    poses: list[Path] | None = None
    target: list[str] | None = None
    plane: str | None = None
    touched: Path | None = None
    unknown_plane: bool = False
    sphere_radius_mm: float | None = None
    unknown_sphere: bool = False
    roof_edge: bool = False
    fixed_sensor: bool = False
    units: Literal["mm", "um", "m"] | None = None
    pitch: float | None = None
    invalid: list[float] | None = None
    range_mm: float | None = None
    correlation_columns: float | None = None
    position_mm: float | None = None
    rotation_deg: float | None = None
    touch_mm: float | None = None
    geometry_mm: float | None = None
    arm_model: str | None = None
    arm_id: str | None = None
    laser_id: str | None = None

    @property
    def given_option_names(self) -> list[str]:
        """Names of the options that are given."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return [name for name, value in values.items() if value is not None and value is not False]


def comma_separated_options(names: Iterable[str]) -> str:
    """Options as they are typed, joined by commas."""
    return ", ".join("--" + name.replace("_", "-") for name in names)
