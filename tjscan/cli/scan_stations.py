"""The part of ``tjscan scan`` that goes from station to station."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tjscan.calibration.operator import Nobody
from tjscan.cli.console import report, say, watching
from tjscan.cli.interrupt import INTERRUPTED, stopped_by_ctrl_c
from tjscan.cli.operators import AtTerminal
from tjscan.job import JobFile
from tjscan.station_run import Attendant, StationScan, resume_stations, run_stations


def scan_stations(
    job: JobFile,
    job_file: Path,
    directory: Path,
    resumed_with: dict[str, Any] | None,
    only: str | None,
    *,
    json: bool,
) -> None:
    """Scan from all stations of a job, or go on where `resumed_with` says with which keys."""
    attendant = _attendant(job)
    show = lambda name, plan: watching(plan, name)  # noqa: E731
    with stopped_by_ctrl_c() as stop:
        if resumed_with is None:
            scans = run_stations(job, job_file, directory, attendant, show, stop)
        else:
            scans = resume_stations(directory, resumed_with, attendant, show, only, stop)
    _report(scans, directory, json=json)
    if all(scan.done for scan in scans):
        return
    say(f"to go on with what is missing: tjscan scan --resume {directory}")
    raise SystemExit(INTERRUPTED if stop.wanted else 1)


def _attendant(job: JobFile) -> Attendant:
    """Who says that the arm stands at its station: a simulated one is there at once."""
    if job.arm.driver == "simulated":
        return Nobody()
    return AtTerminal("scan one station at a time, with --station")


def _report(scans: tuple[StationScan, ...], directory: Path, *, json: bool) -> None:
    for scan in scans:
        if scan.summary is None:
            say(f"station {scan.name} is still to be scanned")
        else:
            say(f"station {scan.name}")
            report(scan.summary, scan.directory, json=json)
