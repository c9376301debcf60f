"""What a report says in tables: what was scanned, with what, and how it went."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from tjscan.core.provenance import FRAME_MEANING
from tjscan.joint.definition import JointDefinition
from tjscan.report.findings import coverage
from tjscan.report.material import Material, Place
from tjscan.report.stations import found_rows

MOST_EVENTS: Final = 200
"""Events that are listed; a run with more has other troubles."""


def scan_rows(material: Material) -> Iterator[tuple[str, str]]:
    """What was scanned, in pairs of name and value."""
    summary = material.summary
    if material.joint is not None:
        yield "joint as designed", _joint(material.joint)
    if material.stitching is not None:
        yield from found_rows(material.stitching)
    yield "covered", coverage(material)
    yield "sections", f"{summary.sections} from {summary.scans} profiles"
    yield "ended", summary.detail
    words = FRAME_MEANING.get(summary.frame, "")
    yield "coordinates", f"millimetres in frame {summary.frame}{words and ': ' + words}"
    for name, tell in PLACE_ROWS.items():
        told = [(place.name, tell(place)) for place in material.places]
        if len({value for _, value in told}) == 1:
            yield name, told[0][1]
        else:
            yield from ((f"{name}, {station}", value) for station, value in told)


def going_rows(material: Material) -> list[tuple[str, ...]]:
    """How the scan went: a row for each station, and one for all."""
    summary = material.summary
    parts = [(place.name, place.summary) for place in material.places]
    rows = [*parts] if len(parts) > 1 else []
    rows.append(("all" if rows else "scan", summary))
    told: list[tuple[str, ...]] = []
    for name, one in rows:
        step = "" if one.step_mm.mean is None else f"{one.step_mm.mean:.2f}"
        spread = "" if one.step_mm.std is None else f" ± {one.step_mm.std:.2f}"
        told.append(
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
    return told


def event_rows(material: Material) -> list[tuple[str, str, str, str]]:
    """When, where, what and how, of what was out of the ordinary."""
    rows = [
        (f"{event.time:%H:%M:%S}", place.name, event.name, event.detail)
        for place in material.places
        for event in place.log.events
    ]
    return rows[:MOST_EVENTS]


def _joint(joint: JointDefinition) -> str:
    leg, brace = 2e3 * joint.leg_radius, 2e3 * joint.brace_radius
    return (
        f"{joint.name}: leg {leg:g} × {1e3 * joint.leg_wall:g} mm, brace {brace:g} × "
        f"{1e3 * joint.brace_wall:g} mm, {np.degrees(joint.angle):g}° between them"
    )


def _when(place: Place) -> str:
    return "" if place.log.started is None else f"{place.log.started:%Y-%m-%d %H:%M} UTC"


def _devices(place: Place) -> str:
    job = place.job
    arm = f"arm {job.arm.device} ({job.arm.driver})"
    return f"{arm}, laser {job.laser.device} ({job.laser.driver})"


def _calibration(place: Place) -> str:
    found = place.calibration
    if found is None:
        return "stated in the job; its uncertainty is not known"
    return (
        f"{place.summary.calibration}, {found.lines} lines: sensor on the hand known to "
        f"{found.sigma_position_mm:.3f} mm and {found.sigma_rotation_deg:.4f}° (one sigma)"
    )


def _job(place: Place) -> str:
    scan = place.job.scan
    until = "to the end of its reach"
    if scan.length is not None:
        until = f"over {1e3 * scan.length:g} mm"
    if scan.sections is not None:
        until = f"{scan.sections} sections"
    return (
        f"{scan.direction}, {until}, steps of {1e3 * scan.step:g} mm, pull angle "
        f"{np.degrees(scan.pull_angle):g}°, stand-off {1e3 * scan.standoff:g} mm"
    )


PLACE_ROWS: Final = {
    "scanned": _when,
    "devices": _devices,
    "calibration": _calibration,
    "job": _job,
}
"""What is told of each place that was scanned from, once where it is the same for all."""
