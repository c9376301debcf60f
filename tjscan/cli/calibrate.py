"""``tjscan calibrate``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tjscan.cli.options.shared import (
    CalibrationMode,
    JobKeys,
    LiveOptions,
    RecordedOptions,
    parse_overrides,
)
from tjscan.core.errors import ConfigurationError

if TYPE_CHECKING:
    from tjscan.job.files import CalibrationJob, RecordedJob


def calibrate(
    job: Path | None = None,
    *overrides: JobKeys,
    station: str | None = None,
    out: Path | None = None,
    resume: Path | None = None,
    json: bool = False,
    mode: CalibrationMode | None = None,
    recorded: RecordedOptions | None = None,
    page: LiveOptions | None = None,
) -> None:
    """Find the pose of the sensor on the flange, in the cell of a job or from recorded profiles.

    Every key of the job file is an option too: ``--board.lines 16``. A job with tables
    ``[[recorded]]`` computes from recorded profiles, and moves nothing; so does a file or folder of
    profiles in place of a job, with the file of the flange's poses beside them.

    Parameters
    ----------
    job
        The job file (TOML) of the cell to calibrate, or of recorded profiles; or these
        themselves, as ``tjscan groove`` reads them.
    station
        The station of the arm, of a job with several stations.
    out
        The directory to make; ``runs/JOB-DATE`` if left out.
    resume
        Go on with a calibration that was interrupted, in the directory it made.
    json
        Print the calibration as JSON on stdout.
    """
    from tjscan.core.config import add_file_to_errors
    from tjscan.job import files
    from tjscan.result.directory import JOB_FILE

    mode, page, keys = mode or CalibrationMode(), page or LiveOptions(), parse_overrides(overrides)
    page.check_options()
    if page.live and (mode.unattended or (job is None and resume is None)):
        raise ConfigurationError("--live asks a person on a page, in the cell of a job")
    file = job if resume is None else resume / JOB_FILE
    if file is None or (job is not None and resume is not None):
        raise ConfigurationError(
            "calibrate takes either a job file, or --resume with a directory "
            f"(found: {'none of them' if job is None else 'both'})"
        )
    parsed: CalibrationJob | RecordedJob
    if resume is not None:
        if mode.arm or mode.dry_run or out is not None:
            raise ConfigurationError("--resume goes on as it was begun: no --arm, --dry-run, --out")
        parsed = files.read_calibration_job(file)
    elif files.is_recording(file) or files.has_recorded_profiles(file):
        if (
            mode != replace(CalibrationMode(), arm=mode.arm, check=mode.check)
            or station
            or page.live
        ):
            raise ConfigurationError(
                "has recorded profiles, so nothing moves: --dry-run, --live, --station and "
                "--unattended have no meaning",
                file=file,
            )
        keys |= {"solve.calibrate_arm": True} if mode.arm else {}
        parsed = _parse_recorded_job(file, recorded or RecordedOptions(), keys)
    else:
        _refuse_recorded_options(file, recorded or RecordedOptions())
        with add_file_to_errors(file):
            parsed = files.read_calibration_job(file, keys).job_at_station(station)
        if mode.dry_run and (mode.arm or out is not None):
            raise ConfigurationError("--dry-run plans the lines of a job: no --out, no --arm")
    if mode.check is not None:
        if not isinstance(parsed, files.RecordedJob) or out is not None or json:
            raise ConfigurationError(
                "--check takes a job with [[recorded]], and no --out or --json"
            )
        from tjscan.cli.output.calibration import print_calibration_check

        print_calibration_check(mode.check, parsed, file.parent)
        return
    # A job with a mistake in it is refused before anything heavy is loaded.
    from tjscan.cli.output.calibration import calibrate_and_print, print_job_check

    if mode.dry_run and not isinstance(parsed, files.RecordedJob):
        print_job_check(parsed, file)
    else:
        again = resume is not None
        calibrate_and_print(parsed, file, out, page, mode, resume=again, json=json)


def _parse_recorded_job(file: Path, options: RecordedOptions, keys: dict[str, Any]) -> RecordedJob:
    from tjscan.job import files

    if files.is_recording(file):
        return files.recorded_job_of_files(file, options.stated, keys)
    _refuse_recorded_options(file, options)
    return files.read_recorded_job(file, keys)


def _refuse_recorded_options(job: Path, options: RecordedOptions) -> None:
    if options.stated:
        raise ConfigurationError(
            "is a job, which states its target and files by keys of its own: leave out --"
            + ", --".join(options.stated).replace("_", "-"),
            file=job,
        )
