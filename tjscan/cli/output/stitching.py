"""What ``tjscan stitch`` prints."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from tjscan.cli.output.console import print_fields, print_json, print_message
from tjscan.result.stitching import LOOP_OPEN, StitchingReport
from tjscan.result.summary import ScanSummary, uncertainty_lines
from tjscan.runs.stations.stitch import StitchedRun

NOTED_MM = 0.05
"""Tubes less out of round than this are not reported."""


def print_stitched_groove(done: StitchedRun, directory: Path, *, json: bool) -> None:
    """Print a stitched groove on stderr: stations, overlaps, totals; or JSON on stdout."""
    if json:
        print_json({"summary": done.summary, "stitching": done.report})
        return
    print_fields(_lines(done.summary, done.report))
    print_message(
        f"written to {directory}; see report.html, and stations.json for how it was stitched"
    )


def _lines(summary: ScanSummary, report: StitchingReport) -> Iterator[tuple[str, str]]:
    first = report.stations[0]
    for one in report.stations:
        start, end = one.azimuth_deg
        off = (
            ""
            if one is first
            else f"; seen from {first.name}, its base is {one.nominal_off_mm:.0f} mm and "
            f"{one.nominal_off_deg:.1f}° from where it was meant to"
        )
        yield (
            f"station {one.name}",
            f"{one.sections} sections from {start:.0f}° to {end:.0f}°, groove placed to "
            f"{one.sigma_groove_mm:.3f} mm{off}",
        )
    for edge in report.overlaps:
        yield (
            f"overlap {' + '.join(edge.stations)}",
            f"{edge.arc_deg:.0f}° at {edge.azimuth_deg:.0f}°: residuals {edge.residual_rms_mm:.3f} "
            f"mm, gap {edge.gap_mm:.3f} mm",
        )
    if report.loop_gap_before_mm is not None and report.loop_gap_after_mm is not None:
        yield (
            "loop gap",
            f"{report.loop_gap_before_mm:.3f} mm, closed {report.loop_gap_after_mm:.3f} mm",
        )
    else:
        yield "loop", LOOP_OPEN
    yield "covered", f"{report.covered_deg:.0f}°, {summary.sections} sections"
    yield (
        "diameters",
        f"brace {report.brace_diameter_mm:.2f} ± {report.sigma_brace_diameter_mm:.2f} mm, "
        f"leg {report.leg_diameter_mm:.2f} ± {report.sigma_leg_diameter_mm:.2f} mm",
    )
    if report.out_of_round_mm > NOTED_MM:
        yield (
            "out of round",
            f"tubes bulge by some {report.out_of_round_mm:.2f} mm: frame j is that uncertain, the "
            "overlaps hold the stations together",
        )
    if (error := summary.corner_error_mm) is not None:
        yield "corner error", f"{error.mean:.3f} mm mean, {error.p95:.3f} p95, {error.max:.3f} max"
    yield from uncertainty_lines(summary)
