"""The part of ``tjscan scan`` that goes from station to station."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict
from json import dumps
from pathlib import Path
from typing import Any

from tjscan.calibration.operator import Nobody
from tjscan.cli.console import report, say, watching
from tjscan.cli.interrupt import INTERRUPTED, stopped_by_ctrl_c
from tjscan.cli.operators import AtTerminal
from tjscan.cli.stitching_words import report_stitching
from tjscan.job import JobFile
from tjscan.runs.stations import (
    Attendant,
    StationScan,
    resume_stations,
    run_stations,
    stitch_stations,
)
from tjscan.scanning.journal import Journal
from tjscan.scanning.plan import ScanPlan


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
    with stopped_by_ctrl_c() as stop:
        if resumed_with is None:
            scans = run_stations(job, job_file, directory, attendant, _show, stop)
        else:
            scans = resume_stations(directory, resumed_with, attendant, _show, only, stop)
    if all(scan.summary is not None for scan in scans):
        report_stitching(stitch_stations(directory), directory, json=json)
    else:
        _report(scans, json=json)
    short = [scan.name for scan in scans if not scan.done]
    if short:
        say(f"to go on with {', '.join(short)}: tjscan scan --resume {directory}")
        raise SystemExit(INTERRUPTED if stop.wanted else 1)


def _attendant(job: JobFile) -> Attendant:
    """Who says that the arm stands at its station: a simulated one is there at once."""
    if job.arm.driver == "simulated":
        return Nobody()
    return AtTerminal("scan one station at a time, with --station")


def _show(name: str, plan: ScanPlan) -> AbstractContextManager[Journal]:
    return watching(plan, name)


def _report(scans: Sequence[StationScan], *, json: bool) -> None:
    """What was scanned so far, where that is not all."""
    if json:
        told = {scan.name: scan.summary and asdict(scan.summary) for scan in scans}
        print(dumps({"stations": told}, indent=2))
        return
    for scan in scans:
        say(f"station {scan.name}{'' if scan.summary else ' is still to be scanned'}")
        if scan.summary is not None:
            report(scan.summary, scan.directory, json=False)
