"""Run a loopback laser: a job's simulated laser or a recording, behind GigE Vision."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import cycle
from pathlib import Path
from typing import Any

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.core.loopback import check_is_loopback_address
from tjscan.job import read_scan_job
from tjscan.job.cell import make_simulated_laser
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.loopback.sensor import LoopbackSensor
from tjscan.laser.loopback.server import run_laser_server
from tjscan.laser.profile import Profile
from tjscan.robot.loopback.pose_reader import read_flange_pose
from tjscan.runs.context import RunContext
from tjscan.scanning.reader import read_views


def run_loopback_laser(
    job_file: Path | None,
    overrides: dict[str, Any],
    *,
    recording: Path | None,
    host: str,
    arm: str | None,
    serial: str,
    attached: bool,
) -> None:
    """Run a loopback laser until interrupted, or until an attached stdin ends.

    What it has to say goes to stdout, a line each.

    Raises
    ------
    ConfigurationError
        If the address, the job or the recording can't be.
    """
    check_is_loopback_address(host)
    if (job_file is None) == (recording is None):
        raise ConfigurationError("it needs either a job or a --recording, and not both")
    if job_file is not None:
        source = SimulatedProfiles.of_job(job_file, overrides, arm)
        columns, expose, begin = source.columns, source.expose, source.begin
    else:
        profiles = [view.profile for view in read_views(Path(str(recording)))]
        columns, expose = _recorded(profiles, recording)
        begin = _nothing
    sensor = LoopbackSensor(host, serial, columns, expose, begin, _tell)
    run_laser_server(sensor, _tell, attached=attached)


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
        self._laser = self._make()
        self._laser.__enter__()

    def expose(self) -> Profile:
        """Take the next profile."""
        return self._laser.capture()


def _recorded(profiles: list[Profile], recording: Path | None) -> tuple[int, Callable[[], Profile]]:
    """Number of points, and what gives the profiles in turn; those of another number are left."""
    if not profiles:
        raise ConfigurationError(f"there is no profile in {recording}", key="recording")
    columns = len(profiles[0])
    turn = cycle([profile for profile in profiles if len(profile) == columns])
    return columns, lambda: next(turn)


def _nothing() -> None:
    """Begin where the recording stands."""


def _tell(line: str) -> None:
    with suppress(BrokenPipeError):  # nobody listens any more
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
