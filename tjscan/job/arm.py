"""From a job to its arm's kinematics, its clear paths, and the pose of the laser on its flange."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from tjscan.calibration.file import read_calibration
from tjscan.core.config import add_file_to_errors
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, inverse_pose
from tjscan.job.files import CellJob
from tjscan.robot.clearance import ClearPathPlanner
from tjscan.robot.collision import CollisionModel, check_ignored_links
from tjscan.robot.deviations import with_deviations
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import Solid


def kinematics_of_job(job: CellJob) -> Kinematics:
    """Kinematics of the arm's model; ConfigurationError if the model is unknown."""
    with add_file_to_errors(key="arm.model"):
        return Kinematics.load(job.arm.model)


def clear_path_planner_of_job(job: CellJob, deviations: Array | None = None) -> ClearPathPlanner:
    """Planner that keeps a job's arm clear of its surroundings, whichever driver moves it.

    Parameters
    ----------
    job : CellJob
        The job.
    deviations : ndarray, shape (joints, 6), optional
        Of the arm's joints from its model.

    Raises
    ------
    ConfigurationError
        If the arm's model is unknown or its geometry can't be read, or an ignored link is unknown.
    """
    table = job.clearance
    kinematics = kinematics_of_job(job)
    if deviations is not None:
        kinematics = with_deviations(kinematics, deviations)
    with add_file_to_errors(key="clearance.ignore"):
        check_ignored_links(kinematics, table.ignore)
    with add_file_to_errors(key="arm.model"):
        model = CollisionModel(
            kinematics,
            solids_in_base(job),
            [one.solid for one in table.tool],
            self_collision=table.self_collision,
            ignored=table.ignore,
        )
    return ClearPathPlanner(kinematics, model, table)


def solids_in_base(job: CellJob, T_b_w: Array | None = None) -> tuple[Solid, ...]:
    """Solids about a job's arm, with their poses in frame b.

    Parameters
    ----------
    job : CellJob
        The job, of one station if it has any.
    T_b_w : ndarray, shape (4, 4), optional
        Pose of the workpiece's frame; the one in the job if left out.
    """
    T_b_w = inverse_pose(job.T_w_b) if T_b_w is None else T_b_w
    return tuple(
        one.solid if one.frame == "b" else replace(one.solid, T=T_b_w @ one.solid.T)
        for one in job.clearance.solid
    )


@dataclass(frozen=True, slots=True, eq=False)
class SensorMount:
    """Pose of the laser on the flange, and the calibration file it comes from.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        Pose of the laser in the flange frame.
    file : Path or None
        The calibration it comes from; None if the job itself holds it.
    deviations : ndarray, shape (joints, 6), or None
        Of the arm's joints from its model, where they were calibrated with it.
    covariance : ndarray, shape (6, 6) or (6 + 6 joints, 6 + 6 joints), or None
        Of `T_f_s`, translation and small rotation in axes of f, and of the deviations, if any;
        SI. None if it is not known.
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
    if (T_f_s := job.calibration.T_f_s) is not None:
        return SensorMount(T_f_s, covariance=job.calibration.covariance)
    file = job_file.parent / str(job.calibration.file)
    # A recording does not name the laser that made it, unless the job does.
    laser = job.laser.id if job.laser.driver_kind is DriverKind.REPLAYED else job.laser.device_id
    found = read_calibration(file, arm=job.arm.device_id, laser=laser)
    by_laser, linearity = None, 0.0
    if (response := found.laser_response) is not None:
        by_laser, linearity = response.by_draws_si, 1e-3 * response.linearity_mm
    if (arm := found.kinematics) is None:
        return SensorMount(found.T_f_s, file, None, found.covariance_si, by_laser, linearity)
    if arm.model != (name := kinematics_of_job(job).name):
        raise ConfigurationError(
            f"holds the kinematics of a {arm.model!r}, but this cell has a {name!r}: calibrate "
            "this arm",
            file=file,
            key="kinematics.model",
        )
    return SensorMount(found.T_f_s, file, arm.deviations_si, arm.covariance_si, by_laser, linearity)
