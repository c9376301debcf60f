"""Rehearse a scan job: the way to its taught poses, what is seen there, and what is amiss if not.

Of a job that fails the usual mistakes are undone one after the other: radians, rotation vectors,
angles in another order, a joint in metres, an inverse mount. Only what then passes is proposed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Final, cast

import numpy as np

from tjscan.calibration.pose_files import (
    FANUC_CONVENTION,
    KUKA_CONVENTION,
    RADIANS_PER_UNIT,
    UR_CONVENTION,
    OrientationConvention,
)
from tjscan.core import errors
from tjscan.core.config import add_file_to_errors
from tjscan.core.devices import DriverKind
from tjscan.core.frames import inverse_pose, pose, pose_to_euler_zyx
from tjscan.core.units import DEG, MM, PoseSettings, pose_to_rows_mm
from tjscan.groove.section import GrooveSection
from tjscan.job.carrier import check_carrier_at_station
from tjscan.job.cell import Cell
from tjscan.job.files import ScanJob
from tjscan.runs.scan.run import ScanContext, groove_reader_of_job
from tjscan.scanning.scanner import LEAST_SHARE_AHEAD
from tjscan.scanning.sections_before import check_second_is_ahead

LOOKS_AT_START_POSE: Final = 3
"""Profiles taken at a start pose at most: in one a fault may hide the groove."""

METRES_BELOW: Final = 0.02
"""Metres: coordinates that are all smaller may have been metres, taken for millimetres."""


def check_scan_job(context: ScanContext) -> None:
    """Check a job, what it names, and the way from here to its taught poses; nothing real moves.

    Raises
    ------
    ConfigurationError
        If the job is wrong, or, of a simulated cell, would pass with a usual mistake undone.
    PoseUnreachable
        If a taught pose is, or the way there is blocked.
    StartSeesNoGroove, StartOnTack
        If the whole cell is simulated, and no groove is read at a taught pose.
    CarrierFault
        If the job is of one station, and its carrier is elsewhere.
    """
    with add_file_to_errors(context.job_file):
        jobs = context.job.jobs_at_stations
    if len(context.job.station) == 1:
        check_carrier_at_station(context.job)
    for job in jobs:
        here = replace(context, job=job)
        try:
            with add_file_to_errors(context.job_file):
                _rehearse(here)
        except (errors.ArmFault, errors.LaserFault) as error:
            hint = _mistake_undone(here) if is_simulated(job) else None
            if hint is None:
                raise
            key, remedy = hint
            raise errors.ConfigurationError(
                f"{remedy}, and the way is clear and a groove is read at both poses. As it is, "
                f"{errors.message_with_notes(error)}",
                file=context.job_file,
                key=key,
            ) from None


def is_simulated(job: ScanJob) -> bool:
    """Whether neither arm nor laser of a job is real, nor replayed."""
    return {job.arm.driver_kind, job.laser.driver_kind} == {DriverKind.SIMULATED}


def _rehearse(context: ScanContext) -> None:
    job = context.job
    with context.make_cell() as cell:
        cell.arm.check_moves(*(start.T for start in job.start_poses))
        if is_simulated(job):
            look_at_start_poses(cell, job)


def look_at_start_poses(cell: Cell, job: ScanJob) -> None:
    """Move a simulated arm to the taught poses, and read the groove there.

    Raises
    ------
    StartSeesNoGroove, StartOnTack
        If none is read, or a tack weld is.
    ConfigurationError
        If the second is not ahead of the first.
    """
    T_b_g = []
    for which, start in zip(("first", "second"), job.start_poses, strict=True):
        T_b_f = cell.arm.move_joint_to_pose(start.T).T_b_f
        groove = _read_at_start_pose(cell, job, which)
        if groove.on_tack:
            raise errors.StartOnTack(which)
        T_b_g.append(T_b_f @ cell.T_f_s @ groove.T_s_g)
    plan = job.scan
    check_second_is_ahead(T_b_g[0], T_b_g[1][:3, 3], plan.direction, LEAST_SHARE_AHEAD * plan.step)


def _read_at_start_pose(cell: Cell, job: ScanJob, which: str) -> GrooveSection:
    read = groove_reader_of_job(job)
    for left in reversed(range(LOOKS_AT_START_POSE)):
        try:
            return read(cell.laser.capture())
        except errors.GrooveNotFound as error:
            if not left:
                raise errors.StartSeesNoGroove(which, error) from None
    raise AssertionError


def _mistake_undone(context: ScanContext) -> tuple[str, str] | None:
    """Key and remedy of a mistake without which the job passes."""
    for key, remedy, corrected in _jobs_without_a_mistake(context):
        try:
            _rehearse(corrected)
        except errors.TjscanError:
            continue
        return key, remedy
    return None


Reading = Callable[[PoseSettings], PoseSettings]


def _jobs_without_a_mistake(context: ScanContext) -> Iterator[tuple[str, str, ScanContext]]:
    """Key, remedy and job for each mistake that the job may hold."""
    job, starts = context.job, dict(zip(("first", "second"), context.job.start_poses, strict=True))
    for name, read in POSE_READINGS.items():
        for which in (("first", "second"), ("first",), ("second",)):
            meant = {key: read(starts[key]) for key in which}
            if any(meant[key] == starts[key] for key in which):
                continue
            words = "; ".join(f"{key}: {_pose_in_file(one)}" for key, one in meant.items())
            corrected = _with_start_poses(context, starts | meant)
            yield f"scan.{which[0]}", f"looks like {name}: write {words}", corrected
    table = job.calibration
    if table.T_f_s is not None:
        rows = pose_to_rows_mm(inverse_pose(table.T_f_s))
        written = [[round(value, 4) for value in row] for row in rows]
        remedy = f"looks like the flange in the sensor's frame: write {written}"
        corrected = _with(context, calibration=replace(table, T_f_s_mm=rows))
        yield "calibration.T_f_s_mm", remedy, corrected
    if job.joint is not None:
        for name, read in (("metres", _metres), *POSE_READINGS.items()):
            joint = read(job.joint)
            if joint != job.joint:
                remedy = f"looks like {name}: write {_pose_in_file(joint)}"
                yield "joint", remedy, _with(context, joint=joint)


def _with(context: ScanContext, **tables: object) -> ScanContext:
    return ScanContext(context.job.model_copy(update=tables), context.job_file)


def _with_start_poses(context: ScanContext, starts: dict[str, PoseSettings]) -> ScanContext:
    job, changed = context.job, cast("dict[str, Any]", starts)
    if not job.station:
        return _with(context, scan=replace(job.scan, **changed))
    return _with(context, station=(replace(job.station[0], **changed),))


def _pose_in_file(one: PoseSettings) -> str:
    position = [float(f"{value:.6g}") for value in MM.to_file(one.position)]
    angles = [float(f"{value:.5g}") for value in DEG.to_file(one.euler_zyx)]
    return f"position_mm = {position}, euler_zyx_deg = {angles}"


def _metres(one: PoseSettings) -> PoseSettings:
    """The pose whose position was written in metres."""
    if not 0 < max(map(abs, one.position)) < METRES_BELOW:
        return one
    return replace(one, position=MM.to_file(one.position))


def _read_as(convention: OrientationConvention, unit: str) -> Reading:
    """Read the numbers of an orientation by another convention, in radians or degrees."""

    def read(one: PoseSettings) -> PoseSettings:
        angles = RADIANS_PER_UNIT[unit] * np.array(DEG.to_file(one.euler_zyx))
        if np.abs(angles).max() > 2 * np.pi:
            return one
        T = pose(convention.matrix(angles))
        return replace(one, euler_zyx=tuple(pose_to_euler_zyx(T)[1].tolist()))

    return read


POSE_READINGS: Final[dict[str, Reading]] = {
    "radians": _read_as(KUKA_CONVENTION, "rad"),
    "roll, pitch, yaw [rx, ry, rz]": _read_as(FANUC_CONVENTION, "deg"),
    "roll, pitch, yaw [rx, ry, rz] in radians": _read_as(FANUC_CONVENTION, "rad"),
    "a rotation vector in radians": _read_as(UR_CONVENTION, "rad"),
    "a rotation vector in degrees": _read_as(UR_CONVENTION, "deg"),
}
"""How an orientation may have been written, and what the pose then means."""
