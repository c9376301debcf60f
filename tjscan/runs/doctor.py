"""Check a job's cell and report what is wrong and what to do, without moving anything."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import machine
from typing import Any, Final

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError, TjscanError
from tjscan.job.cell import Cell, clear_path_planner_of_job
from tjscan.job.devices import LaserSettings
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.laser.line_laser import SelfDescribingLaser
from tjscan.runs.scan.rehearsal import check_scan_job, is_simulated
from tjscan.runs.scan.run import ScanContext, groove_reader_of_job, result_frame_of_job
from tjscan.scanning.continuous.stream import PROFILE_PERIOD

REPORTED_LIBRARIES: Final = (
    "tjscan",
    "pin",
    "coal",
    "open3d-cpu" if (sys.platform, machine()) == ("linux", "x86_64") else "open3d",
    "numpy",
    "ur_rtde",
    "viva-genicam",
)
"""Whose versions are reported."""

MODEL_FLANGE_TOLERANCE: Final = 0.02
"""Metres between the flange as reported by the arm and as computed by its model; a larger
difference is another arm, for a kinematic calibration corrects less."""

FEWEST_POINTS_IN_RANGE: Final = 100
"""Points of a profile below which nothing is in the sensor's range."""


MOST_POINTS_BEYOND: Final = 0.5
"""Share of the points that may be out of the stated range: more is another range, or unit."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of one check: what was checked, what was found, and the error if there is one.

    Parameters
    ----------
    what : str
        What was checked.
    detail : str
        What was found; if something is wrong, with the remedy.
    error : TjscanError or None
        What is wrong.
    """

    what: str
    detail: str
    error: TjscanError | None = None

    @property
    def passed(self) -> bool:
        """Whether the check found nothing wrong."""
        return self.error is None


def check_job_and_cell(
    job_file: Path, overrides: dict[str, Any] | None = None, station: str | None = None
) -> Iterator[CheckResult]:
    """Check a job, what it names, its devices and the way to its start poses, one after another.

    Devices are connected, and nothing moves. What rests on something that is wrong is left out.

    Parameters
    ----------
    job_file : Path
        The job.
    overrides : dict, optional
        Dotted keys and their values, as `read_scan_job` takes them.
    station : str, optional
        The one station to look at; all by default.
    """
    yield CheckResult("versions", ", ".join(_library_versions()))
    jobs: list[ScanJob] = []

    def read() -> str:
        with add_file_to_errors(job_file):
            job = read_scan_job(job_file, overrides)
            jobs.extend(job.jobs_at_stations if station is None else (job.job_at_station(station),))
        return f"{job_file} is sound"

    yield (finding := _run_check("job", read))
    if not finding.passed:
        return
    context = ScanContext(jobs[0], job_file)
    named = [
        _run_check("joint", _describe_joint, context),
        _run_check("calibration", _describe_calibration, context),
        _run_check("clearance", _describe_clearance, jobs[0]),
    ]
    yield from named
    if all(finding.passed for finding in named):
        for job in jobs:
            where = f"{job.station[0].name}: " if len(jobs) > 1 else ""
            for finding in _check_devices(job, job_file):
                yield replace(finding, what=f"{where}{finding.what}")


def _check_devices(job: ScanJob, job_file: Path) -> Iterator[CheckResult]:
    try:
        cell = ScanContext(job, job_file).make_cell()
    except TjscanError as error:
        yield CheckResult("cell", str(error), error)
        return
    with ExitStack() as stack:

        def connect(device: Any, name: str) -> str:
            stack.enter_context(device)
            return name

        yield (arm := _run_check("arm", connect, cell.arm, f"{job.arm.driver} {job.arm.model}"))
        yield (laser := _run_check("laser", connect, cell.laser, job.laser.device_id))
        if laser.passed and isinstance(cell.laser, SelfDescribingLaser):
            yield _run_check("laser's link", _describe_laser_link, cell.laser)
            yield _run_check("laser's format", lambda device: device.describe().format, cell.laser)
            yield _run_check("laser's range", _compare_laser_range, cell.laser, job.laser)
        if laser.passed and job.scan.mode == "continuous":
            yield _run_check("laser's stream", _check_stream, cell.laser)
        if arm.passed:
            yield _run_check("model", _compare_arm_with_model, cell)
            yield _run_check("stance", _describe_nearest_bodies, cell)
        if laser.passed and arm.passed:
            yield _run_check("profile", _describe_profile, cell, job)
        if arm.passed:
            first, second = (start.T for start in job.start_poses)
            poses = [
                _run_check("first pose", _check_arm_path, cell, first),
                _run_check("second pose", _check_arm_path, cell, first, second),
            ]
            yield from poses
    if arm.passed and laser.passed and is_simulated(job):
        groove = _run_check("groove", _rehearse, ScanContext(job, job_file))
        # What is wrong with a pose is said once, or again with what to write instead.
        if all(pose.passed for pose in poses) or isinstance(groove.error, ConfigurationError):
            yield groove


def _run_check(what: str, look: Callable[..., str], *things: Any) -> CheckResult:
    """What a look at some things finds, or what is wrong with them."""
    try:
        return CheckResult(what, look(*things))
    except TjscanError as error:
        return CheckResult(what, str(error), error)


def _library_versions() -> Iterator[str]:
    for library in REPORTED_LIBRARIES:
        try:
            yield f"{library} {version(library)}"
        except PackageNotFoundError:
            yield f"{library} not installed"


def _describe_joint(context: ScanContext) -> str:
    frame = f"results will be in frame {result_frame_of_job(context.job).letter}"
    return f"none named: {frame}" if context.joint is None else f"{context.joint_file}; {frame}"


def _describe_calibration(context: ScanContext) -> str:
    mount = context.sensor_mount
    where = "as the job has it" if mount.file is None else f"{mount.file}"
    away = 1e3 * np.linalg.norm(mount.T_f_s[:3, 3])
    return f"{where}; the sensor is {away:.0f} mm from the flange"


def _describe_clearance(job: ScanJob) -> str:
    clear_path_planner_of_job(job)
    table = job.clearance
    around = ", ".join(one.name for one in table.solid) or "nothing"
    carried = ", ".join(one.name for one in table.tool) or "nothing"
    return f"keeps {1e3 * table.solids:g} mm from {around}; carries {carried}"


def _compare_arm_with_model(cell: Cell) -> str:
    """Whether the arm is the one that the job names."""
    state = cell.arm.state()
    who = cell.arm.identity or "connected"
    T_b_f = cell.clearance.kinematics.forward(state.q)
    apart = float(np.linalg.norm(T_b_f[:3, 3] - state.T_b_f[:3, 3]))
    if apart > MODEL_FLANGE_TOLERANCE:
        raise ConfigurationError(
            f"the arm has its flange {1e3 * apart:.0f} mm from where the model has it; name the "
            "arm that is there",
            key="arm.model",
        )
    return f"{who}; its flange is {1e3 * apart:.1f} mm from where the model has it"


def _describe_nearest_bodies(cell: Cell) -> str:
    nearest = cell.clearance.nearest_bodies(cell.arm.state().q)
    if nearest is None:
        return "nothing is known that the arm could touch"
    pair, distance = nearest
    return f"nearest to each other are {pair.moving} and {pair.other}, {1e3 * distance:.0f} mm"


def _describe_laser_link(laser: Any) -> str:
    described = laser.describe()
    return "; ".join(filter(None, (f"{laser.identity} at {described.link}", described.advice)))


def _check_stream(laser: Any) -> str:
    laser.check_stream(PROFILE_PERIOD)
    return f"{1 / PROFILE_PERIOD:g} profiles a second are asked for, stamped by a clock that runs"


def _compare_laser_range(laser: SelfDescribingLaser, table: LaserSettings) -> str:
    """Whether the laser can state every z of the job's measuring range."""
    described = laser.describe()
    wanted = f"{1e3 * table.near:g} to {1e3 * table.far:g} mm"
    able = f"it can state z from {1e3 * described.near:g} to {1e3 * described.far:g} mm"
    if described.near > table.near or described.far < table.far:
        raise ConfigurationError(
            f"the job expects z from {wanted}, and {able}: set near_mm and far_mm to what its "
            "manual states; if its z points the other way, laser.genicam.flip_z and offset_mm",
            key="laser.near_mm",
        )
    return f"{able}; the job expects {wanted}"


def _rehearse(context: ScanContext) -> str:
    check_scan_job(context)
    return "is read at both taught poses"


def _describe_profile(cell: Cell, job: ScanJob) -> str:
    read, table = groove_reader_of_job(job), job.laser
    profile = cell.laser.capture()
    valid = int(profile.valid.sum())
    points = f"{valid} of {len(profile)} points"
    if valid < FEWEST_POINTS_IN_RANGE:
        return f"{points}: nothing in range of the arm's place"
    z = profile.z_s[profile.valid]
    beyond = float(np.mean((z < table.near) | (z > table.far)))
    if beyond > MOST_POINTS_BEYOND:
        raise ConfigurationError(
            f"{beyond:.0%} of the points are not from {1e3 * table.near:g} to {1e3 * table.far:g} "
            f"mm away, as the job has it, but from {1e3 * z.min():.4g} to {1e3 * z.max():.4g} mm: "
            "set near_mm and far_mm to what the sensor's manual states, and see that the unit of "
            "its coordinates is right",
            key="laser.near_mm",
        )
    try:
        read(profile)
    except TjscanError:
        return f"{points}, and no groove at the arm's place: lead it to a taught pose to see one"
    return f"{points}, and a groove at the arm's place"


def _check_arm_path(cell: Cell, *T_b_f: Any) -> str:
    cell.arm.check_moves(*T_b_f)
    return "the way there is clear"
