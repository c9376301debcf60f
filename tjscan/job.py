"""The job file: one scan, in millimetres and degrees, as a person writes it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from tjscan.config import FileModel, read_toml, validate
from tjscan.errors import ConfigurationError
from tjscan.frames import Array, from_euler_zyx, from_rounded

Vector3 = Annotated[tuple[float, float, float], Field(strict=False)]
Row4 = Annotated[tuple[float, float, float, float], Field(strict=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]


class PoseTable(FileModel):
    """A pose as controllers show it: position and Z-Y-X Euler angles."""

    position_mm: Vector3
    euler_zyx_deg: Vector3

    @property
    def T(self) -> Array:
        """The pose, shape (4, 4), metres."""
        return from_euler_zyx(
            1e-3 * np.array(self.position_mm), np.radians(np.array(self.euler_zyx_deg))
        )


class ScanTable(FileModel):
    """What to scan, from where, and when to stop."""

    direction: Literal["counterclockwise", "clockwise"] = "counterclockwise"
    step_mm: float = Field(default=40.0, ge=1, le=300)
    prediction_case: Literal[1, 2, 3, 4] = 3
    pull_angle_deg: float = Field(default=10.0, ge=-45, le=45)
    standoff_mm: float = Field(default=230.0, ge=10, le=2000)
    view_offset_mm: float = Field(default=-15.0, ge=-500, le=500)
    length_mm: float | None = Field(default=None, gt=0)
    sections: int | None = Field(default=None, ge=3)
    first: PoseTable
    second: PoseTable


class ArmTable(FileModel):
    """The arm and the bounds it moves within."""

    driver: Literal["simulated"] = "simulated"
    model: str = "ur10e"
    speed_mm_s: float = Field(default=250.0, gt=0, le=3000)
    acceleration_mm_s2: float = Field(default=1200.0, gt=0)


class LaserTable(FileModel):
    """The line laser and the window it measures in."""

    driver: Literal["simulated"] = "simulated"
    points: int = Field(default=640, ge=80, le=640, multiple_of=80)
    near_mm: float = Field(default=190.0, gt=0)
    far_mm: float = Field(default=290.0, gt=0)


class CalibrationTable(FileModel):
    """Where the laser sits on the hand."""

    T_f_s_mm: Annotated[tuple[Row4, Row4, Row4, Row4], Field(strict=False)]

    @field_validator("T_f_s_mm")
    @classmethod
    def _is_a_pose(cls, rows: Any) -> Any:
        from_rounded(rows)
        return rows

    @property
    def T_f_s(self) -> Array:
        """Pose of the sensor in the flange frame, shape (4, 4), metres."""
        T = np.array(self.T_f_s_mm)
        T[:3, 3] *= 1e-3
        return from_rounded(T)


class JointTable(FileModel):
    """The joint as designed: what the comparison measures against, and the simulated world.

    The scanner itself never looks at it.
    """

    file: str
    position_mm: Vector3
    euler_zyx_deg: Vector3

    @property
    def T_b_j(self) -> Array:
        """Pose of the joint in the base frame, shape (4, 4), metres."""
        return PoseTable(position_mm=self.position_mm, euler_zyx_deg=self.euler_zyx_deg).T


class SimulatedArmTable(FileModel):
    """What only a simulated arm needs to be told."""

    home_deg: Annotated[tuple[float, ...], Field(strict=False)]
    repeatability_mm: float = Field(default=0.05, ge=0, le=5)
    repeatability_deg: float = Field(default=0.006, ge=0, le=5)
    realtime: bool = False


class SimulatedLaserTable(FileModel):
    """The faults of the simulated laser; zero switches one off.

    What each means, and which are assumptions, stands at `tjscan.laser.model.LaserModel`.
    """

    noise_mm: float = Field(default=0.03, ge=0, le=5)
    noise_correlation_points: float = Field(default=4.0, ge=0, le=100)
    bias_mm: float = Field(default=0.02, ge=0, le=5)
    dropout: Fraction = 1.0
    missing: Fraction = 0.02
    ghosts: Fraction = 0.065
    flyers: Fraction = 0.3
    occlusion: bool = True
    resolution_mm: float = Field(default=0.005, ge=0, le=1)


class SimulationTable(FileModel):
    """The simulated world."""

    seed: int = Field(default=1, ge=0)
    arm: SimulatedArmTable
    laser: SimulatedLaserTable = SimulatedLaserTable()


class JobFile(FileModel):
    """One job."""

    scan: ScanTable
    arm: ArmTable = ArmTable()
    laser: LaserTable = LaserTable()
    calibration: CalibrationTable
    joint: JointTable | None = None
    simulation: SimulationTable | None = None

    @model_validator(mode="after")
    def _simulation_is_whole(self) -> JobFile:
        if "simulated" in (self.arm.driver, self.laser.driver) and self.simulation is None:
            raise ValueError("a simulated arm or laser needs a [simulation] table")
        if self.laser.driver == "simulated" and self.joint is None:
            raise ValueError("a simulated laser needs a [joint] table to look at")
        return self


def read_job(file: Path, overrides: dict[str, Any] | None = None) -> JobFile:
    """Read a job file, with single keys replaced.

    Parameters
    ----------
    file : Path
        The TOML file.
    overrides : dict, optional
        Dotted keys such as ``scan.step_mm`` and their values.

    Raises
    ------
    ConfigurationError
        If the file can't be read, or a key is unknown, missing or of a wrong type or value.
    """
    data = read_toml(file)
    for key, value in (overrides or {}).items():
        *tables, last = key.split(".")
        table = data
        for name in tables:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise ConfigurationError(f"{name} is no table", file=file, key=key)
        table[last] = value
    return validate(JobFile, data, file)
