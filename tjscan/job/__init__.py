"""The job file: one scan, or one calibration, in millimetres and degrees, as a person writes it."""

from tjscan.job.devices import ArmTable, CalibrationTable, LaserTable
from tjscan.job.files import CalibrationJob, CellFile, JobFile
from tjscan.job.reading import read_calibration_job, read_job
from tjscan.job.simulation import (
    SimulatedBoardTable,
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
    "ArmTable",
    "BoardTable",
    "CalibrationJob",
    "CalibrationTable",
    "CellFile",
    "ClearanceTable",
    "JobFile",
    "JointTable",
    "LaserTable",
    "NamedPoseTable",
    "SimulatedBoardTable",
    "SimulatedStationTable",
    "SimulationTable",
    "SolidTable",
    "StandingTable",
    "StationTable",
    "read_calibration_job",
    "read_job",
]
