"""The true world of a simulation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

from annotated_types import Ge, Le
from pydantic import Field

from tjscan.core.config import StrictFileModel
from tjscan.core.units import (
    LIST_OR_WORD_IN_FILE,
    MM,
    PoseRows,
    PoseSettings,
    Position,
    SettingsTable,
)
from tjscan.job.surroundings import StationPoseSettings
from tjscan.laser.model import LaserModel
from tjscan.robot.settings import ArmSimulationSettings, JointAngles


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedBoardSettings(PoseSettings):
    """The table [simulation.board]: the true pose of the board, and how well it is touched.

    Parameters
    ----------
    touch : float
        Standard deviation of a touched point in each axis, metres.
    """

    touch: Annotated[float, Ge(0), Le(5), MM] = 5e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedBallSettings(SettingsTable):
    """The table [simulation.ball]: where the ball truly is, frame b, and its radius, metres."""

    position: Position
    radius: Annotated[float, Ge(10), Le(200), MM]


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedStationSettings(StationPoseSettings):
    """The table [[simulation.station]]: the true pose of a station's base in frame w.

    Parameters
    ----------
    home : tuple of float, optional
        Joint angles the arm starts with there, radians; those in [simulation.arm] if left out.
    """

    home: JointAngles | None = None


class SimulationSettings(StrictFileModel):
    """The table [simulation]: the simulated world.

    `T_f_s_mm` is where the laser truly sits, `board` and `ball` where these truly are, `station`
    where stations truly are; if left out, they are as the job states them.
    """

    seed: int = Field(default=1, ge=0)
    T_f_s_mm: PoseRows | None = None
    board: SimulatedBoardSettings | None = None
    ball: SimulatedBallSettings | None = None
    station: Annotated[tuple[SimulatedStationSettings, ...], LIST_OR_WORD_IN_FILE] = ()
    arm: ArmSimulationSettings | None = None
    laser: LaserModel = LaserModel()

    def with_seeds_of_devices(self) -> SimulationSettings:
        """Return the same with the seeds stated that draw which arm and which laser it is."""
        arm, laser = self.arm, self.laser
        if arm is not None and arm.errors is not None and arm.errors.seed is None:
            arm = replace(arm, errors=replace(arm.errors, seed=self.seed))
        if laser.linearity_seed is None:
            laser = replace(laser, linearity_seed=self.seed)
        return self.model_copy(update={"arm": arm, "laser": laser})
