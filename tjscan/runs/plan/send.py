"""Send a station's program to its arm."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, inverse_pose
from tjscan.job.cell import collision_model_of_job, kinematics_of_job
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.planning.urscript import StationPath, path_to_urscript
from tjscan.planning.wps import WeldingProcedure
from tjscan.result.directory import JOB_FILE
from tjscan.robot.clearance import ClearPathPlanner
from tjscan.robot.collision_checked import CollisionCheckedArm
from tjscan.robot.path import MotionLimits
from tjscan.robot.ur.arm import UrArm
from tjscan.robot.ur.moving import UrProgram
from tjscan.runs.plan.run import ArcSwitch
from tjscan.runs.scan.run import ScanContext

UR_DRIVER: Final = "ur"


def read_job_of_program_arm(job_file: Path, station: str | None, run: Path) -> ScanJob:
    """Read the job, of one station, of an arm that is to run a program; check its arm and place.

    Parameters
    ----------
    job_file : Path
        The job.
    station : str or None
        Its station in the job.
    run : Path
        The run directory, with the job that the groove was scanned with.

    Raises
    ------
    ConfigurationError
        If it is no real arm of Universal Robots, another arm or joint than the run's, or elsewhere.
    """
    with add_file_to_errors(job_file):
        job = read_scan_job(job_file)
        job = job.job_at_station(station) if job.station else job
        if job.arm.driver != UR_DRIVER:
            raise ConfigurationError(
                f"a program goes to a real arm alone, whose driver is {UR_DRIVER!r} (found "
                f"{job.arm.driver!r})",
                key="arm.driver",
            )
        if (run / JOB_FILE).is_file():
            scanned = ScanContext(read_scan_job(run / JOB_FILE), run / JOB_FILE)
            if job.arm.model != (model := scanned.job.arm.model):
                reason = f"is a {job.arm.model}, but the run was scanned with a {model}"
                raise ConfigurationError(reason, key="arm.model")
            mine, theirs = ScanContext(job, job_file).joint, scanned.joint
            # What the two files are called says nothing: the run's is a copy.
            if mine and theirs and replace(mine, name=theirs.name) != theirs:
                reason = (
                    "is another joint than the run's: plan a run of this joint, or name its job"
                )
                raise ConfigurationError(reason, key="joint.file")
            _check_arm_place(job, scanned.job, station)
    return job


def _check_arm_place(job: ScanJob, scanned: ScanJob, station: str | None) -> None:
    """Refuse a job whose arm is at another place by the joint than it was for the run."""
    if job.joint is None or scanned.joint is None:
        return
    name = station or next(iter(job.station_names), None)
    at = scanned.job_at_station(name) if scanned.station else scanned
    T_j_b, T_j_b_scanned = (
        inverse_pose(table.T_w_j) @ T_w_b
        for table, T_w_b in ((job.joint, job.T_w_b), (scanned.joint, at.T_w_b))
    )
    if not np.allclose(T_j_b, T_j_b_scanned, atol=1e-6):
        away = 1e3 * np.linalg.norm((T_j_b - T_j_b_scanned)[:3, 3])
        raise ConfigurationError(
            f"the arm is elsewhere by the joint than in the run's own job, {away:.1f} mm away "
            "and perhaps turned: the program would weld beside the groove. Scan it from there",
            key="joint",
        )


def find_station_path(paths: Mapping[str, StationPath], station: str | None) -> StationPath:
    """The path of a station, or the only one there is.

    Raises
    ------
    ConfigurationError
        If there is none, or several and none is named.
    """
    by_station = {path.station: path for path in paths.values()}
    if not by_station:
        reason = "there is no program to send: the plan states why"
        raise ConfigurationError(reason, key="--send-to")
    if station is None and len(by_station) == 1:
        (station,) = by_station
    if station in by_station:
        return by_station[station]
    wanted = f"there is no program of {station!r}" if station else "there are several programs"
    raise ConfigurationError(f"{wanted}; choose one of: {', '.join(by_station)}", key="--station")


def send_program(
    job: ScanJob,
    path: StationPath,
    wps: WeldingProcedure,
    switch: ArcSwitch,
    started: Callable[[], object],
) -> None:
    """Move an arm to the beginning of a program, on a checked path, and run it.

    Parameters
    ----------
    job : ScanJob
        Of the arm.
    path : StationPath
        Of its station.
    wps : WeldingProcedure
        With the torch that it carries.
    switch : ArcSwitch
        How the program switches the arc.
    started : callable
        Is called once the program runs.

    Raises
    ------
    ArmFault
        If the arm can't be reached, is not ready, or did not come to the program's end.
    """
    model, table = kinematics_of_job(job), job.clearance
    collisions = collision_model_of_job(job, model, wps.torch.solid)
    clearance = ClearPathPlanner(model, collisions, table)
    limits = MotionLimits(tcp_speed=job.arm.speed, tcp_acceleration=job.arm.acceleration)
    device = UrArm(model, job.arm.driver_settings, limits)
    off = f"def tjscan_arc_off():\n  set_standard_digital_out({switch.output}, False)\nend\n"
    T_b_tcp: Array = path.beads[-1].retreat[-1]
    script = path_to_urscript(path, wps, switch.output, arc=switch.on)
    with CollisionCheckedArm(device, clearance, wps.torch.tcp.T, lifts=table.lifts) as checked:
        start = path.beads[0].approach[0] @ inverse_pose(wps.torch.tcp.T)
        checked.move_joint_to_pose(start, near=np.asarray(path.q))
        device.run_program(UrProgram(script, T_b_tcp, off, switch.output), started)
