"""Look through a line laser: profile after profile, each with what is read in it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

from tjscan.core.config import add_file_to_errors
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.groove.settings import GrooveSettings
from tjscan.job.cell import make_simulated_laser
from tjscan.job.devices import make_laser_without_arm
from tjscan.job.files import read_laser_job, read_scan_job
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan.result.readings import ProfileReading, measure_grooves


@contextmanager
def open_laser_of_job(
    job_file: Path, overrides: dict[str, Any]
) -> Iterator[tuple[LineLaser, GrooveSettings]]:
    """Connect the laser of a job, and nothing else, while the block runs.

    Of the file only [laser] and [groove] count, so that it may be a job of any kind, or hold no
    more than these two tables. A simulated laser needs the whole job of a scan: it looks from the
    first start pose.

    Parameters
    ----------
    job_file : Path
        The file.
    overrides : dict
        Dotted keys and their values, as `read_scan_job` takes them.

    Yields
    ------
    tuple of LineLaser and GrooveSettings
        The laser, connected, and how its profiles are read.

    Raises
    ------
    ConfigurationError, LaserFault
        If the file is wrong, or the laser can't be had.
    """
    job = read_laser_job(job_file, overrides)
    with add_file_to_errors(job_file):
        if job.laser.driver_kind is DriverKind.REPLAYED:
            raise ConfigurationError(
                "what was recorded is read with 'tjscan groove RUN'", key="laser.driver"
            )
        if job.laser.driver_kind is DriverKind.REAL:
            laser = make_laser_without_arm(job.laser)
        else:
            laser = prepare_simulated_laser(job_file, overrides)[1]()
    with laser:
        yield laser, job.groove


def prepare_simulated_laser(
    job_file: Path, overrides: dict[str, Any], T_b_f: Callable[[], Array] | None = None
) -> tuple[int, Callable[[], LineLaser]]:
    """Prepare the simulated laser of a scan job.

    Parameters
    ----------
    job_file : Path
        The job.
    overrides : dict
        Dotted keys and their values, as `read_scan_job` takes them.
    T_b_f : callable, optional
        Returns the flange's pose, shape (4, 4); without it the job's first start pose.

    Returns
    -------
    columns : int
        Points of a profile.
    make : callable
        Makes the laser, its random numbers at their beginning.

    Raises
    ------
    ConfigurationError
        If the job, or a file that it names, is wrong.
    """
    from tjscan.runs.scan.run import ScanContext

    with add_file_to_errors(job_file):
        job = read_scan_job(job_file, overrides).job_at_station()
        context = ScanContext(job, job_file)
        T_f_s, joint = context.sensor_mount.T_f_s, context.joint
        first = job.start_poses[0].T

    def make() -> LineLaser:
        with add_file_to_errors(job_file):
            flange = (lambda: first) if T_b_f is None else T_b_f
            return make_simulated_laser(job, T_f_s, joint, flange, time.monotonic)

    return job.laser.points, make


def read_live_profiles(laser: LineLaser, settings: GrooveSettings) -> Iterator[ProfileReading]:
    """Take profile after profile, and read the groove in each; raises as `capture` does.

    Parameters
    ----------
    laser : LineLaser
        Connected.
    settings : GrooveSettings
        How grooves are read.
    """
    for number in count(1):
        yield next(measure_grooves({f"profile {number}": laser.capture()}, settings))


@contextmanager
def open_profile_file(file: Path) -> Iterator[Callable[[Profile], None]]:
    """Open a new text file of profiles, with columns profile, x and z: `tjscan groove` reads it.

    Gives the function that writes a profile, which is in the file when it returns. What has no
    point stays empty.

    Raises
    ------
    ConfigurationError
        If it is there already, or can't be made.
    """
    try:
        stream = file.open("x", encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"can't be written: {error.strerror}", file=file) from None
    numbers = count(1)

    def write(profile: Profile) -> None:
        number = next(numbers)
        for x, z, valid in zip(profile.x_s, profile.z_s, profile.valid, strict=True):
            point = f"{1e3 * x:.5f},{1e3 * z:.5f}" if valid else ","
            stream.write(f"{number},{point}\n")
        stream.flush()

    with stream:
        stream.write("profile,x_mm,z_mm\n")
        yield write
