"""``tjscan calibrate``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tjscan.cli.options.page import LiveOptions
from tjscan.cli.options.recorded import RecordedProfileOptions, comma_separated_options
from tjscan.core.errors import ConfigurationError


def calibrate(
    job: Path | None = None,
    *overrides: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    station: str | None = None,
    out: Path | None = None,
    arm: bool = False,
    dry_run: bool = False,
    unattended: bool = False,
    resume: Path | None = None,
    json: bool = False,
    page: LiveOptions | None = None,
    recorded: RecordedProfileOptions | None = None,
) -> None:
    """Find the pose of the sensor on the flange, in the cell of a job or from recorded profiles.

    Every key of the job file is an option too: ``--board.lines 16``.

    Parameters
    ----------
    job
        The job file (TOML) of the cell to calibrate.
    station
        Where the arm stands, of a job with several stations.
    out
        The directory to make; ``runs/JOB-DATE`` where left out.
    arm
        Calibrate the arm's kinematics with the sensor, on the ball that the job states. A scan that
        takes the file corrects the arm's poses with them.
    dry_run
        Check the job and plan its lines where it says that the board is; connect, but move nothing.
    unattended
        Ask nothing; for a simulated cell.
    resume
        Go on with a calibration that was interrupted, in the directory it made.
    json
        Print the calibration as JSON on stdout.
    """
    page = page or LiveOptions()
    page.check()
    if page.live and (unattended or (job is None and resume is None)):
        raise ConfigurationError("--live asks somebody on a page, in the cell of a job")
    given = [] if recorded is None else recorded.given_option_names
    if [job is not None, resume is not None, bool(given)].count(True) != 1:
        raise ConfigurationError(
            "calibrate takes either a job file, or --resume with a directory, or recorded "
            "profiles with --lines and --poses "
            f"(found: {comma_separated_options(given) or 'none of them'})"
        )
    if dry_run:
        if job is None or arm or out is not None:
            raise ConfigurationError("--dry-run plans the lines of a job: no --out, no --arm")
        _check(job, overrides, station)
    elif recorded is not None and given:
        if unattended:
            raise ConfigurationError("--unattended has no meaning for recorded profiles")
        from tjscan.cli.calibrate_recorded import calibrate_recorded

        calibrate_recorded(recorded, out, json=json)
    elif resume is not None:
        if arm:
            raise ConfigurationError("--resume goes on as it was begun: --arm has no meaning")
        if out is not None:
            raise ConfigurationError("--resume goes on where it was: --out has no meaning")
        _resume(resume, page, unattended=unattended, json=json)
    elif job is not None:
        _start(job, overrides, station, out, page, arm=arm, unattended=unattended, json=json)


def _check(file: Path, overrides: Sequence[str], station: str | None) -> None:
    """Check the job of a calibration, and plan its lines."""
    from numpy import degrees

    from tjscan.cli.options.overrides import parse_overrides
    from tjscan.cli.output.console import print_message
    from tjscan.core.config import add_file_to_errors
    from tjscan.job import read_calibration_job

    keys = parse_overrides(overrides)
    with add_file_to_errors(file):
        job = read_calibration_job(file, keys).job_at_station(station)
    from tjscan.runs.calibration.check import check_calibration_job

    found = check_calibration_job(job, file)
    print_message(
        f"{file}: the job is sound, and the arm gets to all {job.board.lines} lines; their noise "
        f"would leave the sensor's pose uncertain to {1e3 * found.position:.2f} mm and "
        f"{degrees(found.rotation):.3f}°"
    )


def _start(
    file: Path,
    overrides: Sequence[str],
    station: str | None,
    out: Path | None,
    page: LiveOptions,
    *,
    arm: bool,
    unattended: bool,
    json: bool,
) -> None:
    """Calibrate the cell of a job."""
    from tjscan.cli.options.overrides import parse_overrides
    from tjscan.core.config import add_file_to_errors
    from tjscan.job import read_calibration_job

    keys = parse_overrides(overrides)
    with add_file_to_errors(file):
        job = read_calibration_job(file, keys).job_at_station(station)
    # A job with a mistake in it is refused before anything heavy is loaded.
    from tjscan.cli.operators import chosen_operator
    from tjscan.cli.output.calibration import finish_calibration
    from tjscan.runs.calibration.run import start_calibration
    from tjscan.runs.run import default_run_directory

    directory = out or default_run_directory(file)
    with chosen_operator(job, file, page, unattended=unattended) as operator:
        done = start_calibration(job, file, directory, operator, arm=arm)
    finish_calibration(done, json=json)


def _resume(directory: Path, page: LiveOptions, *, unattended: bool, json: bool) -> None:
    """Go on with an interrupted calibration."""
    from tjscan.cli.operators import chosen_operator
    from tjscan.cli.output.calibration import finish_calibration
    from tjscan.job import read_calibration_job
    from tjscan.result.directory import JOB_FILE
    from tjscan.runs.calibration.run import resume_calibration

    file = directory / JOB_FILE
    with chosen_operator(read_calibration_job(file), file, page, unattended=unattended) as operator:
        done = resume_calibration(directory, operator)
    finish_calibration(done, json=json)
