"""The options of ``tjscan groove``: how a file is read, and how a groove is found in it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from cyclopts import Parameter

if TYPE_CHECKING:
    from tjscan.groove.settings import GrooveSettings
    from tjscan.laser.files.format import ProfileFormat


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileFileOptions:
    """How the numbers of a profile file are read.

    Parameters
    ----------
    units
        Unit of length, if the names of the columns do not state it.
    pitch
        Distance of the columns of a matrix, or of points without an x, in that unit.
    invalid
        A value that means no point, beside NaN, an empty cell, and 0 if it is far from all other
        heights.
    z_scale
        What one of the heights' numbers is in that unit; 1. Negative where heights grow towards
        the sensor.
    z_offset
        Distance from the sensor, in that unit, where the file's height is 0. If left out,
        heights of either sign count from a mid-range 240 mm from the sensor.
    """

    units: Literal["mm", "um", "m"] | None = None
    pitch: float | None = None
    invalid: list[float] | None = None
    z_scale: float = 1.0
    z_offset: float | None = None

    @property
    def profile_format(self) -> ProfileFormat:
        """The options as the format that the reader of profile files takes."""
        from tjscan.laser.files.format import ProfileFormat

        invalid = tuple(self.invalid or ())
        return ProfileFormat(self.units, self.pitch, invalid, self.z_scale, self.z_offset)


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class GrooveReadingOptions:
    """Options for reading grooves, each a key of a job's [groove] table.

    Parameters
    ----------
    model
        Shape of the groove; tee. The others give corners and no measures.
    noise_mm
        Largest standard deviation of the range that is expected; 0.05.
    minimum_points
        Fewest points of a profile that are worth a search; 80.
    largest_sigma_mm
        Largest standard deviation of a corner that is still accepted; 0.4.
    largest_rms_mm
        Largest deviation of the points from the fitted sides; 0.15.
    inlier_share
        Least share of a side's points that must lie on it; 0.1.
    """

    model: Literal["tee", "butt-v", "butt-v-sharp"] | None = None
    noise_mm: float | None = None
    minimum_points: int | None = None
    largest_sigma_mm: float | None = None
    largest_rms_mm: float | None = None
    inlier_share: float | None = None


def groove_settings_for_file(file: Path, options: GrooveReadingOptions | None) -> GrooveSettings:
    """Groove settings for a file: options before the job of a run directory before the defaults."""
    from tjscan.core.config import table_to_dict, validate_table
    from tjscan.groove.settings import GrooveSettings
    from tjscan.job.files import read_scan_job
    from tjscan.result.directory import JOB_FILE

    job = file / JOB_FILE
    own = table_to_dict(read_scan_job(job).groove) if job.is_file() else {}
    stated = {} if options is None else asdict(options)
    stated = {key: value for key, value in stated.items() if value is not None}
    return validate_table(GrooveSettings, own | stated)
