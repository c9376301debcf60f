"""Tables of a job that calibrates from recorded profiles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Gt

from tjscan.core.units import LIST_OR_WORD_IN_FILE, MM, FileUnit, SettingsTable


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedSettings(SettingsTable):
    """A table [[recorded]]: profiles of one target, and the flange poses they were taken from.

    Parameters
    ----------
    profiles : str
        File of the profiles: CSV with columns x, z and profile, or with a profile per row; or a
        folder of such files. Of points: CSV with x, y, z and joint angles.
    poses : str
        File of their flange poses: CSV with position and orientation, or an arm's program. Points
        have none.
    target : str
        The target in the profiles: plane, ball or roof. Or points, one that is fixed on the flange,
        as a laser tracker or a touched artefact has it: they calibrate the arm.
    plane : tuple of float, optional
        The board A, B, C, D in frame b: A x + B y + C z + D = 0.
    touched : str, optional
        File of points touched on the board: CSV with columns x_mm, y_mm, z_mm in frame b.
    radius : float, optional
        Of the ball; estimated with the sensor's pose if left out.
    units : str, optional
        Unit of length of the profiles, if the names of the columns do not state it.
    pitch : float, optional
        Distance of the columns of a matrix, in that unit.
    invalid : tuple of float
        Values that mark a missing point, beside NaN and an empty cell.
    z_scale : float
        What one of the heights' numbers is in that unit; negative where heights grow towards the
        sensor.
    """

    profiles: str
    poses: str = ""
    target: Literal["plane", "ball", "roof", "points"]
    plane: Annotated[tuple[float, float, float, float] | None, FileUnit("mm")] = None
    touched: str | None = None
    radius: Annotated[float | None, Gt(0), MM] = None
    units: Literal["mm", "um", "m"] | None = None
    pitch: float | None = None
    invalid: Annotated[tuple[float, ...], LIST_OR_WORD_IN_FILE] = ()
    z_scale: float = 1.0

    def __post_init__(self) -> None:
        if (self.target == "points") == bool(self.poses):
            raise ValueError("poses is required, but not of points, which have joint angles")
        if self.target != "plane" and (self.plane is not None or self.touched is not None):
            raise ValueError("plane_mm and touched are of a target that is a plane")
        if self.plane is not None and self.touched is not None:
            raise ValueError("a board is either stated by plane_mm or touched")
        if self.plane is not None and not any(self.plane[:3]):
            raise ValueError("a plane A, B, C, D needs a normal A, B, C that is not zero")
        if self.target != "ball" and self.radius is not None:
            raise ValueError("radius_mm is of a target that is a ball")

    @property
    def kind(self) -> str:
        """The target in a word; a touched board has one of its own."""
        return self.target if self.touched is None else "touched"

    def __str__(self) -> str:
        """The target and its known size or place."""
        if self.radius is not None:
            return f"ball={1e3 * self.radius:g}"
        if self.plane is not None:
            return f"plane={','.join(map(str, self.plane))}"
        return self.kind if self.touched is None else f"touched={self.touched}"


@dataclass(frozen=True, slots=True, kw_only=True)
class SolveSettings(SettingsTable):
    """The table [solve]: what is found from recorded profiles.

    Parameters
    ----------
    fixed_sensor : bool
        The sensor is fixed in the room, and the arm carries the target.
    calibrate_arm : bool
        Calibrate the arm's kinematics with the sensor: the poses have joint angles beside them,
        q1_deg, q2_deg and so on.
    """

    fixed_sensor: bool = False
    calibrate_arm: bool = False

    def __post_init__(self) -> None:
        if self.calibrate_arm and self.fixed_sensor:
            raise ValueError("calibrate_arm needs a sensor on the arm, not a fixed_sensor")
