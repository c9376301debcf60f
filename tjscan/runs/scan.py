"""Scan as a job says, or go on with a scan that was interrupted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

from tjscan.core.config import naming
from tjscan.core.errors import (
    ConfigurationError,
    Interrupted,
    RecordingError,
    TjscanError,
    message_of,
)
from tjscan.core.files import check_inside, sole_writer
from tjscan.job import JobFile
from tjscan.job.cell import Cell
from tjscan.recording.header import JobSnapshot, job_changes
from tjscan.recording.reader import read_job_snapshot
from tjscan.result.summary import Summary
from tjscan.runs.context import RunContext, frame_of, reader_of
from tjscan.runs.directory import COPIES, is_untouched
from tjscan.runs.results import write_scan
from tjscan.scanning.events import ScanEvent
from tjscan.scanning.journal import Journal, Journals
from tjscan.scanning.profile_taker import Setup
from tjscan.scanning.reader import read_scan
from tjscan.scanning.recorded import RecordedScan
from tjscan.scanning.result import ScanResult
from tjscan.scanning.scanned_surface import ScannedSurface
from tjscan.scanning.scanner import Scanner
from tjscan.scanning.stopping import StopRequest

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


def check_job(context: RunContext) -> None:
    """Check a job, what it names, and the way to its taught poses where it stands; move nothing.

    Raises
    ------
    ConfigurationError
        If the job is wrong.
    PoseUnreachable
        If a taught pose is, or the way there is blocked.
    """
    with naming(context.job_file):
        places = context.job.places
    for place in places:
        with replace(context, job=place).cell() as cell:
            cell.arm.check(*(start.T for start in place.starts))


def scan_in(
    cell: Cell,
    job: JobFile,
    journal: Journal,
    done: RecordedScan | None = None,
    stop: StopRequest | None = None,
) -> ScanResult:
    """Connect a cell and scan in it as a job says, or go on; raises as `Scanner` does."""
    stop, read = stop or StopRequest(), reader_of(job)
    sections = () if done is None else done.read_sections(read)
    seen = ScannedSurface(cell.clearance, sections)
    journal = Journals(journal, seen)
    with cell, stop.halting(cell.arm.stop):
        _note_devices(cell, journal)
        setup = Setup(cell.arm, cell.laser, cell.T_f_s, read)
        scanner = Scanner(setup, job.scan, journal, stop=stop)
        try:
            if done is not None and len(sections) >= 2:
                return scanner.resume(done, sections)
            first, second = job.starts
            return scanner.run(first.T, second.T)
        except TjscanError as error:
            if stop.at_once:
                journal.event(ScanEvent.INTERRUPTED, f"by the operator: {message_of(error)}")
                raise Interrupted from error
            journal.event(ScanEvent.FAILED, message_of(error))
            raise


def _note_devices(cell: Cell, journal: Journal) -> None:
    """Let a journal know which devices these are, and of everything that they report."""
    for name, device in (("arm", cell.arm), ("laser", cell.laser)):
        device.listen(journal.event)
        if device.identity:
            journal.event(name, str(device.identity))


def run_scan(context: RunContext, directory: Path) -> Summary:
    """Scan as a job says and leave a run directory behind.

    Parameters
    ----------
    context : RunContext
        The job, of one station if it has any, and where to report to.
    directory : Path
        The run directory to make.

    Raises
    ------
    TjscanError
        If the job is wrong or a device fails; the recording holds what was measured until then.
    """
    with naming(context.job_file):
        context = replace(context, job=context.job.at())
        cell = context.cell()
        context.make_directory(directory)
        with sole_writer(directory):
            with context.recording(directory) as journal:
                result = scan_in(cell, context.job, journal, stop=context.stop)
            return write_run(context, directory, result)


def resume_scan(context: RunContext, overrides: Iterable[str] = ()) -> Summary:
    """Go on with a scan that was interrupted, after its last finished section.

    Parameters
    ----------
    context : RunContext
        The job as the run directory holds it, with keys replaced or not.
    overrides : iterable of str
        The dotted keys that were replaced, those of `RESUMABLE` only.

    Raises
    ------
    ConfigurationError
        If there is no run, or a key changes what was scanned before.
    JointMoved
        If the last section is not where it was.
    TjscanError
        As `run_scan` does.
    """
    directory = context.job_file.parent
    check_inside(directory, *COPIES)
    check_resumable(overrides, context.job_file)
    with naming(context.job_file), sole_writer(directory):
        context = replace(context, job=context.job.at())
        changed, done = [], None
        if not is_untouched(directory):  # else it ended before it began to record
            done = read_scan(directory)
            changed = check_origin(directory, done, context.origin(directory))
        cell = context.cell(left=done.views[-1] if done and done.views else None)
        with context.recording(directory) as journal:
            for key, what in changed:
                journal.event("changed", f"{key} {what}")
            result = scan_in(cell, context.job, journal, done, context.stop)
        return write_run(context, directory, result)


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


def check_origin(directory: Path, done: RecordedScan, now: JobSnapshot) -> list[tuple[str, str]]:
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
    before = read_job_snapshot(directory)
    if before is None:
        if done.started is not None:
            raise RecordingError(
                f"{directory}: its recording does not say what it was made with; no scan of this "
                "program made it. Start a new scan"
            )
        return []
    changed = list(job_changes(before, now))
    for key, what in changed:
        if not key.startswith(RESUMABLE):
            raise ConfigurationError(
                f"{what}. What was scanned before does not fit any more: put it back, or start a "
                "new scan",
                file=directory,
                key=key,
            )
    return changed


def write_run(context: RunContext, directory: Path, result: ScanResult) -> Summary:
    """Write what a job's scan found into its run directory.

    Raises
    ------
    RecordingError
        If a file can't be written.
    """
    job, frame = context.job, frame_of(context.job)
    summary = write_scan(
        directory,
        result,
        job.scan,
        frame,
        None if frame.T_b_j is None else context.joint,
        station=job.station[0].name if job.station else "1",
    )
    context.finished(directory)
    return summary
