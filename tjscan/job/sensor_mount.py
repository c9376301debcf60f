"""Where the laser sits on the flange, as a job or its calibration file states it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tjscan.calibration.file import read_calibration
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.job import CellJob
from tjscan.job.arm import kinematics_of_job


@dataclass(frozen=True, slots=True, eq=False)
class SensorMount:
    """Pose of the laser on the flange, and the calibration file it comes from.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        Pose of the laser in the flange frame.
    file : Path or None
        The calibration it comes from; none where the job itself holds it.
    deviations : ndarray, shape (joints, 6), or None
        Of the arm's joints from its model, where they were calibrated with it.
    covariance : ndarray, shape (6, 6) or (6 + 6 joints, 6 + 6 joints), or None
        Of `T_f_s`, translation and small rotation in axes of f, and of the deviations, if any;
        SI. None where nobody states it.
    by_laser : ndarray, shape (6, m) or (6 + 6 joints, m), or None
        What of it comes from m draws of the laser's deviation, see `LaserDeviation.at`; none where
        that was not calibrated with.
    linearity : float
        Largest deviation of that laser, metres.
    """

    T_f_s: Array
    file: Path | None = None
    deviations: Array | None = None
    covariance: Array | None = None
    by_laser: Array | None = None
    linearity: float = 0.0


def sensor_mount_of_job(job: CellJob, job_file: Path) -> SensorMount:
    """Pose of the laser on the flange, as a job states it or as its calibration file does.

    Parameters
    ----------
    job : CellJob
        The job.
    job_file : Path
        Where it was read from.

    Raises
    ------
    ConfigurationError
        If the calibration can't be read, or holds for another arm or laser.
    """
    T_f_s = job.calibration.T_f_s
    if T_f_s is not None:
        return SensorMount(T_f_s, covariance=job.calibration.covariance)
    file = job_file.parent / str(job.calibration.file)
    # A recording does not say which laser made it, unless the job does.
    laser = job.laser.id if job.laser.driver_kind is DriverKind.REPLAYED else job.laser.device_id
    found = read_calibration(file, arm=job.arm.device_id, laser=laser)
    by_laser, linearity = None, 0.0
    if found.laser_response is not None:
        by_laser = found.laser_response.by_draws_si
        linearity = 1e-3 * found.laser_response.linearity_mm
    if found.kinematics is None:
        return SensorMount(found.T_f_s, file, None, found.covariance_si, by_laser, linearity)
    name = kinematics_of_job(job).name
    if found.kinematics.model != name:
        raise ConfigurationError(
            f"holds the kinematics of a {found.kinematics.model!r}, but this cell has a "
            f"{name!r}: calibrate this arm",
            file=file,
            key="kinematics.model",
        )
    arm = found.kinematics
    return SensorMount(found.T_f_s, file, arm.deviations_si, arm.covariance_si, by_laser, linearity)
