"""``tjscan laser-loopback``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def laser_loopback(
    job: Path | None = None,
    *overrides: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    recording: Path | None = None,
    host: str = "127.0.0.4",
    arm: str | None = None,
    serial: str = "1",
    attached: bool = False,
) -> None:
    """Stand in for a GigE Vision line laser on this machine, until interrupted.

    Its profiles are those of a job's simulated laser, or those of a recording, one after another.
    Every key of the job file is an option too. A line on stdin commands a fault: loss PER_CENT,
    duplicate, reorder, lose-leader, lose-trailer, late, stale, buffered, silent, taken, reboot,
    wrong-format, unit-pixel, missing-features or all-invalid; clear sets all right again.

    Parameters
    ----------
    job
        The job file (TOML) whose simulated laser it is.
    recording
        Profiles instead of a job: a run directory, a file of one, or text with columns x_mm
        and z_mm.
    host
        Its address, 127.0.0.1 to 127.255.255.254; each laser has one of its own.
    arm
        Address of the arm's controller that carries it, such as that of ur-loopback. Left out, it
        stays at the job's first start pose.
    serial
        Its serial number.
    attached
        End when stdin ends.
    """
    from tjscan.cli.options.overrides import parse_overrides
    from tjscan.runs.laser_loopback import run_loopback_laser

    run_loopback_laser(
        job,
        parse_overrides(overrides),
        recording=recording,
        host=host,
        arm=arm,
        serial=serial,
        attached=attached,
    )
