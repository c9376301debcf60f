"""What the runs share: a job with what it names, and where a run reports to."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import numpy as np

from tjscan.core.config import naming
from tjscan.core.errors import ConfigurationError
from tjscan.groove.find import find_groove
from tjscan.groove.section import GrooveSection
from tjscan.job import AdaptiveTable, JobFile, ScanTable
from tjscan.job.cell import Cell, Mount, mount_of, open_cell
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import read_joint
from tjscan.laser.profile import Profile
from tjscan.recording.origin import Origin
from tjscan.recording.writer import Recording, next_part
from tjscan.result.frame import ResultFrame
from tjscan.runs.directory import make_directory, origin_of
from tjscan.scanning.adaptive import Adaptive
from tjscan.scanning.correction_criterion import CorrectionCriterion
from tjscan.scanning.journal import Journal, Journals
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.prediction import CASES, SMOOTH, Prediction
from tjscan.scanning.section import View
from tjscan.scanning.stopping import StopRequest
from tjscan.scanning.target import Direction


def report_nothing(directory: Path) -> None:
    """Do nothing with a directory whose results are written."""


@dataclass(frozen=True, eq=False)
class RunContext:
    """A job, what it names, and where a run reports to.

    Parameters
    ----------
    job : JobFile
        The job.
    job_file : Path
        Where it was read from; the files that it names are sought from there.
    journal : Journal
        Receives every profile, section and event, once it is on disk.
    stop : StopRequest
        Asks for an end before the job is done.
    finished : callable
        Is called with every directory whose results are written, for instance `write_report`.
    """

    job: JobFile
    job_file: Path
    journal: Journal = field(default_factory=Journals)
    stop: StopRequest = field(default_factory=StopRequest)
    finished: Callable[[Path], object] = report_nothing

    @cached_property
    def joint_file(self) -> Path | None:
        """The file of the joint that the job names.

        Raises
        ------
        ConfigurationError
            If there is no such file.
        """
        if self.job.joint is None:
            return None
        file = self.job_file.parent / self.job.joint.file
        if not file.is_file():
            raise ConfigurationError(
                f"there is no such file: {file}", file=self.job_file, key="joint.file"
            )
        return file

    @cached_property
    def joint(self) -> JointDefinition | None:
        """The joint that the job names; raises ConfigurationError if there can be no such joint."""
        return None if self.joint_file is None else read_joint(self.joint_file)

    @cached_property
    def mount(self) -> Mount:
        """Where the sensor sits on the flange; raises ConfigurationError as `mount_of` does."""
        return mount_of(self.job, self.job_file)

    def cell(self, left: View | None = None) -> Cell:
        """Make the cell with all that the job names; connect nothing.

        Parameters
        ----------
        left : View, optional
            Where an interrupted scan left the arm.

        Raises
        ------
        ConfigurationError
            If the job, or a file that it names, is wrong.
        """
        with naming(self.job_file):
            joint = self.joint
            return open_cell(self.job, self.mount.T_f_s, joint, left)

    def make_directory(self, directory: Path) -> None:
        """Make a run directory with the job and the files that it names."""
        with naming(self.job_file):
            make_directory(
                directory,
                self.job,
                self.job_file,
                joint=self.joint_file,
                calibration=self.mount.file,
            )

    def origin(self, directory: Path) -> Origin:
        """What a recording in a run directory is made with."""
        return origin_of(directory, self.job)

    @contextmanager
    def recording(self, directory: Path) -> Iterator[Journal]:
        """Record into a run directory while the block runs; gives the journal to report to."""
        with Recording(next_part(directory), self.origin(directory)) as recording:
            yield Journals(recording, self.journal)


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


def frame_of(job: JobFile) -> ResultFrame:
    """The frame of a scan's results.

    It is b for a station: where the joint stands there is known but about.
    """
    if job.joint is None or job.station:
        return ResultFrame()
    return ResultFrame(job.joint.T_w_j)
