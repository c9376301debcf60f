"""Profiles of a job's simulated laser, for a loopback laser to send."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tjscan.core.config import add_file_to_errors
from tjscan.core.frames import Array
from tjscan.job import read_scan_job
from tjscan.job.cell import make_simulated_laser
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan.robot.loopback.pose_reader import read_flange_pose
from tjscan.runs.scan.context import RunContext


class SimulatedProfiles:
    """Profiles of a job's simulated laser: the same ones from each start of an acquisition.

    Parameters
    ----------
    columns : int
        Points of a profile.
    make : callable
        Makes the laser, its random numbers at their beginning.
    """

    def __init__(self, columns: int, make: Callable[[], LineLaser]) -> None:
        self.columns, self._make = columns, make
        self.begin()

    @classmethod
    def of_job(
        cls, job_file: Path, overrides: dict[str, Any], arm: str | None
    ) -> SimulatedProfiles:
        """Profiles of the laser of a job.

        Parameters
        ----------
        job_file : Path
            The job.
        overrides : dict
            Dotted keys and their values, as `read_scan_job` takes them.
        arm : str, optional
            Address of the controller whose arm carries it.

        Raises
        ------
        ConfigurationError
            If the job, or what it names, is wrong.
        """
        with add_file_to_errors(job_file):
            job = read_scan_job(job_file, overrides).job_at_station()
            context = RunContext(job, job_file)
            T_f_s, joint = context.sensor_mount.T_f_s, context.joint
            first = job.start_poses[0].T

            def T_b_f() -> Array:
                return first if arm is None else read_flange_pose(arm)

            return cls(
                job.laser.points,
                lambda: make_simulated_laser(job, T_f_s, joint, T_b_f, time.monotonic),
            )

    def begin(self) -> None:
        """Begin with the first profile again."""
        self.laser = self._make()
        self.laser.__enter__()

    def expose(self) -> Profile:
        """Take the next profile."""
        return self.laser.capture()
