"""The job file: one scan, or one calibration, in millimetres and degrees, as a person writes it."""

from tjscan.job.devices import ArmTable, CalibrationTable, LaserTable, UrTable
from tjscan.job.fields import PoseTable
from tjscan.job.files import CalibrationJob, CellFile, JobFile
from tjscan.job.reading import read_calibration_job, read_job
from tjscan.job.scan import AdaptiveTable, GrooveTable, ReadingTable, ScanTable, SkipTable
from tjscan.job.simulation import (
    SimulatedArmTable,
    SimulatedBoardTable,
    SimulatedLaserTable,
    SimulatedStationTable,
    SimulationTable,
)
from tjscan.job.station import NamedPoseTable, StationTable
from tjscan.job.surroundings import (
    BoardTable,
    ClearanceTable,
    JointTable,
    SolidTable,
    StandingTable,
)

__all__ = [
    "AdaptiveTable",
    "ArmTable",
    "BoardTable",
    "CalibrationJob",
    "CalibrationTable",
    "CellFile",
    "ClearanceTable",
    "GrooveTable",
    "JobFile",
    "JointTable",
    "LaserTable",
    "NamedPoseTable",
    "PoseTable",
    "ReadingTable",
    "ScanTable",
    "SimulatedArmTable",
    "SimulatedBoardTable",
    "SimulatedLaserTable",
    "SimulatedStationTable",
    "SimulationTable",
    "SkipTable",
    "SolidTable",
    "StandingTable",
    "StationTable",
    "UrTable",
    "read_calibration_job",
    "read_job",
]
