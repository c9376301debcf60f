"""``tjscan scan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def scan(
    job: Path,
    *overrides: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    station: str | None = None,
    out: Path | None = None,
    resume: bool = False,
    dry_run: bool = False,
    realtime: bool = False,
    json: bool = False,
) -> None:
    """Scan a groove as a job file says.

    Ctrl-C ends the scan after the section under way; twice, it stops the arm at once. Either way
    --resume goes on from there.

    Every key of the job file is an option too: ``--scan.step-mm 20``,
    ``--station.left.length-mm 600``.

    Parameters
    ----------
    job
        The job file (TOML); with --resume the run directory to go on in.
    station
        The one station to scan from, of a job with several; all of them where left out.
    out
        The run directory to make; ``runs/JOB-DATE`` where left out.
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
    from tjscan.cli.console import report, say, watching
    from tjscan.cli.interrupt import INTERRUPTED, stopped_by_ctrl_c
    from tjscan.cli.overrides import parse_overrides
    from tjscan.cli.scan_stations import scan_stations
    from tjscan.core.config import naming
    from tjscan.core.errors import ConfigurationError
    from tjscan.job import read_job
    from tjscan.result.directory import JOB
    from tjscan.runs.directory import default_directory
    from tjscan.runs.scan import check_job, plan_of, resume_job, run_job

    keys = parse_overrides(overrides)
    if realtime:
        keys["simulation.arm.realtime"] = True
    file = job / JOB if resume else job
    parsed = read_job(file, keys)
    if resume and (out is not None or dry_run):
        raise ConfigurationError("--resume goes on in the run directory: no --out, no --dry-run")
    whole = resume and len(parsed.station) > 1  # keeps its stations in folders of its own
    if station is not None and not whole:
        with naming(file):
            parsed = parsed.at(station)
    if dry_run:
        check_job(parsed, file)
        say(f"{file}: the job is sound, and the way to its taught poses is clear")
        return
    directory = job if resume else out or default_directory(file, station)
    if len(parsed.station) > 1:
        scan_stations(parsed, file, directory, keys if resume else None, station, json=json)
        return
    with watching(plan_of(parsed)) as watch, stopped_by_ctrl_c() as stop:
        if resume:
            summary = resume_job(directory, keys, watch, stop)
        else:
            summary = run_job(parsed, file, directory, watch, stop)
    report(summary, directory, json=json)
    if stop.wanted and not summary.complete:
        raise SystemExit(INTERRUPTED)
    if not summary.complete:
        raise SystemExit(1)
