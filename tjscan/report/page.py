"""``report.html``: one file that opens offline."""

from __future__ import annotations

from typing import Final

from tjscan.core.provenance import Provenance
from tjscan.report.charts import (
    deviation_table_rows,
    draw_corner_errors,
    draw_deviation_map,
    draw_groove_in_space,
    draw_measure_charts,
    draw_scan_charts,
)
from tjscan.report.data import ReportData
from tjscan.report.drawings import describe_drawings, draw_sections
from tjscan.report.findings import headline_numbers, name_of_reference, report_findings
from tjscan.report.fit_up import draw_fit_up, fit_up_table
from tjscan.report.picture import load_template
from tjscan.report.profiles import draw_fitted_profiles
from tjscan.report.stations import (
    overlap_rows,
    read_stations_picture,
    station_folders,
    station_rows,
)
from tjscan.report.tables import (
    event_rows,
    measure_rows,
    scan_fact_rows,
    scan_statistics_rows,
    uncertainty_rows,
)
from tjscan.report.view3d import view_data
from tjscan.result.directory import job_label_of_run

ALIGNED: Final = {"none": "", "joint": "the tubes of both", "icp": "nearest points"}
"""What brought what was measured onto its reference."""


def render_report_page(data: ReportData) -> str:
    """Render the report's HTML page, its pictures inlined.

    Everything that comes from files (names, reasons, events) is escaped.

    Parameters
    ----------
    data : ReportData
        The run.
    """
    template = load_template("report.html.jinja")
    pictures = {
        "view": draw_groove_in_space(data),
        "deviation": draw_deviation_map(data),
        "corners": draw_corner_errors(data),
        "measures": draw_measure_charts(data),
        "fit_up": draw_fit_up(data),
        "profiles": draw_fitted_profiles(data),
        "steps": draw_scan_charts(data),
        "stations": read_stations_picture(data.directory),
    }
    stitching = data.stitching
    folders = (data.directory, *station_folders(data.directory, stitching).values())
    comparison = data.comparison
    return template.render(
        name=data.run_name,
        summary=data.summary,
        headline=list(headline_numbers(data)),
        scan_rows=list(scan_fact_rows(data)),
        findings=list(report_findings(data)),
        pictures=pictures,
        scene=view_data(data),
        drawings=draw_sections(data),
        fit_up=fit_up_table(data),
        drawn_sections=describe_drawings(data),
        comparison=comparison,
        compared_with="" if comparison is None else name_of_reference(comparison),
        aligned_by=ALIGNED["none" if comparison is None else comparison.alignment.method],
        deviations=deviation_table_rows(data),
        going=scan_statistics_rows(data),
        events=event_rows(data),
        stations=[] if stitching is None else station_rows(stitching),
        overlaps=[] if stitching is None else overlap_rows(stitching),
        measures=measure_rows(data),
        uncertainty=uncertainty_rows(data),
        provenance=Provenance.for_file_written_now(
            job_label_of_run(*folders), data.summary.frame
        ).header_entries,
    )
