"""Teach a start pose: the arm's present pose into the job file."""

from __future__ import annotations

import shutil
from collections.abc import MutableMapping, MutableSequence, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import tomlkit
from tomlkit.exceptions import TOMLKitError

from tjscan.core.errors import ConfigurationError, GrooveNotFound, StartOnTack, StartSeesNoGroove
from tjscan.core.files import write_files_atomically
from tjscan.core.frames import Array, pose, pose_to_euler_zyx
from tjscan.groove.section import GrooveSection
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.robot.arm import await_rest, check_arm_has_not_moved
from tjscan.runs.scan.run import ScanContext, groove_reader_of_job

Which = Literal["first", "second"]
Numbers = tuple[float, ...]

POSITION_DECIMALS: Final = 3
ANGLE_DECIMALS: Final = 4
"""What is kept of a pose: finer than any arm repeats."""


@dataclass(frozen=True, slots=True, eq=False)
class TaughtPose:
    """A start pose as it was written into a job file, and the groove seen from there.

    Parameters
    ----------
    key : tuple of str
        Its place in the file.
    position_mm, euler_zyx_deg : tuple of float
        As the job file holds them.
    groove : GrooveSection
        What the laser saw from there.
    """

    key: tuple[str, ...]
    position_mm: Numbers
    euler_zyx_deg: Numbers
    groove: GrooveSection


def teach_pose(
    job: ScanJob, job_file: Path, which: Which, lead: Sequence[float] | None = None
) -> TaughtPose:
    """Write the arm's pose into a job file as a start pose, if the laser sees a groove there.

    It waits until the arm rests, for it may have been led there by hand a moment ago. Comments
    and everything else in the file stay as they are.

    Parameters
    ----------
    job : ScanJob
        The job as it was read, with keys replaced or not; of one station, if it has any.
    job_file : Path
        The file that it was read from, and what is changed.
    which : str
        Which of the two start poses it is.
    lead : sequence of float, shape (3,), optional
        Leads a simulated arm, which no hand can, to the pose in the job, moved by this
        much along the axes of the flange, in metres; without, it stays in its present pose.

    Raises
    ------
    StartSeesNoGroove
        If the laser reads no groove from there.
    StartOnTack
        If it looks at a tack weld.
    ArmFault, LaserFault
        If a device fails, or the arm does not rest.
    ConfigurationError
        If the job is wrong, or `lead` is given for another arm than a simulated one.
    PoseUnreachable
        If the arm can't be led there.
    RecordingError
        If the file can't be written; it then is what it was.
    """
    if lead is not None and job.arm.driver != "simulated":
        raise ConfigurationError(
            "leads a simulated arm alone; lead this one by hand or pendant", key="--lead-mm"
        )
    with ScanContext(job, job_file).make_cell() as cell:
        if lead is not None:
            T = job.start_poses[which == "second"].T
            cell.arm.move_joint_to_pose(pose(T[:3, :3], T[:3, 3] + T[:3, :3] @ lead))
        state = await_rest(cell.arm)
        profile = cell.laser.capture()
        check_arm_has_not_moved(state, cell.arm.state())
        try:
            groove = groove_reader_of_job(job)(profile)
        except GrooveNotFound as error:
            raise StartSeesNoGroove(which, error) from None
    if groove.on_tack:
        raise StartOnTack(which)
    key = ("station", job.station[0].name, which) if job.station else ("scan", which)
    taught = TaughtPose(key, *pose_for_job_file(state.T_b_f), groove)
    write_start_pose(job_file, key, taught.position_mm, taught.euler_zyx_deg)
    return taught


def pose_for_job_file(T_b_f: Array) -> tuple[Numbers, Numbers]:
    """Position in millimetres and Z-Y-X Euler angles in degrees, as a job file holds them."""
    position, angles = pose_to_euler_zyx(T_b_f)
    position_mm = np.round(1e3 * position, POSITION_DECIMALS) + 0.0  # no minus zero
    euler_zyx_deg = np.round(np.degrees(angles), ANGLE_DECIMALS) + 0.0
    return tuple(position_mm.tolist()), tuple(euler_zyx_deg.tolist())


def write_start_pose(
    job_file: Path, key: Sequence[str], position_mm: Numbers, euler_zyx_deg: Numbers
) -> None:
    """Replace one start pose in a job file, and leave all else; the file is whole at any time.

    Parameters
    ----------
    job_file : Path
        The file.
    key : sequence of str
        Place of the pose: ``scan``, ``first``; or ``station``, its name, ``first``.
    position_mm, euler_zyx_deg : tuple of float
        The pose.

    Raises
    ------
    ConfigurationError
        If the file is no job any more.
    RecordingError
        If it can't be written.
    """
    file = job_file.resolve()  # the target of a link, so that it stays a link
    try:
        document = tomlkit.parse(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, TOMLKitError) as error:
        raise ConfigurationError(f"can't be read again: {error}", file=job_file) from None
    table: Any = document
    for name in key:
        table = _find_inner_table(table, name, job_file)
    table["position_mm"] = list(position_mm)
    table["euler_zyx_deg"] = list(euler_zyx_deg)
    with write_files_atomically(file.parent) as folder:
        draft = folder / file.name
        draft.write_text(tomlkit.dumps(document), encoding="utf-8")
        shutil.copymode(file, draft)
        try:
            read_scan_job(draft)  # a file that would not be read again is not written
        except ConfigurationError as error:
            raise ConfigurationError(error.message, file=job_file, key=error.key) from None


def _find_inner_table(parent: Any, name: str, job_file: Path) -> Any:
    """A table in a table, or in an array of tables by its name."""
    if isinstance(parent, MutableMapping):
        found = parent.get(name)
    else:
        found = next((one for one in parent if one.get("name") == name), None)
    if not isinstance(found, MutableMapping | MutableSequence):
        raise ConfigurationError("must be a table", file=job_file, key=name)
    return found
