"""Run a calibration from recorded profiles: from its job to a directory with the result."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from tjscan.calibration.file import SavedCalibration, to_calibration_file, write_calibration
from tjscan.calibration.recorded import calibrate_recorded_sets
from tjscan.core.errors import ConfigurationError
from tjscan.core.provenance import Provenance
from tjscan.job import RecordedJob
from tjscan.result.directory import CALIBRATION_FILE
from tjscan.robot.kinematics import Kinematics

UNNAMED_DEVICE: Final = "unnamed"
"""Name in the file of an arm or a laser without an id; no scan takes the file."""


def calibrate_recorded_job(
    job: RecordedJob, job_file: Path, directory: Path, report: Callable[[str], None]
) -> SavedCalibration:
    """Calibrate from the recorded profiles of a job, and write ``calibration.toml``.

    Parameters
    ----------
    job : RecordedJob
        The job.
    job_file : Path
        Its file, from whose folder the paths of recorded files start.
    directory : Path
        To make, once there is a result.
    report : callable
        Receives messages about files, left-out profiles and results.

    Raises
    ------
    ConfigurationError
        If a file is missing or wrong, or the directory holds a calibration already.
    CalibrationRefused
        If the result could not be trusted.
    """
    file = directory / CALIBRATION_FILE
    if file.exists():
        raise ConfigurationError("is there already; choose another --out", file=file)
    result, basis = calibrate_recorded_sets(
        job.recorded,
        job.noise,
        job_file.parent,
        report,
        sensor_is_fixed=job.solve.fixed_sensor,
        kinematics=Kinematics.load(job.arm.model) if job.solve.calibrate_arm else None,
    )
    found = to_calibration_file(
        result,
        job.noise,
        arm=job.arm.id or UNNAMED_DEVICE,
        laser=job.laser.id or UNNAMED_DEVICE,
        date=datetime.now(UTC).replace(microsecond=0),
        basis=basis,
    )
    frame = "b" if job.solve.fixed_sensor else "f"
    write_calibration(file, found, Provenance.for_file_written_now(job_file.name, frame))
    return SavedCalibration(file, found, result.caveats)
