"""A scan as ``tjscan scan`` asks for it: check only, new or resumed, from one station or all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tjscan.calibration.wizard.operator import DefaultAnswerOperator
from tjscan.cli.interrupt import INTERRUPT_EXIT_CODE, ctrl_c_presser, stop_request_on_ctrl_c
from tjscan.cli.options.page import LiveScanOptions
from tjscan.cli.output.calibration import TerminalOperator
from tjscan.cli.output.console import print_json, print_message
from tjscan.cli.output.scan import print_scan_summary, print_stitched_groove, scan_progress_bar
from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.job.files import ScanJob
from tjscan.recording.journal import CombinedJournal
from tjscan.report.write import write_run_report
from tjscan.runs.scan import run as scan
from tjscan.runs.scan.run import ScanContext
from tjscan.runs.stations import run as stations


def check_job_only(job: ScanJob, file: Path, station: str | None) -> None:
    """Check a job and the way to its taught poses, without a scan."""
    scan.check_scan_job(ScanContext(_job_at_chosen_station(job, file, station), file))
    print_message(f"{file}: the job is sound, and the way to its taught poses is clear")


@dataclass(frozen=True, slots=True)
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
    page : LiveScanOptions
        Whether and where it is shown in a browser.
    resume : bool
        Whether to go on with an interrupted scan.
    json : bool
        Whether to print the summary as JSON.
    """

    job: ScanJob
    file: Path
    keys: dict[str, Any]
    station: str | None
    directory: Path
    page: LiveScanOptions
    resume: bool
    json: bool


def run_scan_request(request: ScanRequest) -> None:
    """Scan into a new directory, or go on in the directory of an interrupted scan."""
    here = _job_at_chosen_station(request.job, request.file, request.station)
    # A resumed scan of several stations has a directory for each of them, whichever is chosen.
    whole = request.job if request.resume else here
    with stop_request_on_ctrl_c() as stop:
        context = ScanContext(whole, request.file, stop=stop, finished=write_run_report)
        if len(whole.station) > 1:
            unfinished = _scan_from_stations(request, context)
        else:
            unfinished = _scan_from_one_place(request, replace(context, job=here))
    if unfinished is not None:
        names = unfinished and f" with {', '.join(unfinished)}"
        print_message(f"to go on{names or ''}: tjscan scan --resume {request.directory}")
        raise SystemExit(INTERRUPT_EXIT_CODE if stop.ends_after_section else 1)


def _scan_from_one_place(request: ScanRequest, context: ScanContext) -> list[str] | None:
    """Scan, and print the summary; an empty list if the scan is not complete."""
    with (
        scan_progress_bar("sections", context.job.scan) as journal,
        _shown_on_page(replace(context, journal=journal), request) as shown,
    ):
        if request.resume:
            summary = scan.resume_scan(shown, request.keys)
        else:
            summary = scan.run_scan(shown, request.directory)
    print_scan_summary(summary, request.directory, json=request.json)
    return None if summary.complete else []


def _scan_from_stations(request: ScanRequest, context: ScanContext) -> list[str] | None:
    """Scan from all stations, or the one chosen, and stitch what they scanned once all have.

    Returns the names of those that are not complete, if any.
    """
    if request.page.live:
        raise ConfigurationError("--live shows one station at a time: choose it with --station")
    operator: stations.StationOperator = DefaultAnswerOperator()
    if context.job.arm.driver != "simulated":
        operator = TerminalOperator("scan one station at a time, with --station")
    watch, directory = scan_progress_bar, request.directory
    if request.resume:
        scans = stations.resume_stations(context, request.keys, operator, watch, request.station)
    else:
        scans = stations.run_stations(context, directory, operator, watch)
    if all(one.summary is not None for one in scans):
        stitched = stations.stitch_station_runs(directory, write_run_report)
        print_stitched_groove(stitched, directory, json=request.json)
    elif request.json:
        print_json({"stations": {one.name: one.summary for one in scans}})
    else:
        for one in scans:
            print_message(f"station {one.name}{'' if one.summary else ' is still to be scanned'}")
            if one.summary is not None:
                print_scan_summary(one.summary, one.directory, json=False)
    return [one.name for one in scans if not one.is_complete] or None


def _job_at_chosen_station(job: ScanJob, file: Path, station: str | None) -> ScanJob:
    if station is None:
        return job
    with add_file_to_errors(file):
        return job.job_at_station(station)


@contextmanager
def _shown_on_page(context: ScanContext, request: ScanRequest) -> Iterator[ScanContext]:
    """Show a scan on the live page too, if that is asked for, while the block runs."""
    page = request.page
    if not page.live:
        yield context
        return
    from tjscan.runs.live.scan import show_scan

    there = replace(context, job=context.job.job_at_station())
    resumed = request.directory if request.resume else None
    with show_scan(there, page.where, print_message, ctrl_c_presser(), resumed) as on_page:
        if page.wait:
            on_page.run.wait_for_start()
        yield replace(context, journal=CombinedJournal(context.journal, on_page))
