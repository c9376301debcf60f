"""The job file: one scan, or one calibration, in millimetres and degrees, as a person writes it."""

from tjscan.job.devices import ArmSettings, CalibrationSettings, LaserSettings
from tjscan.job.files import CalibrationJob, CellJob, LaserJob, ScanJob
from tjscan.job.reading import read_calibration_job, read_laser_job, read_scan_job
from tjscan.job.simulation import (
    SimulatedBoardSettings,
    SimulatedStationSettings,
    SimulationSettings,
)
from tjscan.job.station import StationPoseSettings, StationSettings
from tjscan.job.surroundings import (
    BoardSettings,
    ClearanceSettings,
    JointSettings,
    PlacedSolidSettings,
)
from tjscan.robot.solid_settings import SolidSettings

__all__ = [
    "ArmSettings",
    "BoardSettings",
    "CalibrationJob",
    "CalibrationSettings",
    "CellJob",
    "ClearanceSettings",
    "JointSettings",
    "LaserJob",
    "LaserSettings",
    "PlacedSolidSettings",
    "ScanJob",
    "SimulatedBoardSettings",
    "SimulatedStationSettings",
    "SimulationSettings",
    "SolidSettings",
    "StationPoseSettings",
    "StationSettings",
    "read_calibration_job",
    "read_laser_job",
    "read_scan_job",
]
