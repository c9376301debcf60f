"""Run a job: from the job file to a run directory that tells all."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from tjscan.core.config import naming
from tjscan.core.errors import (
    ConfigurationError,
    Interrupted,
    RecordingError,
    TjscanError,
    words_of,
)
from tjscan.core.files import check_inside, sole_writer
from tjscan.groove.find import find_groove
from tjscan.groove.section import GrooveSection
from tjscan.job import AdaptiveTable, JobFile, ScanTable, read_job
from tjscan.job.cell import Cell, mount_of, open_cell
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import read_joint
from tjscan.laser.profile import Profile
from tjscan.recording.origin import Origin, changes
from tjscan.recording.reader import read_messages, read_origin, read_progress
from tjscan.recording.writer import Recording, next_part, parts
from tjscan.report.write import write_report
from tjscan.result.directory import JOB
from tjscan.result.frame import ResultFrame
from tjscan.result.summary import Summary
from tjscan.robot.arm import Arm, identity_words
from tjscan.robot.cleared import ClearedArm
from tjscan.runs.directory import COPIES, is_untouched, make_directory, origin_of
from tjscan.runs.results import write_scan
from tjscan.scanning.adaptive import Adaptive
from tjscan.scanning.correction_criterion import CorrectionCriterion
from tjscan.scanning.events import ScanEvent
from tjscan.scanning.journal import Journal, Journals
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.prediction import CASES, SMOOTH, Prediction
from tjscan.scanning.profile_taker import Setup
from tjscan.scanning.result import InterruptedScan, ScanResult
from tjscan.scanning.scanned_surface import ScannedSurface
from tjscan.scanning.scanner import Scanner
from tjscan.scanning.stopping import StopRequest
from tjscan.scanning.target import Direction

RESUMABLE: Final = (
    "scan.length_mm",
    "scan.sections",
    "scan.step_mm",
    "scan.prediction_case",
    "scan.resume_tolerance_mm",
    "scan.skip.",
    "scan.adaptive.",
    "arm.speed_mm_s",
    "arm.acceleration_mm_s2",
    "arm.ur.",
    "clearance.",
    "simulation.",
)
"""Keys that may change while a scan goes on."""


def plan_of(job: JobFile) -> ScanPlan:
    """The scan that a job asks for, in metres and radians."""
    table = job.scan
    return ScanPlan(
        step=1e-3 * table.step_mm,
        prediction=_prediction_of(table),
        direction=Direction(table.direction),
        pull_angle=float(np.radians(table.pull_angle_deg)),
        standoff=1e-3 * table.standoff_mm,
        offset=1e-3 * table.view_offset_mm,
        length=None if table.length_mm is None else 1e-3 * table.length_mm,
        sections=table.sections,
        skip=_skip_of(table),
        adaptive=_adaptive_of(table.adaptive),
        return_tolerance=1e-3 * table.resume_tolerance_mm,
    )


def _prediction_of(scan: ScanTable) -> Prediction | Literal["smooth"]:
    return "smooth" if scan.prediction_case == SMOOTH else CASES[scan.prediction_case]


def _adaptive_of(table: AdaptiveTable | None) -> Adaptive | None:
    if table is None:
        return None
    return Adaptive(
        1e-3 * table.least_mm,
        1e-3 * table.most_mm,
        float(np.radians(table.angle_change_deg)),
        1e-6 * table.area_change_mm2,
        float(np.radians(table.turn_deg)),
    )


def _skip_of(scan: ScanTable) -> CorrectionCriterion | None:
    table = scan.skip
    enabled = scan.prediction_case not in CASES if table.enabled is None else table.enabled
    if not enabled:
        return None
    return CorrectionCriterion(
        1e-3 * table.position_mm,
        float(np.radians(table.work_angle_deg)),
        float(np.radians(table.rotation_deg)),
    )


def reader_of(job: JobFile) -> Callable[[Profile], GrooveSection]:
    """What reads the grooves of a job's profiles."""
    return partial(find_groove, settings=job.groove.settings)


def joint_of(job: JobFile, job_file: Path) -> tuple[Path, JointDefinition] | None:
    """The joint that a job names, and its file, sought from the job's folder.

    Raises
    ------
    ConfigurationError
        If that file is missing or describes a joint that can't be.
    """
    if job.joint is None:
        return None
    file = job_file.parent / job.joint.file
    if not file.is_file():
        raise ConfigurationError(f"there is no such file: {file}", file=job_file, key="joint.file")
    return file, read_joint(file)


def cell_of(job: JobFile, job_file: Path) -> Cell:
    """Make the cell of a job, with all that the job names.

    Raises
    ------
    ConfigurationError
        If the job, or a file that it names, is wrong.
    """
    with naming(job_file):
        joint = joint_of(job, job_file)
        return open_cell(job, mount_of(job, job_file).T_f_s, joint and joint[1])


def check_job(job: JobFile, job_file: Path) -> None:
    """Check a job, what it names, and the way to its taught poses where it stands; move nothing.

    Raises
    ------
    ConfigurationError
        If the job is wrong.
    PoseUnreachable
        If a taught pose is, or the way there is blocked.
    """
    with naming(job_file):
        places = job.places
    for place in places:
        with cell_of(place, job_file) as cell:
            cell.arm.check(*(start.T for start in place.starts))


def scan_in(
    cell: Cell,
    job: JobFile,
    journal: Journal,
    done: InterruptedScan | None = None,
    stop: StopRequest | None = None,
) -> ScanResult:
    """Connect a cell and scan in it as a job says, or go on; raises as `Scanner` does."""
    stop = stop or StopRequest()
    seen = ScannedSurface(cell.clearance, () if done is None else done.sections)
    journal = Journals(journal, seen)
    with cell, stop.halting(cell.arm.stop):
        _note_arm(cell.arm, journal)
        setup = Setup(cell.arm, cell.laser, cell.T_f_s, reader_of(job))
        scanner = Scanner(setup, plan_of(job), journal, stop=stop)
        try:
            if done is not None and len(done.sections) >= 2:
                return scanner.resume(done)
            first, second = job.starts
            return scanner.run(first.T, second.T)
        except TjscanError as error:
            if stop.at_once:
                journal.event(ScanEvent.INTERRUPTED, f"by the operator: {words_of(error)}")
                raise Interrupted from error
            journal.event(ScanEvent.FAILED, words_of(error))
            raise


def _note_arm(arm: Arm, journal: Journal) -> None:
    """Let a journal know which arm it is, and of every detour that it takes."""
    if isinstance(arm, ClearedArm):
        arm.on_detour = partial(journal.event, "detour")
        if (identity := arm.identity()) is not None:
            journal.event("arm", identity_words(identity))


def run_job(
    job: JobFile, job_file: Path, directory: Path, watch: Journal, stop: StopRequest | None = None
) -> Summary:
    """Scan as a job says and leave a run directory behind.

    Parameters
    ----------
    job : JobFile
        The job, of one station if it has any.
    job_file : Path
        Where it was read from; the files it names are sought from there.
    directory : Path
        The run directory to make.
    watch : Journal
        Is told of everything, after it is on disk.
    stop : StopRequest, optional
        Asks for an end before the job is done.

    Raises
    ------
    TjscanError
        If the job is wrong or a device fails; the recording holds what was measured until then.
    """
    with naming(job_file):
        job = job.at()
        joint = joint_of(job, job_file)
        mount = mount_of(job, job_file)
        cell = open_cell(job, mount.T_f_s, joint and joint[1])
        make_directory(directory, job, job_file, joint=joint and joint[0], calibration=mount.file)
        with sole_writer(directory):
            with Recording(next_part(directory), origin_of(directory, job)) as recording:
                result = scan_in(cell, job, Journals(recording, watch), stop=stop)
            return write_run(directory, job, result, joint and joint[1])


def resume_job(
    directory: Path, overrides: dict[str, Any], watch: Journal, stop: StopRequest | None = None
) -> Summary:
    """Go on with a scan that was interrupted, after its last finished section.

    Parameters
    ----------
    directory : Path
        Its run directory, which holds the job, the calibration and the recording.
    overrides : dict
        Dotted keys and values, those of `RESUMABLE` only.
    watch : Journal
        Is told of everything, after it is on disk.
    stop : StopRequest, optional
        Asks for an end before the job is done.

    Raises
    ------
    ConfigurationError
        If there is no run, or a key changes what was scanned before.
    JointMoved
        If the last section is not where it was.
    TjscanError
        As `run_job` does.
    """
    job_file = directory / JOB
    check_inside(directory, *COPIES)
    check_resumable(overrides, job_file)
    with naming(job_file), sole_writer(directory):
        job = read_job(job_file, overrides).at()
        joint = joint_of(job, job_file)
        mount = mount_of(job, job_file)
        origin = origin_of(directory, job)
        changed, done = [], None
        if not is_untouched(directory):  # else it ended before it began to record
            changed = check_origin(directory, origin)
            done = read_progress(directory, reader_of(job))
        left = done.views[-1] if done and done.views else None
        cell = open_cell(job, mount.T_f_s, joint and joint[1], left)
        with Recording(next_part(directory), origin) as recording:
            journal = Journals(recording, watch)
            for key, what in changed:
                journal.event("changed", f"{key} {what}")
            result = scan_in(cell, job, journal, done, stop)
        return write_run(directory, job, result, joint and joint[1])


def check_resumable(overrides: Iterable[str], job_file: Path) -> None:
    """Check that keys may be replaced while a scan goes on.

    Raises
    ------
    ConfigurationError
        If one changes what was scanned before.
    """
    for key in overrides:
        if not key.startswith(RESUMABLE):
            raise ConfigurationError(
                "can't change while a scan goes on: what was scanned before would not fit. "
                f"What may: {', '.join(RESUMABLE)}",
                file=job_file,
                key=key,
            )


def check_origin(directory: Path, now: Origin) -> list[tuple[str, str]]:
    """What changed since a run was last recorded, where a scan may go on all the same.

    Returns
    -------
    list of (str, str)
        Key and what became of it, those of `RESUMABLE` only.

    Raises
    ------
    ConfigurationError
        If something else changed: job, joint, calibration or the arm's model were edited.
    RecordingError
        If the recording does not say what it was made with: another program made it.
    """
    before = read_origin(directory)
    if before is None:
        if any(True for file in parts(directory) for _ in read_messages(file)):
            raise RecordingError(
                f"{directory}: its recording does not say what it was made with; no scan of this "
                "program made it. Start a new scan"
            )
        return []
    changed = list(changes(before, now))
    for key, what in changed:
        if not key.startswith(RESUMABLE):
            raise ConfigurationError(
                f"{what}. What was scanned before does not fit any more: put it back, or start a "
                "new scan",
                file=directory,
                key=key,
            )
    return changed


def frame_of(job: JobFile) -> ResultFrame:
    """The frame that a scan's results are told in.

    It is b for a station: where the joint stands there is known but about.
    """
    if job.joint is None or job.station:
        return ResultFrame()
    return ResultFrame(job.joint.T_w_j)


def write_run(
    directory: Path, job: JobFile, result: ScanResult, joint: JointDefinition | None
) -> Summary:
    """Write what a job's scan found into its run directory.

    Raises
    ------
    RecordingError
        If a file can't be written.
    """
    frame = frame_of(job)
    summary = write_scan(
        directory,
        result,
        plan_of(job),
        frame,
        None if frame.T_b_j is None else joint,
        station=job.station[0].name if job.station else "1",
    )
    write_report(directory)
    return summary
