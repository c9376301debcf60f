"""``tjscan scan``."""

from __future__ import annotations

from pathlib import Path

from tjscan.cli.options.overrides import JobKeys, parse_overrides
from tjscan.cli.options.page import LiveScanOptions


def scan(
    job: Path,
    *overrides: JobKeys,
    station: str | None = None,
    out: Path | None = None,
    resume: bool = False,
    dry_run: bool = False,
    realtime: bool = False,
    json: bool = False,
    page: LiveScanOptions | None = None,
) -> None:
    """Scan a groove as a job file states.

    Ctrl-C ends the scan after the section under way; twice, it stops the arm at once. Either way
    --resume goes on from there.

    Every key of the job file is an option too, as in
    ``tjscan scan examples/paper.toml --scan.step-mm 20``. Those that are changed most:

    - ``--scan.step-mm``: distance from section to section
    - ``--scan.length-mm``, ``--scan.sections``: where to end
    - ``--scan.standoff-mm``, ``--scan.pull-angle-deg``: how the laser looks at the groove
    - ``--scan.prediction-case``: how the next section is predicted
    - ``--arm.driver``, ``--arm.ur.host``, ``--arm.speed-mm-s``: the arm
    - ``--laser.driver``: the laser
    - ``--station.left.length-mm``: the same keys for one station
    - ``--simulation.seed``: other faults of the simulated cell

    Exit codes: 0 done, 1 ended before it was complete, 2 a mistake in job or options, 4 a fault of
    arm or laser, 130 interrupted.

    Parameters
    ----------
    job
        The job file (TOML); with --resume the run directory to go on in.
    station
        The one station to scan from, of a job with several; all of them if left out.
    out
        The run directory to make; ``runs/JOB-DATE`` if left out.
    resume
        Go on with an interrupted scan, after its last finished section, and with stations that
        are still to be scanned.
    dry_run
        Check the job and the whole way to the taught poses, and move nothing.
    realtime
        Let a simulated arm take its time; short for ``--simulation.arm.realtime true``.
    json
        Print the summary as JSON on stdout.
    """
    from tjscan.core.errors import ConfigurationError
    from tjscan.job import read_scan_job

    keys = parse_overrides(overrides) | ({"simulation.arm.realtime": True} if realtime else {})
    file = job / "job.toml" if resume else job
    parsed = read_scan_job(file, keys)
    page = page or LiveScanOptions()
    page.check()
    # A job with a mistake in it is refused before anything heavy is loaded.
    from tjscan.cli.output.console import show_phase

    with show_phase("loading arm and laser"):
        from tjscan.cli.scan_run import ScanRequest, check_job_only, run_scan_request
        from tjscan.runs.run import default_run_directory

    if resume and (out is not None or dry_run):
        raise ConfigurationError("--resume goes on in the run directory: no --out, no --dry-run")
    if dry_run:
        check_job_only(parsed, file, station)
        return
    run_scan_request(
        ScanRequest(
            job=parsed,
            file=file,
            keys=keys,
            station=station,
            directory=file.parent if resume else out or default_run_directory(file, station),
            resume=resume,
            page=page,
            json=json,
        )
    )
