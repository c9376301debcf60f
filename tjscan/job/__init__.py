"""The job files: what is to be done, in millimetres and degrees, as a person writes it."""

from tjscan.job.devices import CalibrationSettings, LaserSettings
from tjscan.job.files import (
    CalibrationJob,
    CellJob,
    RecordedJob,
    ScanJob,
    has_recorded_profiles,
    read_calibration_job,
    read_laser_job,
    read_recorded_job,
    read_scan_job,
)
from tjscan.job.simulation import SimulatedBoardSettings
from tjscan.job.surroundings import JointSettings

__all__ = [
    "CalibrationJob",
    "CalibrationSettings",
    "CellJob",
    "JointSettings",
    "LaserSettings",
    "RecordedJob",
    "ScanJob",
    "SimulatedBoardSettings",
    "has_recorded_profiles",
    "read_calibration_job",
    "read_laser_job",
    "read_recorded_job",
    "read_scan_job",
]
