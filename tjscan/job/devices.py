"""Arm, laser, and where the one sits on the other."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from tjscan.calibration.file import PoseRows, rows_to_pose
from tjscan.core.config import FileModel
from tjscan.core.frames import Array
from tjscan.job.fields import Vector3


class UrTable(FileModel):
    """A Universal Robots arm: where its controller is, what it carries, what it is held to.

    Without `payload_kg` the payload of its pendant holds.
    """

    host: str = Field(min_length=1)
    payload_kg: float | None = Field(default=None, ge=0, le=50)
    payload_centre_mm: Vector3 = (0.0, 0.0, 0.0)
    position_tolerance_mm: float = Field(default=0.5, gt=0, le=10)
    rotation_tolerance_deg: float = Field(default=0.1, gt=0, le=5)
    connect_s: float = Field(default=15.0, ge=1, le=120)
    silence_s: float = Field(default=1.0, ge=0.1, le=60)

    @model_validator(mode="after")
    def _payload_is_whole(self) -> UrTable:
        if self.payload_kg is None and any(self.payload_centre_mm):
            raise ValueError("payload_centre_mm needs payload_kg beside it")
        return self


class ArmTable(FileModel):
    """The arm and the bounds it moves within."""

    driver: Literal["simulated", "ur"] = "simulated"
    model: str = "ur10e"
    id: str | None = Field(default=None, min_length=1)
    speed_mm_s: float = Field(default=250.0, ge=1, le=3000)
    acceleration_mm_s2: float = Field(default=1200.0, ge=10, le=50_000)
    ur: UrTable | None = None

    @model_validator(mode="after")
    def _has_its_table(self) -> ArmTable:
        if self.driver == "ur" and self.ur is None:
            raise ValueError('driver "ur" needs a table [arm.ur] with the host of the controller')
        return self

    @property
    def device(self) -> str:
        """What a calibration calls this arm: its id, or its model where it has none."""
        return self.id or self.model


class LaserTable(FileModel):
    """The line laser and the window it measures in.

    The driver "replay" sees again what a recording holds, `recording` being a run directory or
    a file of its; then the arm, whatever its driver, stands where it stood, and nothing moves.
    """

    driver: Literal["simulated", "replay"] = "simulated"
    recording: str | None = Field(default=None, min_length=1)
    replay_tolerance_mm: float = Field(default=5.0, ge=0, le=1000)
    replay_tolerance_deg: float = Field(default=2.0, ge=0, le=180)
    id: str | None = Field(default=None, min_length=1)
    points: int = Field(default=640, ge=160, le=640, multiple_of=80)
    near_mm: float = Field(default=190.0, ge=1, le=5000)
    far_mm: float = Field(default=290.0, ge=1, le=5000)

    @model_validator(mode="after")
    def _range_is_one(self) -> LaserTable:
        if self.near_mm >= self.far_mm:
            raise ValueError("near_mm must be smaller than far_mm")
        return self

    @model_validator(mode="after")
    def _replay_has_a_recording(self) -> LaserTable:
        if self.driver == "replay" and self.recording is None:
            raise ValueError('driver "replay" needs a recording: a run directory, or its scan.mcap')
        return self

    @property
    def is_replay(self) -> bool:
        """Whether no device is there, neither laser nor arm."""
        return self.driver == "replay"

    @property
    def device(self) -> str:
        """What a calibration calls this laser: its id, or its driver where it has none."""
        return self.id or self.driver


class CalibrationTable(FileModel):
    """Where the laser sits on the hand: rows of T_f_s, or the file that a calibration left."""

    T_f_s_mm: PoseRows | None = None
    file: str | None = None

    @model_validator(mode="after")
    def _is_one_of_both(self) -> CalibrationTable:
        if (self.T_f_s_mm is None) == (self.file is None):
            raise ValueError("needs either T_f_s_mm or file, and not both")
        return self

    @property
    def T_f_s(self) -> Array | None:
        """Pose of the sensor in the flange frame, shape (4, 4), metres, where it stands here."""
        return None if self.T_f_s_mm is None else rows_to_pose(self.T_f_s_mm)
