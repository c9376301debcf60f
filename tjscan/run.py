"""Run a job: from the job file to a run directory that tells all."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tjscan.cell import Cell, mount_of, open_cell
from tjscan.config import naming
from tjscan.errors import ConfigurationError, TjscanError
from tjscan.groove.find import find_groove
from tjscan.job import JobFile
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import read_joint
from tjscan.recording.writer import Recording
from tjscan.result.directory import make_directory
from tjscan.result.frame import ResultFrame
from tjscan.result.summary import Summary
from tjscan.result.write import write_results
from tjscan.scanning.journal import Journal, Journals
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.prediction import CASES
from tjscan.scanning.scanner import Scanner, ScanResult
from tjscan.scanning.target import Direction


def plan_of(job: JobFile) -> ScanPlan:
    """The scan that a job asks for, in metres and radians."""
    table = job.scan
    return ScanPlan(
        step=1e-3 * table.step_mm,
        prediction=CASES[table.prediction_case],
        direction=Direction(table.direction),
        pull_angle=float(np.radians(table.pull_angle_deg)),
        standoff=1e-3 * table.standoff_mm,
        offset=1e-3 * table.view_offset_mm,
        length=None if table.length_mm is None else 1e-3 * table.length_mm,
        sections=table.sections,
    )


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


def check_job(job: JobFile, job_file: Path) -> None:
    """Check a job, what it names, and the reach of its taught poses; move nothing.

    Raises
    ------
    ConfigurationError
        If the job is wrong.
    PoseUnreachable
        If a taught pose is.
    """
    with naming(job_file):
        joint = joint_of(job, job_file)
        cell = open_cell(job, mount_of(job, job_file).T_f_s, joint and joint[1])
    with cell:
        cell.arm.check(job.scan.first.T, job.scan.second.T)


def scan_in(cell: Cell, job: JobFile, journal: Journal) -> ScanResult:
    """Connect a cell and scan in it as a job says; raises as `Scanner.run` does."""
    with cell:
        scanner = Scanner(cell.arm, cell.laser, cell.T_f_s, find_groove, plan_of(job), journal)
        try:
            return scanner.run(job.scan.first.T, job.scan.second.T)
        except TjscanError as error:
            journal.event("failed", str(error))
            raise
        except KeyboardInterrupt:
            journal.event("interrupted", "by the operator")
            raise


def run_job(job: JobFile, job_file: Path, directory: Path, watch: Journal) -> Summary:
    """Scan as a job says and leave a run directory behind.

    Parameters
    ----------
    job : JobFile
        The job.
    job_file : Path
        Where it was read from; the files it names are sought from there.
    directory : Path
        The run directory to make.
    watch : Journal
        Is told of everything, after it is on disk.

    Raises
    ------
    TjscanError
        If the job is wrong or a device fails; the recording holds what was measured until then.
    """
    with naming(job_file):
        joint = joint_of(job, job_file)
        mount = mount_of(job, job_file)
        cell = open_cell(job, mount.T_f_s, joint and joint[1])
        make_directory(directory, job, joint=joint and joint[0], calibration=mount.file)
        with Recording(directory / "scan.mcap") as recording:
            result = scan_in(cell, job, Journals(recording, watch))
    frame = ResultFrame(None if job.joint is None else job.joint.T_b_j)
    return write_results(directory, result, plan_of(job), frame, joint and joint[1])
