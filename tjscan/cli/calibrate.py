"""``tjscan calibrate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tjscan.cli.recorded_options import RecordedOptions, written
from tjscan.core.errors import ConfigurationError


def calibrate(
    job: Path | None = None,
    *overrides: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    station: str | None = None,
    out: Path | None = None,
    unattended: bool = False,
    resume: Path | None = None,
    json: bool = False,
    recorded: RecordedOptions | None = None,
) -> None:
    """Find where the laser sits on the hand: on the cell of a job file, or from recorded profiles.

    Every key of the job file is an option too: ``--board.lines 16``.

    Parameters
    ----------
    job
        The job file (TOML) of the cell to calibrate.
    station
        Where the arm stands, of a job with several stations.
    out
        The directory to make; ``runs/JOB-DATE`` where left out.
    unattended
        Ask nothing; for a simulated cell.
    resume
        Go on with a calibration that was interrupted, in the directory it made.
    json
        Print the calibration as JSON on stdout.
    """
    given = [] if recorded is None else recorded.given
    if [job is not None, resume is not None, bool(given)].count(True) != 1:
        raise ConfigurationError(
            "calibrate takes either a job file, or --resume with a directory, or recorded "
            f"profiles with --lines and --poses (found: {written(given) or 'none of them'})"
        )
    if recorded is not None and given:
        from tjscan.cli.calibrate_recorded import calibrate_recorded

        if unattended:
            raise ConfigurationError("--unattended has no meaning for recorded profiles")
        calibrate_recorded(recorded, out, json=json)
        return
    from tjscan.cli.calibration_words import report_calibration
    from tjscan.cli.operators import AtTerminal, Unattended
    from tjscan.cli.overrides import parse_overrides
    from tjscan.core.config import naming
    from tjscan.job import read_calibration_job
    from tjscan.runs.calibrate import resume_calibration, start_calibration
    from tjscan.runs.directory import default_directory

    operator = Unattended() if unattended else AtTerminal()
    if resume is not None:
        if out is not None:
            raise ConfigurationError("--resume goes on where it was: --out has no meaning")
        found = resume_calibration(resume, operator)
    elif job is not None:
        with naming(job):
            parsed = read_calibration_job(job, parse_overrides(overrides)).at(station)
        found = start_calibration(parsed, job, out or default_directory(job), operator)
    report_calibration(found, json=json)
