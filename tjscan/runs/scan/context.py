"""What the runs share: a job with what it names, and where a run reports to."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import JointOrBaseFrame
from tjscan.groove.read import read_groove
from tjscan.job.cell import Cell, SensorMount, make_scan_cell, sensor_mount_of_job
from tjscan.job.files import ScanJob
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import read_joint
from tjscan.recording.journal import CombinedJournal, Journal
from tjscan.recording.parts import next_recording_file
from tjscan.result.directory import CALIBRATION_FILE, JOINT_FILE, URDF_FILE
from tjscan.robot.arm import ArmState
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.run import JobContext, make_run_directory, take_job_snapshot
from tjscan.scanning.recording import ScanRecording
from tjscan.scanning.section import ProfileView
from tjscan.scanning.sections_before import GrooveReader
from tjscan.scanning.stopping import StopRequest


@dataclass(frozen=True, eq=False)
class RunContext(JobContext[ScanJob]):
    """A scan job with what it names, and where its run reports to; see `JobContext`.

    Parameters
    ----------
    stop : StopRequest
        Asks for an end before the job is done.
    """

    stop: StopRequest = field(default_factory=StopRequest)

    def at_station(self, name: str | None = None) -> RunContext:
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
            raise ConfigurationError(
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
        state = None if left is None else ArmState(left.q, left.T_b_f, left.time)
        with add_file_to_errors(self.job_file):
            joint, mount = self.joint, self.sensor_mount
            return make_scan_cell(self.job, mount.T_f_s, joint, state, mount.deviations)

    def make_run_directory(self, directory: Path) -> None:
        """Make a run directory with the job and the files that it names."""
        with add_file_to_errors(self.job_file):
            copies = {JOINT_FILE: self.joint_file, CALIBRATION_FILE: self.sensor_mount.file}
            make_run_directory(directory, self.job, self.job_file, copies)

    @contextmanager
    def open_recording(self, directory: Path) -> Iterator[Journal]:
        """Record into a run directory while the block runs; gives the journal that writes it."""
        arm, T_b_j = Kinematics.load(self.job.arm.model), result_frame_of_job(self.job).T_b_j
        root = {arm.link_names[0]: arm.link_poses(np.zeros(len(arm.joint_names)))[0]}
        with ScanRecording(
            next_recording_file(directory),
            take_job_snapshot(directory, self.job),
            joint_names=arm.joint_names,
            fixed=root if T_b_j is None else {**root, "j": T_b_j},
            attachments={URDF_FILE: arm.urdf.read_bytes()},
        ) as recording:
            yield CombinedJournal(recording, self.journal)


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
