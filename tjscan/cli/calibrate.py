"""``tjscan calibrate``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tjscan.cli.options.page import LiveOptions
from tjscan.core.errors import ConfigurationError

if TYPE_CHECKING:
    from tjscan.job import CalibrationJob, RecordedJob


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationMode:
    """What is calibrated, and whether anything moves or is asked.

    Parameters
    ----------
    arm
        Calibrate the arm's kinematics with the sensor, on the ball that the job states. A scan that
        takes the file corrects the arm's poses with them.
    dry_run
        Check the job and plan its lines on the board that it states; connect, but move nothing.
    unattended
        Ask nothing; for a simulated cell.
    """

    arm: bool = False
    dry_run: bool = False
    unattended: bool = False


def calibrate(
    job: Path | None = None,
    *overrides: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    station: str | None = None,
    out: Path | None = None,
    resume: Path | None = None,
    json: bool = False,
    mode: CalibrationMode | None = None,
    page: LiveOptions | None = None,
) -> None:
    """Find the pose of the sensor on the flange, in the cell of a job or from recorded profiles.

    Every key of the job file is an option too: ``--board.lines 16``. A job with tables
    ``[[recorded]]`` computes from recorded profiles, and moves nothing.

    Parameters
    ----------
    job
        The job file (TOML) of the cell to calibrate, or of recorded profiles.
    station
        The station of the arm, of a job with several stations.
    out
        The directory to make; ``runs/JOB-DATE`` if left out.
    resume
        Go on with a calibration that was interrupted, in the directory it made.
    json
        Print the calibration as JSON on stdout.
    """
    from tjscan.cli.options.overrides import parse_overrides
    from tjscan.core.config import add_file_to_errors
    from tjscan.job import has_recorded_profiles, read_calibration_job, read_recorded_job

    mode, page, keys = mode or CalibrationMode(), page or LiveOptions(), parse_overrides(overrides)
    page.check()
    if page.live and (mode.unattended or (job is None and resume is None)):
        raise ConfigurationError("--live asks a person on a page, in the cell of a job")
    if (job is None) == (resume is None):
        raise ConfigurationError(
            "calibrate takes either a job file, or --resume with a directory "
            f"(found: {'none of them' if job is None else 'both'})"
        )
    if resume is not None:
        if mode.arm or mode.dry_run or out is not None:
            raise ConfigurationError("--resume goes on as it was begun: no --arm, --dry-run, --out")
        _resume(resume, page, unattended=mode.unattended, json=json)
    elif job is not None and has_recorded_profiles(job):
        if mode != CalibrationMode() or station is not None or page.live:
            raise ConfigurationError(
                "has [[recorded]] profiles, so nothing moves: --dry-run, --live, --station and "
                "--unattended have no meaning, and --arm is the key solve.calibrate_arm",
                file=job,
            )
        _calibrate_recorded(read_recorded_job(job, keys), job, out, json=json)
    elif job is not None:
        with add_file_to_errors(job):
            at_station = read_calibration_job(job, keys).job_at_station(station)
        if not mode.dry_run:
            _start(at_station, job, out, page, mode, json=json)
        elif mode.arm or out is not None:
            raise ConfigurationError("--dry-run plans the lines of a job: no --out, no --arm")
        else:
            _check(at_station, job)


def _check(job: CalibrationJob, file: Path) -> None:
    """Check the job of a calibration, and plan its lines."""
    from numpy import degrees

    from tjscan.cli.output.console import print_message
    from tjscan.runs.calibration.run import check_calibration_job

    found = check_calibration_job(job, file)
    print_message(
        f"{file}: the job is sound, and the arm gets to all {job.board.lines} lines; their noise "
        f"would leave the sensor's pose uncertain to {1e3 * found.position:.2f} mm and "
        f"{degrees(found.rotation):.3f}°"
    )


def _start(
    job: CalibrationJob,
    file: Path,
    out: Path | None,
    page: LiveOptions,
    mode: CalibrationMode,
    *,
    json: bool,
) -> None:
    """Calibrate the cell of a job."""
    # A job with a mistake in it is refused before anything heavy is loaded.
    from tjscan.cli.operators import chosen_operator
    from tjscan.cli.output.calibration import finish_calibration
    from tjscan.runs.calibration.run import start_calibration
    from tjscan.runs.run import default_run_directory

    directory = out or default_run_directory(file)
    with chosen_operator(job, file, page, unattended=mode.unattended) as operator:
        done = start_calibration(job, file, directory, operator, arm=mode.arm)
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


def _calibrate_recorded(job: RecordedJob, file: Path, out: Path | None, *, json: bool) -> None:
    """Calibrate from the recorded profiles of a job."""
    from tjscan.cli.output.calibration import finish_calibration
    from tjscan.cli.output.console import print_message
    from tjscan.runs.calibration.run import calibrate_recorded_job
    from tjscan.runs.run import default_run_directory

    done = calibrate_recorded_job(job, file, out or default_run_directory(file), print_message)
    finish_calibration(done, json=json)
    if job.arm.id is None or job.laser.id is None:
        print_message(
            "name the devices with the keys arm.id and laser.id, or a scan will refuse that file"
        )
