"""``report.html``: one file that opens offline."""

from __future__ import annotations

from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from typing import Final

from jinja2 import Environment, StrictUndefined

from tjscan.core.version import VERSION
from tjscan.report.charts import draw_corner_errors, draw_measures, draw_steps, draw_view
from tjscan.report.deviation import deviation_rows, draw_deviation
from tjscan.report.findings import coverage, findings
from tjscan.report.material import Material
from tjscan.report.profiles import draw_profiles
from tjscan.report.stations import overlap_rows, station_rows, stations_picture
from tjscan.report.tables import event_rows, going_rows, scan_rows
from tjscan.result.directory import JOINT

TEMPLATE: Final = "report.html.jinja"
ALIGNED: Final = {"none": "", "joint": "the tubes of both", "icp": "nearest points"}
"""What brought what was measured onto its reference."""


def render(material: Material) -> str:
    """The whole page, pictures inlined.

    Everything that comes from files (names, reasons, events) is escaped.
    """
    # Escaping is on for all of it: names of jobs and joints are text, whatever they hold.
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = environment.from_string(
        files("tjscan.report").joinpath(TEMPLATE).read_text(encoding="utf-8")
    )
    pictures = {
        "view": draw_view(material),
        "deviation": draw_deviation(material),
        "corners": draw_corner_errors(material),
        "measures": draw_measures(material),
        "profiles": draw_profiles(material),
        "steps": draw_steps(material),
        "stations": stations_picture(material.directory),
    }
    told = material.stitching
    comparison = material.comparison
    return template.render(
        name=material.name,
        summary=material.summary,
        coverage=coverage(material),
        scan_rows=list(scan_rows(material)),
        findings=list(findings(material)),
        pictures=pictures,
        comparison=comparison,
        compared_with="the joint as designed"
        if comparison is None or comparison.reference.name == Path(JOINT).stem
        else comparison.reference.name,
        aligned_by=ALIGNED["none" if comparison is None else comparison.alignment.method],
        tolerance_mm=None
        if comparison is None or comparison.tolerance is None
        else 1e3 * comparison.tolerance,
        deviations=deviation_rows(material),
        going=going_rows(material),
        events=event_rows(material),
        stations=[] if told is None else station_rows(told),
        overlaps=[] if told is None else overlap_rows(told),
        version=VERSION,
        written=f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
    )
