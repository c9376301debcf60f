"""What is scanned, and how its grooves are read."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from tjscan.core.config import FileModel
from tjscan.groove.models import MODELS
from tjscan.groove.settings import DEFAULT, GrooveSettings
from tjscan.job.fields import PoseTable


class SkipTable(FileModel):
    """When a correction is not worth its move: the view is as near as this to the ideal one.

    Unless `enabled` says otherwise, the paper's cases always make the correction.
    """

    enabled: bool | None = None
    position_mm: float = Field(default=8.0, gt=0, le=50)
    work_angle_deg: float = Field(default=5.0, gt=0, le=30)
    rotation_deg: float = Field(default=8.0, gt=0, le=30)


class AdaptiveTable(FileModel):
    """How much may change from section to section: steps are as long as that allows.

    `turn_deg` is the bend of the groove's direction. While there is this table, `step_mm` counts
    for the taught poses alone.
    """

    least_mm: float = Field(default=10.0, ge=5, le=300)
    most_mm: float = Field(default=80.0, ge=5, le=300)
    angle_change_deg: float = Field(default=3.0, gt=0, le=90)
    area_change_mm2: float = Field(default=50.0, gt=0, le=1e5)
    turn_deg: float = Field(default=20.0, gt=0, le=90)

    @model_validator(mode="after")
    def _range_is_one(self) -> AdaptiveTable:
        if self.least_mm > self.most_mm:
            raise ValueError("least_mm must not be larger than most_mm")
        return self


class ScanTable(FileModel):
    """What to scan, from where, and when to stop."""

    direction: Literal["counterclockwise", "clockwise"] = "counterclockwise"
    step_mm: float = Field(default=40.0, ge=5, le=300)
    prediction_case: Literal[1, 2, 3, 4, "smooth"] = 3
    pull_angle_deg: float = Field(default=10.0, ge=-45, le=45)
    standoff_mm: float = Field(default=230.0, ge=10, le=2000)
    view_offset_mm: float = Field(default=-15.0, ge=-500, le=500)
    length_mm: float | None = Field(default=None, gt=0)
    sections: int | None = Field(default=None, ge=3)
    resume_tolerance_mm: float = Field(default=0.5, gt=0, le=50)
    skip: SkipTable = SkipTable()
    adaptive: AdaptiveTable | None = None
    first: PoseTable | None = None
    second: PoseTable | None = None


class ReadingTable(FileModel):
    """How a groove is looked for in a profile; see `tjscan.groove.settings.GrooveSettings`."""

    model: Literal["tee", "butt-v", "butt-v-sharp"] = "tee"
    noise_mm: float = Field(default=1e3 * DEFAULT.noise, gt=0, le=5)
    minimum_points: int = Field(default=DEFAULT.minimum_points, ge=20, le=10_000)
    largest_sigma_mm: float = Field(default=1e3 * DEFAULT.largest_sigma, gt=0, le=10)
    largest_rms_mm: float = Field(default=1e3 * DEFAULT.largest_rms, gt=0, le=10)
    inlier_share: float = Field(default=DEFAULT.inlier_share, gt=0, le=1)

    @property
    def settings(self) -> GrooveSettings:
        """In metres."""
        return GrooveSettings(
            model=MODELS[self.model],
            noise=1e-3 * self.noise_mm,
            minimum_points=self.minimum_points,
            largest_sigma=1e-3 * self.largest_sigma_mm,
            largest_rms=1e-3 * self.largest_rms_mm,
            inlier_share=self.inlier_share,
        )


class GrooveTable(ReadingTable):
    """How a scan reads its grooves: a scan needs the five points of a section."""

    model: Literal["tee", "butt-v-sharp"] = "tee"
