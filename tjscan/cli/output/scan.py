"""What ``tjscan scan`` does once its options are checked; what it, reprocess and stitch print."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from rich.progress import Progress

from tjscan.calibration.wizard.operator import DefaultAnswerOperator
from tjscan.cli.interrupt import INTERRUPT_EXIT_CODE, ctrl_c_presser, stop_request_on_ctrl_c
from tjscan.cli.options.shared import LiveScanOptions
from tjscan.cli.output.calibration import TerminalOperator
from tjscan.cli.output.console import print_fields, print_json, print_message, progress_bars
from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.job.files import ScanJob
from tjscan.recording.journal import CombinedJournal, RunEvent
from tjscan.report.write import write_run_report
from tjscan.result import summary as results
from tjscan.runs.scan import run as scan
from tjscan.runs.scan.rehearsal import check_scan_job, is_simulated
from tjscan.runs.scan.run import ScanContext
from tjscan.runs.stations import run as stations
from tjscan.runs.stations.stitch import StitchedRun
from tjscan.scanning.journal import ScanEvent
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import ProfileView, ScannedSection

SMALLEST_OUT_OF_ROUND_MM: Final = 0.05
"""Tubes less out of round than this are not reported."""


class ProgressJournal:
    """Journal that shows a scan's progress on the terminal: a bar from its first profile on.

    Parameters
    ----------
    progress : Progress
        The progress bars.
    title : str
        What the bar of this scan is called.
    total : int or None
        Sections to scan, where that is known.
    """

    def __init__(self, progress: Progress, title: str, total: int | None) -> None:
        self._progress = progress
        self._task = progress.add_task(title, total=total, visible=False)

    def record(self, message: object) -> None:
        """Move the bar on to a finished section, whether or not those before were scanned earlier.

        What happened is printed above the bar; the reason for the end follows with the summary.
        """
        match message:
            case ProfileView():  # not yet a section
                self._progress.update(self._task, visible=True)
            case ScannedSection():
                self._progress.update(self._task, completed=message.view.index + 1)
            case RunEvent(name, detail):
                if name in (ScanEvent.STOP, ScanEvent.COMPLETE):
                    self._progress.console.print("writing the results and the report …")
                if name not in (ScanEvent.STOP, ScanEvent.FAILED, ScanEvent.INTERRUPTED):
                    self._progress.console.print(f"{name}: {detail}", markup=False)


@contextmanager
def scan_progress_bar(title: str, plan: ScanPlan) -> Iterator[ProgressJournal]:
    """Show a scan's progress bar while the block runs; gives the journal that moves it on."""
    with progress_bars() as progress:
        yield ProgressJournal(progress, title, plan.expected_sections)


def print_scan_summary(summary: results.ScanSummary, directory: Path, *, json: bool) -> None:
    """Print the summary of a finished scan: a table on stderr, or JSON on stdout."""
    if json:
        print(results.summary_to_json(summary))
        return
    print_fields(results.summary_in_words(summary))
    print_message(f"written to {directory}; see report.html, and sections.csv for the numbers")


def print_stitched_groove(done: StitchedRun, directory: Path, *, json: bool) -> None:
    """Print a stitched groove on stderr: stations, overlaps, totals; or JSON on stdout."""
    if json:
        print_json({"summary": done.summary, "stitching": done.report})
        return
    print_fields(_stitching_rows(done.summary, done.report))
    print_message(
        f"written to {directory}; see report.html, and stations.json for how it was stitched"
    )


def _stitching_rows(
    summary: results.ScanSummary, report: results.StitchingReport
) -> Iterator[tuple[str, str]]:
    first = report.stations[0]
    for one in report.stations:
        start, end = one.azimuth_deg
        off = (
            f"; seen from {first.name}, its base is {one.nominal_off_mm:.0f} mm and "
            f"{one.nominal_off_deg:.1f}° from where it was meant to"
        )
        yield (
            f"station {one.name}",
            f"{one.sections} sections from {start:.0f}° to {end:.0f}°, groove placed to "
            f"{one.sigma_groove_mm:.3f} mm{'' if one is first else off}",
        )
    for edge in report.overlaps:
        yield (
            f"overlap {' + '.join(edge.stations)}",
            f"{edge.arc_deg:.0f}° at {edge.azimuth_deg:.0f}°: residuals {edge.residual_rms_mm:.3f} "
            f"mm, gap {edge.gap_mm:.3f} mm",
        )
    before, after = report.loop_gap_before_mm, report.loop_gap_after_mm
    if before is not None and after is not None:
        yield "loop gap", f"{before:.3f} mm, closed {after:.3f} mm"
    else:
        yield "loop", results.LOOP_OPEN_TEXT
    yield "covered", f"{report.covered_deg:.0f}°, {summary.sections} sections"
    yield (
        "diameters",
        f"brace {report.brace_diameter_mm:.2f} ± {report.sigma_brace_diameter_mm:.2f} mm, "
        f"leg {report.leg_diameter_mm:.2f} ± {report.sigma_leg_diameter_mm:.2f} mm",
    )
    if report.out_of_round_mm > SMALLEST_OUT_OF_ROUND_MM:
        yield (
            "out of round",
            f"tubes bulge by some {report.out_of_round_mm:.2f} mm: frame j is that uncertain, the "
            "overlaps hold the stations together",
        )
    if (error := summary.corner_error_mm) is not None:
        yield "corner error", f"{error.mean:.3f} mm mean, {error.p95:.3f} p95, {error.max:.3f} max"
    yield from results.uncertainty_lines(summary)


def check_job_only(job: ScanJob, file: Path, station: str | None) -> None:
    """Check a job and the way to its taught poses, without a scan."""
    context = ScanContext(_job_at_chosen_station(job, file, station), file)
    check_scan_job(context)
    looked = is_simulated(job)
    seen = "a groove is read there" if looked else "no groove was looked for: not all is simulated"
    print_message(f"{file}: the job is sound, the way to its taught poses is clear, and {seen}")


@dataclass(frozen=True, slots=True)
class ScanRequest:
    """The scan that a command line asks for.

    Parameters
    ----------
    job : ScanJob
    file : Path
        The file that it was read from; to resume, in the run directory.
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
    carrier = context.job.carrier
    if context.job.arm.driver != "simulated" and (carrier is None or carrier.driver == "none"):
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
    with show_scan(there, page.page_address, print_message, ctrl_c_presser(), resumed) as on_page:
        if page.wait:
            on_page.run.wait_for_start()
        yield replace(context, journal=CombinedJournal(context.journal, on_page))
