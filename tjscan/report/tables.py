"""What a report states of what was scanned, and with what."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tjscan.core.provenance import FRAME_DESCRIPTIONS
from tjscan.joint.definition import JointDefinition
from tjscan.report.data import ReportData
from tjscan.report.findings import describe_coverage
from tjscan.result.section import MEASURE_FIELDS, SIGMA_FIELDS
from tjscan.result.stitching import StitchingReport


def scan_fact_rows(data: ReportData) -> Iterator[tuple[str, str]]:
    """Rows of name and value: joint, groove, coverage, sections and how the scan ended."""
    summary = data.summary
    if data.joint is not None:
        yield "joint as designed", _joint_in_words(data.joint)
    if data.stitching is not None:
        yield from tube_rows(data.stitching)
    yield "groove", f"{summary.groove_length_mm:.0f} mm long"
    yield "covered", describe_coverage(data)
    yield "sections", f"{summary.sections} from {summary.scans} profiles"
    yield "ended", summary.detail
    words = FRAME_DESCRIPTIONS.get(summary.frame, "")
    yield "coordinates", f"millimetres in frame {summary.frame}{words and ': ' + words}"
    for name in dict.fromkeys(name for place in data.places for name in place.facts):
        values = {place.name: place.facts.get(name, "") for place in data.places}
        if len(set(values.values())) == 1:
            yield name, next(iter(values.values()))
        else:
            yield from ((f"{name}, {station}", value) for station, value in values.items())


def measure_rows(data: ReportData) -> list[tuple[str, ...]]:
    """A row for each measure of the groove: smallest, mean, largest, median standard deviation.

    Parameters
    ----------
    data : ReportData
        The run.
    """
    table = []
    for field, sigma in zip(MEASURE_FIELDS, SIGMA_FIELDS, strict=True):
        values = field.values(data.sections)
        spread = np.median(sigma.values(data.sections))
        numbers = (f"{value:.2f}" for value in (values.min(), values.mean(), values.max()))
        table.append((field.chart_title, *numbers, f"{spread:.2g}"))
    return table


def tube_rows(report: StitchingReport) -> Iterator[tuple[str, str]]:
    """Diameters, angle and offset of the tubes that stitching found, and how the loop closes.

    Parameters
    ----------
    report : StitchingReport
        How the stations were stitched.

    Yields
    ------
    (str, str)
        What it is, and its value with two standard deviations.
    """
    for name, value, sigma in (
        ("leg", report.leg_diameter_mm, report.sigma_leg_diameter_mm),
        ("brace", report.brace_diameter_mm, report.sigma_brace_diameter_mm),
    ):
        yield f"{name} as found", f"{value:.2f} mm wide (± {2 * sigma:.2f}, two sigma)"
    yield (
        "axes as found",
        f"{report.angle_deg:.3f}° between them (± {2 * report.sigma_angle_deg:.3f}), "
        f"{report.offset_mm:.2f} mm apart (± {2 * report.sigma_offset_mm:.2f})",
    )
    if report.loop_gap_after_mm is not None and report.loop_gap_before_mm is not None:
        yield (
            "loop",
            f"closes to {report.loop_gap_after_mm:.3f} mm; "
            f"{report.loop_gap_before_mm:.3f} mm before it was closed",
        )


def _joint_in_words(joint: JointDefinition) -> str:
    leg, brace = 2e3 * joint.leg_radius, 2e3 * joint.brace_radius
    return (
        f"{joint.name}: leg {leg:g} × {1e3 * joint.leg_wall:g} mm, brace {brace:g} × "
        f"{1e3 * joint.brace_wall:g} mm, {np.degrees(joint.angle):g}° between them"
    )
