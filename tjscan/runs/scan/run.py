"""Scan as a job states, or go on with a scan that was interrupted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core import errors
from tjscan.core.config import add_file_to_errors
from tjscan.core.files import lock_and_clean_directory, refuse_links_outside
from tjscan.core.frames import JointOrBaseFrame, inverse_pose, transform_points
from tjscan.groove.read import read_groove
from tjscan.job.carrier import check_carrier_at_station
from tjscan.job.cell import (
    Cell,
    SensorMount,
    joint_scene,
    make_cell,
    motion_limits_of_job,
    sensor_mount_of_job,
)
from tjscan.job.files import ScanJob
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import read_joint
from tjscan.recording.header import JobSnapshot
from tjscan.recording.journal import CombinedJournal, Journal, RunEvent, event_recorder
from tjscan.recording.parts import next_recording_file, recording_files
from tjscan.recording.reader import RecordingDamage, read_job_snapshot
from tjscan.result.directory import CALIBRATION_FILE, JOINT_FILE, URDF_FILE, job_label_of_run
from tjscan.result.picture import draw_groove_overview
from tjscan.result.readings import ProfileReading
from tjscan.result.section import absent_corners
from tjscan.result.summary import ScanSummary
from tjscan.result.wireframe import joint_wireframe
from tjscan.robot.arm import ArmState
from tjscan.robot.kinematics import Kinematics
from tjscan.runs import run
from tjscan.runs.run import JobContext, make_run_directory, take_job_snapshot
from tjscan.runs.scan import results
from tjscan.runs.scan.uncertainty import causes_of_job
from tjscan.scanning.continuous.smoothing import finished_sections, smooth_corners
from tjscan.scanning.continuous.stream import devices_that_follow
from tjscan.scanning.journal import (
    RecordedScan,
    ScanEvent,
    ScannedSurfaceObstacle,
    ScanResult,
    plan_is_fulfilled,
)
from tjscan.scanning.profile_taker import ScanSetup
from tjscan.scanning.recording import ScanRecordingWriter, read_recorded_scan
from tjscan.scanning.scanner import Scanner
from tjscan.scanning.section import ProfileView, Substep
from tjscan.scanning.sections_before import GrooveReader
from tjscan.scanning.settle import check_can_settle
from tjscan.scanning.stopping import StopRequest
from tjscan.uncertainty.budget import summarise_budget
from tjscan.uncertainty.causes import budget_of_causes


@dataclass(frozen=True, eq=False)
class ScanContext(JobContext[ScanJob]):
    """A scan job with what it names, and where its run reports to; see `JobContext`.

    Parameters
    ----------
    stop : StopRequest
        Asks for an end before the job is done.
    left : ArmState, optional
        How a carrier's move left the arm: a simulated one is there again.
    arrived : tuple of RunEvent
        What the recording begins with: where the carrier is.
    """

    stop: StopRequest = field(default_factory=StopRequest)
    left: ArmState | None = None
    arrived: tuple[RunEvent, ...] = ()

    def at_station(self, name: str | None = None) -> ScanContext:
        """The same at one of the job's stations; raises as `ScanJob.job_at_station` does."""
        return replace(self, job=self.job.job_at_station(name))

    @cached_property
    def joint_file(self) -> Path | None:
        """Path of the joint's file that the job names.

        Raises
        ------
        ConfigurationError
            If there is no such file.
        """
        if self.job.joint is None:
            return None
        file = self.job_file.parent / self.job.joint.file
        if not file.is_file():
            raise errors.ConfigurationError(
                f"there is no such file: {file}", file=self.job_file, key="joint.file"
            )
        return file

    @cached_property
    def joint(self) -> JointDefinition | None:
        """Definition of the joint that the job names; ConfigurationError if it can't be built."""
        return None if self.joint_file is None else read_joint(self.joint_file)

    @cached_property
    def sensor_mount(self) -> SensorMount:
        """Pose of the sensor on the flange; raises as `sensor_mount_of_job` does."""
        return sensor_mount_of_job(self.job, self.job_file)

    def make_cell(self, left: ProfileView | None = None) -> Cell:
        """Make the cell (arm and laser) that the job names; connect nothing.

        Parameters
        ----------
        left : ProfileView, optional
            Where an interrupted scan left the arm.

        Raises
        ------
        ConfigurationError
            If the job, or a file that it names, is wrong.
        """
        state = self.left
        if state is None and left is not None:
            state = ArmState(left.q, left.T_b_f, left.time)
        with add_file_to_errors(self.job_file):
            scene = partial(joint_scene, self.job, self.joint)
            cell = make_cell(self.job, self.sensor_mount, scene, state)
            if self.job.scan.mode == "continuous":
                devices_that_follow(cell.arm, cell.laser)
            if self.job.scan.settle is not None:
                check_can_settle(cell.laser)
            return cell

    def make_run_directory(self, directory: Path) -> None:
        """Make a run directory with the job and the files that it names."""
        with add_file_to_errors(self.job_file):
            copies = {JOINT_FILE: self.joint_file, CALIBRATION_FILE: self.sensor_mount.file}
            make_run_directory(directory, self.job, self.job_file, copies)

    @contextmanager
    def open_recording(self, directory: Path) -> Iterator[Journal]:
        """Record into a run directory while the block runs; gives the journal that writes it."""
        arm, T_b_j = Kinematics.load(self.job.arm.model), result_frame_of_job(self.job).T_b_j
        fixed = {arm.link_names[0]: arm.link_poses(np.zeros(len(arm.joint_names)))[0]}
        if T_b_j is not None:
            fixed["j"] = T_b_j
        if self.job.carrier is not None:
            fixed["w"] = inverse_pose(self.job.T_w_b)
        with ScanRecordingWriter(
            next_recording_file(directory),
            take_job_snapshot(directory, self.job),
            joint_names=arm.joint_names,
            fixed=fixed,
            attachments={URDF_FILE: arm.urdf.read_bytes()},
        ) as recording:
            journal = CombinedJournal(recording, self.journal)
            for event in self.arrived:
                journal.record(event)
            yield journal


def groove_reader_of_job(job: ScanJob) -> GrooveReader:
    """Function that reads the groove in a profile with the settings of a job."""
    return partial(read_groove, settings=job.groove)


def result_frame_of_job(job: ScanJob) -> JointOrBaseFrame:
    """Frame of a scan's results: the joint's if the job states its pose, else the base's.

    It is b for a station: the joint's pose there is known only roughly.
    """
    if job.joint is None or job.station:
        return JointOrBaseFrame()
    return JointOrBaseFrame(job.joint.T_w_j)


RESUMABLE_KEYS: Final = (
    "accept.",
    "artefact.",
    "scan.length_mm",
    "scan.sections",
    "scan.step_mm",
    "scan.mode",
    "scan.speed_mm_s",
    "scan.section_mm",
    "scan.horizon_mm",
    "scan.prediction_case",
    "scan.resume_tolerance_mm",
    "scan.skip.",
    "scan.settle.",
    "scan.adaptive.",
    "arm.uncertainty.",
    "arm.speed_mm_s",
    "arm.acceleration_mm_s2",
    "arm.shaper.",
    "arm.ur.",
    "laser.uncertainty.",
    "clearance.",
    "simulation.",
    "carrier.simulated.",
)
"""Keys that may change while a scan goes on."""


NOMINAL_FLANGE_TOLERANCE: Final = 0.02
"""Metres between an arm's flange as its model has it and as its controller knows it: arms differ
from their model by some millimetres."""


def _scanner_of_plan(
    setup: ScanSetup, cell: Cell, job: ScanJob, journal: Journal, stop: StopRequest
) -> Scanner:
    """The scanner for a job's mode."""
    if job.scan.mode == "stepwise":
        return Scanner(setup, job.scan, journal, stop=stop)
    # toppra, which imports Matplotlib, is loaded where it is used.
    from tjscan.scanning.continuous.scanner import ContinuousScanner

    arm, limits, second = cell.clearance.kinematics, motion_limits_of_job(job), job.start_poses[1]
    return ContinuousScanner(setup, job.scan, journal, arm, limits, second.T, stop)


def scan_in_cell(
    cell: Cell,
    job: ScanJob,
    journal: Journal,
    done: RecordedScan | None = None,
    stop: StopRequest | None = None,
) -> ScanResult:
    """Connect a cell and scan in it as a job states, or go on; raises as `Scanner` does."""
    stop, read = stop or StopRequest(), groove_reader_of_job(job)
    sections = () if done is None else done.reread_sections(read)
    seen = ScannedSurfaceObstacle(cell.clearance, sections)
    journal = CombinedJournal(journal, seen)
    with cell, stop.halt_arm_on_stop_now(cell.arm.stop):
        for name, device in (("arm", cell.arm), ("laser", cell.laser)):
            device.report_events_to(event_recorder(journal))
            if device.identity:
                journal.record(RunEvent(name, str(device.identity)))
        setup = ScanSetup(cell.arm, cell.laser, cell.T_f_s, read)
        scanner = _scanner_of_plan(setup, cell, job, journal, stop)
        try:
            if done is not None and len(sections) >= 2:
                return scanner.resume(done, sections)
            first, second = job.start_poses
            return scanner.run(first.T, second.T)
        except errors.TjscanError as error:
            reason, event = errors.message_with_notes(error), ScanEvent.FAILED
            if stop.must_stop_now:
                reason, event = f"by the operator: {reason}", ScanEvent.INTERRUPTED
            journal.record(RunEvent(event, reason))
            raise


def run_scan(context: ScanContext, directory: Path) -> ScanSummary:
    """Scan as a job states, into a new run directory.

    Parameters
    ----------
    context : ScanContext
        The job, of one station if it has any, and where to report to.
    directory : Path
        The run directory to make.

    Raises
    ------
    TjscanError
        If the job is wrong or a device fails; the recording holds what was measured until then.
    """
    with add_file_to_errors(context.job_file):
        context = context.at_station()
        cell = context.make_cell()
        if not context.arrived:
            check_carrier_at_station(context.job)
        context.make_run_directory(directory)
        with lock_and_clean_directory(directory):
            with context.open_recording(directory) as journal:
                result = scan_in_cell(cell, context.job, journal, stop=context.stop)
            return write_scan_results(context, directory, result)


def resume_scan(context: ScanContext, overrides: Iterable[str] = ()) -> ScanSummary:
    """Resume an interrupted scan after its last finished section.

    Of a scan that did what its job asks for only the results are written, from its recording.

    Parameters
    ----------
    context : ScanContext
        The job as the run directory holds it, with keys replaced or not.
    overrides : iterable of str
        The dotted keys that were replaced, from `RESUMABLE_KEYS` only.

    Raises
    ------
    ConfigurationError
        If there is no run, or a key changes what was scanned before.
    JointMoved
        If the last section is at another place.
    TjscanError
        As `run_scan` does.
    """
    directory = context.job_file.parent
    refuse_links_outside(directory, *run.RUN_INPUT_FILES)
    check_keys_replaceable(overrides, context.job_file)
    with add_file_to_errors(context.job_file), lock_and_clean_directory(directory):
        context = context.at_station()
        changed, done, damages = [], None, list[RecordingDamage]()
        if not run.nothing_recorded_yet(directory):  # else it ended before it began to record
            done = read_recorded_scan(directory, damages.append)
            _check_can_go_on_from(directory, damages)
            now = run.take_job_snapshot(directory, context.job)
            changed = _changes_since_recording(directory, done, now)
        run.accept_edited_copies(directory, context.journal)
        if done is not None and not changed and plan_is_fulfilled(done.stop, context.job.scan):
            nothing_left = "nothing is left to scan; the results are written from the recording"
            context.journal.record(RunEvent(ScanEvent.COMPLETE, nothing_left))
            sections = done.reread_sections(groove_reader_of_job(context.job))
            ended = done.stop, done.stop_detail, done.retry_counts
            return write_scan_results(context, directory, ScanResult(sections, done.views, *ended))
        left = done.views[-1] if done and done.views else None
        if left is not None:
            check_joint_angles(left, Kinematics.load(context.job.arm.model), directory)
        cell = context.make_cell(left=left)
        if not context.arrived:
            check_carrier_at_station(context.job)
        with context.open_recording(directory) as journal:
            for damage in damages:
                journal.record(RunEvent(ScanEvent.DAMAGED, str(damage)))
            for key, what in changed:
                journal.record(RunEvent("changed", f"{key} {what}"))
            result = scan_in_cell(cell, context.job, journal, done, context.stop)
        return write_scan_results(context, directory, result)


def check_joint_angles(view: ProfileView, arm: Kinematics, directory: Path) -> None:
    """Check that the joint angles of a view, in which a scan goes on, lead to its flange pose.

    Raises
    ------
    RecordingError
        If they do not, so that one of them is damaged.
    """
    if len(view.q) != len(arm.joint_names):
        raise errors.RecordingError(
            f"{directory}: its recording holds {len(view.q)} joint angles, the arm has "
            f"{len(arm.joint_names)}"
        )
    apart = float(np.linalg.norm(arm.forward(view.q)[:3, 3] - view.T_b_f[:3, 3]))
    if apart > NOMINAL_FLANGE_TOLERANCE:
        raise errors.RecordingError(
            f"{directory}: its recording is damaged: the joint angles of the last view, of section "
            f"{view.index}, lead {1e3 * apart:.0f} mm away from its flange pose. Nothing was "
            f"moved; what is recorded is read by: tjscan reprocess {directory}"
        )


def _check_can_go_on_from(directory: Path, damages: Iterable[RecordingDamage]) -> None:
    """Check that a damaged recording is whole up to where the scan goes on.

    Raises
    ------
    RecordingError
        If something is missing in its middle.
    """
    last = recording_files(directory)[-1]
    for damage in damages:
        if damage.file != last or not damage.is_at_end:
            raise errors.RecordingError(
                f"{damage}. A scan can't go on from a recording with a hole in it; the sections "
                f"that are left are read by: tjscan reprocess {directory}"
            )


def check_keys_replaceable(overrides: Iterable[str], job_file: Path) -> None:
    """Refuse keys that may not change while a scan goes on.

    Raises
    ------
    ConfigurationError
        Naming the first one.
    """
    why = "can't change while a scan goes on: what was scanned before would not fit"
    run.refuse_fixed_keys(overrides, RESUMABLE_KEYS, why, job_file)


def _changes_since_recording(
    directory: Path, done: RecordedScan, now: JobSnapshot
) -> list[tuple[str, str]]:
    """Keys of the job that changed since a run was recorded; refuse those that must not.

    Returns
    -------
    list of (str, str)
        Key and what became of it, from `RESUMABLE_KEYS` only.

    Raises
    ------
    ConfigurationError
        If something else changed: job, joint, calibration or the arm's model were edited.
    RecordingError
        If the recording does not state what it was made with: another program made it.
    """
    before = read_job_snapshot(directory)
    if before is None:
        if done.started is not None:
            raise errors.RecordingError(
                f"{directory}: its recording does not state what it was made with; no scan of this "
                "program made it. Start a new scan"
            )
        return []
    advice = "What was scanned before does not fit any more: put it back, or start a new scan"
    return run.check_job_changes(before, now, RESUMABLE_KEYS, advice, directory)


def write_scan_results(context: ScanContext, directory: Path, result: ScanResult) -> ScanSummary:
    """Write the results of a job's scan into its run directory.

    Raises
    ------
    RecordingError
        If a file can't be written.
    """
    job, frame = context.job, result_frame_of_job(context.job)
    result = replace(result, sections=finished_sections(result.sections))
    joint = None if frame.T_b_j is None else context.joint
    causes = causes_of_job(job, context.sensor_mount, result.sections)
    station = job.station[0].name if job.station else "1"
    budget = budget_of_causes(causes.causes, frame.T_r_b, len(result.sections))
    sections = budget.sections_with_covariances(
        results.sections_in_result_frame(result.sections, frame, station)
    )
    cloud = results.cloud_of_sections(result.sections, frame)
    error = results.corner_errors(sections, joint)
    calibration = results.calibration_label(directory)
    uncertainty = summarise_budget(budget, ~absent_corners(sections), causes.left_out)
    summary = results.summarise_scan(result, job.scan, frame, error, calibration, uncertainty)
    middle = result.sections[len(result.sections) // 2]
    groove, view = middle.groove, middle.view
    example = ProfileReading(f"section {view.index}", view.profile, groove.points_s, section=groove)
    picture = draw_groove_overview(
        sections,
        cloud.points,
        frame=frame.letter,
        title=f"{len(sections)} sections, {result.stop}",
        outline=() if joint is None else joint_wireframe(joint),
        paths=[transform_points(frame.T_r_b, [view.T_b_f[:3, 3] for view in result.views])],
        example=example,
    )
    label = job_label_of_run(directory)
    smoothed = None
    if any(section.view.substep is Substep.FUSED for section in result.sections):
        smoothed = transform_points(frame.T_r_b, smooth_corners(result.sections))
    summary = results.write_run_results(
        directory, sections, cloud, summary, picture, label, budget, smoothed
    )
    context.finished(directory)
    return summary
