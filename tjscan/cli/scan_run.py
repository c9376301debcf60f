"""A scan as ``tjscan scan`` asks for it: check only, new or resumed, from one station or all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tjscan.calibration.wizard.operator import DefaultAnswerOperator
from tjscan.cli.interrupt import INTERRUPT_EXIT_CODE, ctrl_c_presser, stop_request_on_ctrl_c
from tjscan.cli.operators import TerminalOperator
from tjscan.cli.options.page import LiveScanOptions
from tjscan.cli.output.console import print_json, print_message
from tjscan.cli.output.scan import print_scan_summary, print_stitched_groove, scan_progress_bar
from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.job import ScanJob
from tjscan.recording.journal import CombinedJournal
from tjscan.report.write import write_run_report
from tjscan.runs.scan import run as scan
from tjscan.runs.scan.context import RunContext
from tjscan.runs.stations import run as stations


def check_job_only(job: ScanJob, file: Path, station: str | None) -> None:
    """Check a job and the way to its taught poses, without a scan."""
    scan.check_scan_job(RunContext(_at(job, file, station), file))
    print_message(f"{file}: the job is sound, and the way to its taught poses is clear")


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanRequest:
    """The scan that a command line asks for.

    Parameters
    ----------
    job : ScanJob
    file : Path
        Where it was read from; to resume, in the run directory.
    keys : dict
        Keys of the job that the command line replaced.
    station : str, optional
        The one station to scan from.
    directory : Path
        Of the run: to make, or to go on in.
    resume : bool
        Whether to go on with an interrupted scan.
    page : LiveScanOptions
        Whether and where it is shown in a browser.
    json : bool
        Whether to print the summary as JSON.
    """

    job: ScanJob
    file: Path
    keys: dict[str, Any]
    station: str | None
    directory: Path
    resume: bool
    page: LiveScanOptions
    json: bool

    @property
    def job_there(self) -> ScanJob:
        """The job at the one station, if one is chosen."""
        return _at(self.job, self.file, self.station)


def run_scan_request(request: ScanRequest) -> None:
    """Scan into a new directory, or go on in the directory of an interrupted scan."""
    # A resumed scan of several stations has a directory for each of them, whichever is chosen.
    job = request.job if request.resume else request.job_there
    if len(job.station) > 1:
        _scan_from_stations(request, job)
    else:
        _scan_from_one_place(request)


def _scan_from_one_place(request: ScanRequest) -> None:
    directory = request.directory
    with (
        scan_progress_bar("sections", request.job_there.scan) as journal,
        stop_request_on_ctrl_c() as stop,
        _on_page(
            RunContext(request.job_there, request.file, journal, write_run_report, stop),
            request.page,
            directory if request.resume else None,
        ) as context,
    ):
        if request.resume:
            summary = scan.resume_scan(context, request.keys)
        else:
            summary = scan.run_scan(context, directory)
    print_scan_summary(summary, directory, json=request.json)
    if not summary.complete:
        print_message(f"to go on: tjscan scan --resume {directory}")
        raise SystemExit(INTERRUPT_EXIT_CODE if stop.ends_after_section else 1)


def _scan_from_stations(request: ScanRequest, job: ScanJob) -> None:
    """Scan from all stations, or the one chosen, and stitch what they scanned once all have."""
    if request.page.live:
        raise ConfigurationError("--live shows one station at a time: choose it with --station")
    directory = request.directory
    operator: stations.StationOperator = DefaultAnswerOperator()
    if job.arm.driver != "simulated":
        operator = TerminalOperator("scan one station at a time, with --station")
    with stop_request_on_ctrl_c() as stop:
        context = RunContext(job, request.file, stop=stop, finished=write_run_report)
        if request.resume:
            scans = stations.resume_stations(
                context, request.keys, operator, scan_progress_bar, request.station
            )
        else:
            scans = stations.run_stations(context, directory, operator, scan_progress_bar)
    if all(one.summary is not None for one in scans):
        stitched = stations.stitch_station_runs(directory, write_run_report)
        print_stitched_groove(stitched, directory, json=request.json)
    else:
        _print_some(scans, json=request.json)
    short = [one.name for one in scans if not one.is_complete]
    if short:
        print_message(f"to go on with {', '.join(short)}: tjscan scan --resume {directory}")
        raise SystemExit(INTERRUPT_EXIT_CODE if stop.ends_after_section else 1)


def _at(job: ScanJob, file: Path, station: str | None) -> ScanJob:
    if station is None:
        return job
    with add_file_to_errors(file):
        return job.job_at_station(station)


@contextmanager
def _on_page(
    context: RunContext, page: LiveScanOptions, resumed: Path | None
) -> Iterator[RunContext]:
    """Show a scan on the live page too, if that is asked for, while the block runs."""
    if not page.live:
        yield context
        return
    from tjscan.runs.live.scan import show_scan

    job = context.job.job_at_station()
    context_there = replace(context, job=job)
    with show_scan(context_there, page.where, print_message, ctrl_c_presser(), resumed) as on_page:
        if page.wait:
            on_page.run.wait_for_start()
        yield replace(context, journal=CombinedJournal(context.journal, on_page))


def _print_some(scans: Sequence[stations.StationScan], *, json: bool) -> None:
    """Print what was scanned so far, if that is not all."""
    if json:
        summaries = {one.name: one.summary for one in scans}
        print_json({"stations": summaries})
        return
    for one in scans:
        print_message(f"station {one.name}{'' if one.summary else ' is still to be scanned'}")
        if one.summary is not None:
            print_scan_summary(one.summary, one.directory, json=False)
