"""The modes of ``tjscan scan``: check only, scan anew or go on, from one station or from all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic_core import to_json

from tjscan.calibration.wizard.operator import DefaultAnswerOperator
from tjscan.cli.interrupt import INTERRUPTED, ctrl_c_presser, stop_request_on_ctrl_c
from tjscan.cli.operators import TerminalOperator
from tjscan.cli.options.page import LiveScanOptions
from tjscan.cli.output.console import print_message
from tjscan.cli.output.scan import print_scan_summary, scan_progress_bar
from tjscan.cli.output.stitching import print_stitched_groove
from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.job import ScanJob
from tjscan.report.write import write_run_report
from tjscan.result.summary import ScanSummary
from tjscan.runs.run import default_run_directory
from tjscan.runs.scan import run as scan
from tjscan.runs.scan.context import RunContext
from tjscan.runs.stations import run as stations
from tjscan.scanning.journal import CombinedJournal, Journal
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.stopping import StopRequest


def check_job_only(job: ScanJob, file: Path, station: str | None) -> None:
    """Check a job and the way to its taught poses, without a scan."""
    scan.check_scan_job(RunContext(_at(job, file, station), file))
    print_message(f"{file}: the job is sound, and the way to its taught poses is clear")


def start_new_scan(
    job: ScanJob,
    file: Path,
    out: Path | None,
    station: str | None,
    page: LiveScanOptions,
    *,
    json: bool,
) -> None:
    """Scan into a new directory that is made for it."""
    job = _at(job, file, station)
    directory = out or default_run_directory(file, station)
    if len(job.station) > 1:
        _refuse_page_of_many(page)
        operator = _station_operator(job)
        with stop_request_on_ctrl_c() as stop:
            context = RunContext(job, file, stop=stop, finished=write_run_report)
            scans = stations.run_stations(context, directory, operator, _show)
        _end_stations(scans, directory, stop, json=json)
        return
    with _watched(job, file, page) as context:
        summary = scan.run_scan(context, directory)
    _end_scan(summary, directory, context.stop, json=json)


def resume_interrupted_scan(
    job: ScanJob,
    file: Path,
    keys: dict[str, Any],
    station: str | None,
    page: LiveScanOptions,
    *,
    json: bool,
) -> None:
    """Resume an interrupted scan in its directory, with some keys of its job replaced."""
    if len(job.station) > 1:  # each has a directory of its own in this one
        _refuse_page_of_many(page)
        operator = _station_operator(job)
        with stop_request_on_ctrl_c() as stop:
            context = RunContext(job, file, stop=stop, finished=write_run_report)
            scans = stations.resume_stations(context, keys, operator, _show, station)
        _end_stations(scans, file.parent, stop, json=json)
        return
    with _watched(_at(job, file, station), file, page, resumed=file.parent) as context:
        summary = scan.resume_scan(context, keys)
    _end_scan(summary, file.parent, context.stop, json=json)


def _at(job: ScanJob, file: Path, station: str | None) -> ScanJob:
    if station is None:
        return job
    with add_file_to_errors(file):
        return job.job_at_station(station)


@contextmanager
def _watched(
    job: ScanJob, file: Path, page: LiveScanOptions, resumed: Path | None = None
) -> Iterator[RunContext]:
    """Show a scan's progress, and let Ctrl-C stop it, while the block runs."""
    with (
        scan_progress_bar(job.scan) as journal,
        stop_request_on_ctrl_c() as stop,
        _on_page(RunContext(job, file, journal, stop, write_run_report), page, resumed) as context,
    ):
        yield context


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


def _refuse_page_of_many(page: LiveScanOptions) -> None:
    if page.live:
        raise ConfigurationError("--live shows one station at a time: choose it with --station")


def _show(name: str, plan: ScanPlan) -> AbstractContextManager[Journal]:
    return scan_progress_bar(plan, name)


def _station_operator(job: ScanJob) -> stations.StationOperator:
    """Who confirms that the arm stands at its station: a simulated one is there at once."""
    if job.arm.driver == "simulated":
        return DefaultAnswerOperator()
    return TerminalOperator("scan one station at a time, with --station")


def _end_scan(summary: ScanSummary, directory: Path, stop: StopRequest, *, json: bool) -> None:
    """Print what was scanned, and exit with 130 or 1 where that is not all."""
    print_scan_summary(summary, directory, json=json)
    if not summary.complete:
        print_message(f"to go on: tjscan scan --resume {directory}")
        raise SystemExit(INTERRUPTED if stop.ends_after_section else 1)


def _end_stations(
    scans: Sequence[stations.StationScan], directory: Path, stop: StopRequest, *, json: bool
) -> None:
    """Stitch what all stations scanned and print it; exit as `_end_scan` does."""
    if all(one.summary is not None for one in scans):
        stitched = stations.stitch_station_runs(directory, write_run_report)
        print_stitched_groove(stitched, directory, json=json)
    else:
        _print_some(scans, json=json)
    short = [one.name for one in scans if not one.is_complete]
    if short:
        print_message(f"to go on with {', '.join(short)}: tjscan scan --resume {directory}")
        raise SystemExit(INTERRUPTED if stop.ends_after_section else 1)


def _print_some(scans: Sequence[stations.StationScan], *, json: bool) -> None:
    """Print what was scanned so far, where that is not all."""
    if json:
        summaries = {one.name: one.summary for one in scans}
        print(to_json({"stations": summaries}, indent=2).decode())
        return
    for one in scans:
        print_message(f"station {one.name}{'' if one.summary else ' is still to be scanned'}")
        if one.summary is not None:
            print_scan_summary(one.summary, one.directory, json=False)
