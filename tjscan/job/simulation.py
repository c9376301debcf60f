"""The world that a simulation takes for true."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from tjscan.calibration.file import PoseRows
from tjscan.core.config import FileModel
from tjscan.job.fields import Fraction, JointAngle, PoseTable
from tjscan.job.station import NamedPoseTable


class SimulatedArmTable(FileModel):
    """What only a simulated arm needs to be told."""

    home_deg: Annotated[tuple[JointAngle, ...], Field(strict=False)]
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
    strays: Fraction = 0.0
    interreflection_mm: float = Field(default=0.0, ge=0, le=5)
    occlusion: bool = True
    resolution_mm: float = Field(default=0.005, ge=0, le=1)


class SimulatedBoardTable(PoseTable):
    """Where the board truly is, and how well it is touched."""

    touch_mm: float = Field(default=0.05, ge=0, le=5)


class SimulatedStationTable(NamedPoseTable):
    """Where a station's base truly stands in frame w, and how the arm stands on it before."""

    home_deg: Annotated[tuple[JointAngle, ...], Field(strict=False)] | None = None


class SimulationTable(FileModel):
    """The simulated world.

    `T_f_s_mm` is where the laser truly sits, `board` where the board truly is, `station` where
    stations truly are; where left out, they are where the job believes them to be.
    """

    seed: int = Field(default=1, ge=0)
    T_f_s_mm: PoseRows | None = None
    board: SimulatedBoardTable | None = None
    station: Annotated[tuple[SimulatedStationTable, ...], Field(strict=False)] = ()
    arm: SimulatedArmTable
    laser: SimulatedLaserTable = SimulatedLaserTable()
