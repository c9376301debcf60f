"""Write a run's report."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.comparison.shapes import UserUnitAndFrame
from tjscan.core.files import write_files_atomically
from tjscan.core.provenance import FRAME_DESCRIPTIONS, Provenance
from tjscan.joint.definition import JointDefinition
from tjscan.report import charts, findings
from tjscan.report.chapter_page import draw_sheet_picture, render_chapter_page
from tjscan.report.clock import EventClock
from tjscan.report.data import ReportData, read_report_data, station_folders
from tjscan.report.dimensions import fit_up_table
from tjscan.report.drawings import draw_sections
from tjscan.report.picture import load_template
from tjscan.report.profiles import draw_fitted_profiles
from tjscan.report.view3d import groove_view_data
from tjscan.result.chapter import ReportChapter, ReportSheet
from tjscan.result.directory import job_label_of_run
from tjscan.result.picture import write_png
from tjscan.result.section import MEASURE_FIELDS, SIGMA_FIELDS
from tjscan.runs.tasks import task_with_own_page

ALIGNMENT_METHOD_TEXTS: Final = {"none": "", "joint": "the tubes of both", "icp": "nearest points"}
"""What brought what was measured onto its reference."""

REPORT_PICTURES: Final = {
    "view": charts.draw_groove_in_space,
    "deviation": charts.draw_deviation_map,
    "corners": charts.draw_corner_errors,
    "measures": charts.draw_measure_charts,
    "fit_up": charts.draw_fit_up,
    "profiles": draw_fitted_profiles,
    "steps": charts.draw_scan_charts,
    "stations": charts.read_stations_picture,
}
"""What draws each picture of the page, if the run has what it shows."""


def render_report_page(data: ReportData) -> str:
    """Render the report's HTML page, its pictures inlined.

    Everything that comes from files (names, reasons, events) is escaped.

    Parameters
    ----------
    data : ReportData
        The run.
    """
    stitching, comparison = data.stitching, data.comparison
    folders = (data.directory, *station_folders(data.directory, stitching).values())
    provenance = Provenance.for_file_written_now(job_label_of_run(*folders), data.summary.frame)
    several = len(data.places) > 1
    clocks = [
        EventClock.of_run(one.directory, one.events, several * one.name) for one in data.places
    ]
    scans = [(place.name, place.summary) for place in data.places if several]
    method = "none" if comparison is None else comparison.alignment.method
    return load_template("report.html.jinja").render(
        name=data.directory.resolve().name,
        summary=data.summary,
        headline=list(findings.headline_numbers(data)),
        joint=_joint_in_words(data.joint),
        coverage=findings.describe_coverage(data),
        frames=FRAME_DESCRIPTIONS,
        station_facts=list(_station_fact_rows(data)),
        findings=list(findings.report_findings(data)),
        pictures={name: draw(data) for name, draw in REPORT_PICTURES.items()},
        scene=groove_view_data(data),
        drawings=draw_sections(data),
        fit_up=fit_up_table(data),
        by_the_clock=data.unwrapped_azimuths is not None,
        comparison=comparison,
        compared_with="" if comparison is None else findings.name_of_reference(comparison),
        aligned_by=ALIGNMENT_METHOD_TEXTS[method],
        scans=[*scans, ("all" if several else "scan", data.summary)],
        clocks=clocks,
        stitching=stitching,
        measures=_measure_rows(data),
        provenance=provenance.header_entries,
    )


def _station_fact_rows(data: ReportData) -> Iterator[tuple[str, str]]:
    """Rows of name and value: what the stations' chapters state, once if it is the same for all."""
    for name in dict.fromkeys(name for place in data.places for name in place.facts):
        values = {place.name: place.facts.get(name, "") for place in data.places}
        if len(set(values.values())) == 1:
            yield name, next(iter(values.values()))
        else:
            yield from ((f"{name}, {station}", value) for station, value in values.items())


def _measure_rows(data: ReportData) -> list[tuple[str, ...]]:
    """A row for each measure of the groove: smallest, mean, largest, median standard deviation."""
    table = []
    for field, sigma in zip(MEASURE_FIELDS, SIGMA_FIELDS, strict=True):
        values = field.values_in_file_units(data.sections)
        spread = np.median(sigma.values_in_file_units(data.sections))
        numbers = (f"{value:.2f}" for value in (values.min(), values.mean(), values.max()))
        table.append((field.chart_title, *numbers, f"{spread:.2g}"))
    return table


def _joint_in_words(joint: JointDefinition | None) -> str:
    """The measures of a joint as designed; empty if it is not known."""
    if joint is None:
        return ""
    leg, brace = 2e3 * joint.leg_radius, 2e3 * joint.brace_radius
    return (
        f"{joint.name}: leg {leg:g} × {1e3 * joint.leg_wall:g} mm, brace {brace:g} × "
        f"{1e3 * joint.brace_wall:g} mm, {np.degrees(joint.angle):g}° between them"
    )


REPORT_FILE: Final = "report.html"


def write_run_report(
    directory: Path,
    reference: Path | None = None,
    tolerance: float | None = None,
    options: UserUnitAndFrame | None = None,
) -> Path:
    """Write ``report.html`` into a run directory, with the picture of a sheet, and return it.

    Parameters
    ----------
    directory : Path
        A finished run, of one scan or stitched.
    reference : Path, optional
        What to compare it with, in place of the joint that the run names.
    tolerance : float, optional
        Of that comparison, metres.
    options : UserUnitAndFrame, optional
        Unit and frame of a reference that does not state them.

    Raises
    ------
    ConfigurationError
        If there is no finished run, or the reference can't be read or compared with.
    ComparisonRefused
        If the reference does not fit.
    RecordingError
        If a recording is damaged, or the report can't be written.
    """
    sheet: ReportSheet | None = None
    if (task := task_with_own_page(directory)) is not None:
        chapter: ReportChapter = task.load("page")(directory)
        sheet = chapter.sheet
        page = render_chapter_page(chapter, task.name.capitalize(), directory)
    else:
        page = render_report_page(read_report_data(directory, reference, tolerance, options))
    with write_files_atomically(directory) as draft:
        (draft / REPORT_FILE).write_text(page, encoding="utf-8")
        if sheet is not None:
            head = Provenance.for_file_written_now(job_label_of_run(directory), sheet.frame)
            write_png(draft / sheet.picture, draw_sheet_picture(chapter), head)
    return directory / REPORT_FILE
