"""What a report shows in tables: what was scanned, with what, and how it went."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from tjscan.core.provenance import FRAME_DESCRIPTIONS
from tjscan.joint.definition import JointDefinition
from tjscan.report.data import ReportData
from tjscan.report.findings import describe_coverage
from tjscan.report.stations import tube_rows
from tjscan.result.section import MEASURE_FIELDS, SIGMA_FIELDS

MOST_EVENTS: Final = 200
"""Events that are listed; a run with more has other troubles."""


def scan_fact_rows(data: ReportData) -> Iterator[tuple[str, str]]:
    """Rows of name and value: joint, groove, coverage, sections and how the scan ended."""
    summary = data.summary
    if data.joint is not None:
        yield "joint as designed", _joint(data.joint)
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


def uncertainty_rows(data: ReportData) -> list[tuple[str, ...]]:
    """A row for each component of the uncertainty, one for all combined, and one expanded.

    Parameters
    ----------
    data : ReportData
        The run; one of an earlier version has no rows.
    """
    budget = data.summary.uncertainty
    if budget is None:
        return []
    rows = [
        *((one, "all alike" if one.shared else "each by itself") for one in budget.components),
        (budget.combined, ""),
        (budget.expanded, ""),
    ]
    return [
        (
            one.name,
            one.evidence,
            shared,
            f"{one.corner_mm:.3f}",
            f"{one.groove_angle_deg:.3f}",
            f"{one.root_width_mm:.3f}",
            f"{one.depth_mm:.3f}",
            f"{one.area_mm2:.2f}",
        )
        for one, shared in rows
    ]


def scan_statistics_rows(data: ReportData) -> list[tuple[str, ...]]:
    """How the scan went: a row for each station, and one for all."""
    summary = data.summary
    parts = [(place.name, place.summary) for place in data.places]
    rows = [*parts] if len(parts) > 1 else []
    rows.append(("all" if rows else "scan", summary))
    table: list[tuple[str, ...]] = []
    for name, one in rows:
        step = "" if one.step_mm.mean is None else f"{one.step_mm.mean:.2f}"
        spread = "" if one.step_mm.std is None else f" ± {one.step_mm.std:.2f}"
        table.append(
            (
                name,
                str(one.sections),
                str(one.scans),
                f"{one.step_mm.nominal:g}",
                f"{step}{spread}",
                str(one.half_steps),
                f"{one.flange_travel_mm:.0f}",
                f"{one.flange_rotation_deg:.0f}",
                f"{one.motion_time_s:.1f}",
                one.stopped_because,
            )
        )
    return table


def event_rows(data: ReportData) -> list[tuple[str, str, str, str]]:
    """Rows of the run's events: when, where, what and how."""
    rows = [
        (f"{event.time:%H:%M:%S}", place.name, event.name, event.detail)
        for place in data.places
        for event in place.events
    ]
    return rows[:MOST_EVENTS]


def _joint(joint: JointDefinition) -> str:
    leg, brace = 2e3 * joint.leg_radius, 2e3 * joint.brace_radius
    return (
        f"{joint.name}: leg {leg:g} × {1e3 * joint.leg_wall:g} mm, brace {brace:g} × "
        f"{1e3 * joint.brace_wall:g} mm, {np.degrees(joint.angle):g}° between them"
    )
