"""What a reader has to know before relying on a run: gaps, half steps, what went wrong."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.comparison.compare import Comparison
from tjscan.groove.section import FROM_NEIGHBOURS
from tjscan.report.data import ReportData
from tjscan.result.chapter import HeadlineNumber, verdict_on
from tjscan.result.directory import JOINT_FILE
from tjscan.result.summary import LOOP_OPEN_TEXT, ScanSummary, StitchingReport

GAP_RATIO: Final = 2.5
"""Neighbouring sections farther apart than so many times the usual distance leave a gap."""

POOR_OVERLAP_CHI2: Final = 9.0
"""Reduced chi-squared of an overlap above which a finding states it: three times the errors."""

UNSURE_SIGMA_MM: Final = 0.2
"""Standard deviation of a corner's reading in mm above which a finding states it."""


def report_findings(data: ReportData) -> Iterator[str]:
    """Sentences that a reader of a report has to know first, the gravest first.

    Parameters
    ----------
    data : ReportData
        The run.

    Yields
    ------
    str
        A sentence each, the gravest first.
    """
    summary = data.summary
    if not summary.complete:
        yield f"The scan is not complete: {summary.detail}."
    if data.stitching is not None:
        yield from _stitching_findings(data.stitching)
        there = {place.name for place in data.places}
        missing = sorted({one.name for one in data.stitching.stations} - there)
        if missing:
            yield (
                f"The recordings of {', '.join(missing)} are not there any more: their "
                "profiles, events and calibration are not in this report."
            )
    yield from data.caveats
    if data.comparison is not None:
        yield from _comparison_findings(data.comparison)
    yield from _gap_findings(data)
    if summary.half_steps:
        times = "once" if summary.half_steps == 1 else f"{summary.half_steps} times"
        yield f"The groove was not found at the full step {times}, and sought at half of it."
    yield from _uncertain_corner_findings(data)
    for words in dict.fromkeys(words for place in data.places for words in place.findings):
        where = [place.name for place in data.places if words in place.findings]
        # What holds for every station is stated once, without a name.
        named = "" if len(where) == len(data.places) else f"Station {', '.join(where)}: "
        yield f"{named}{words}"


def _stitching_findings(report: StitchingReport) -> Iterator[str]:
    if report.covered_deg < 360 - 0.5:
        yield f"The stations cover {report.covered_deg:.0f}° without a gap, not all of the joint."
    elif report.loop_gap_after_mm is None:
        yield f"All of it was seen, but {LOOP_OPEN_TEXT}."
    for one in report.overlaps:
        if one.misfit > POOR_OVERLAP_CHI2:
            yield (
                f"Stations {' and '.join(one.stations)} fit at {one.azimuth_deg:.0f}° "
                f"{np.sqrt(one.misfit):.1f} times worse than their errors explain."
            )


def describe_coverage(data: ReportData) -> str:
    """Which part of the groove was scanned, in words.

    Parameters
    ----------
    data : ReportData
        The run.
    """
    azimuths = data.unwrapped_azimuths
    if azimuths is None:
        return f"azimuths are not known in frame {data.summary.frame}"
    if is_closed(data):
        return "all of it, 360°"
    low, high = azimuths.min(), azimuths.max()
    return f"{high - low:.0f}°, from azimuth {low:.0f}° to {high:.0f}°"


def is_closed(data: ReportData) -> bool:
    """Whether the sections of a run go all the way round the brace."""
    if data.unwrapped_azimuths is None or len(data.sections) < 3:
        return False
    azimuths = np.sort(np.mod(data.unwrapped_azimuths, 360))
    steps = np.diff(azimuths, append=azimuths[0] + 360)
    return bool(steps.max() <= max(GAP_RATIO * np.median(steps), 5.0))


def _comparison_findings(comparison: Comparison) -> Iterator[str]:
    if not comparison.passed and comparison.tolerance is not None:
        yield f"Outside the tolerance of {1e3 * comparison.tolerance:g} mm (95th percentile)."
    for deviation in comparison.deviations:
        if comparison.tolerance is None or not deviation.kind.startswith("corners"):
            continue
        over = int((deviation.known > comparison.tolerance).sum())
        if over:
            yield (
                f"{over} of {len(deviation.known)} corners are farther than "
                f"{1e3 * comparison.tolerance:g} mm from {comparison.reference.name}."
            )
    yield from (f"{warning[:1].upper()}{warning[1:]}." for warning in comparison.warnings)


def find_section_gaps(data: ReportData) -> dict[int, float]:
    """Millimetres between sections and the next ones, by place, where they leave a gap."""
    origins = np.array([section.T_r_g[:3, 3] for section in data.sections])
    steps = 1e3 * np.linalg.norm(np.diff(origins, axis=0), axis=1)
    if len(steps) < 3:
        return {}
    return {int(k): float(steps[k]) for k in np.flatnonzero(steps > GAP_RATIO * np.median(steps))}


def _gap_findings(data: ReportData) -> Iterator[str]:
    for k, step in find_section_gaps(data).items():
        first, second = data.sections[k], data.sections[k + 1]
        where = ""
        if not np.isnan(first.azimuth):
            a, b = np.degrees((first.azimuth, second.azimuth))
            where = f", azimuth {a:.0f}° to {b:.0f}°"
        yield f"Between two sections {step:.0f} mm of groove were not seen{where}."


def _uncertain_corner_findings(data: ReportData) -> Iterator[str]:
    # What all sections share has a chapter of its own.
    sigma = 1e3 * np.array([section.own_corner_sigmas.max() for section in data.sections])
    if (bad := int((sigma > UNSURE_SIGMA_MM).sum())) > 0:
        yield (
            f"In {bad} of {len(sigma)} sections a corner is read to worse than "
            f"{UNSURE_SIGMA_MM:g} mm (one standard deviation); the worst to {sigma.max():.2f} mm."
        )
    shown = sum(FROM_NEIGHBOURS in section.conditions for section in data.sections)
    if shown:
        yield (
            f"In {shown} of {len(sigma)} sections a corner contradicted its neighbours, and is "
            "given as these show it."
        )


def headline_numbers(data: ReportData) -> Iterator[HeadlineNumber]:
    """Give the headline's numbers: the deviation if there is one, then the groove itself.

    Corners speak for a deviation, for a cloud's extremes are the laser's ghosts. If a cloud
    alone was compared, the half of it that is closest does.

    Parameters
    ----------
    data : ReportData
        The run.

    Yields
    ------
    HeadlineNumber
        The one asked for first.
    """
    summary = data.summary
    if data.comparison is not None:
        yield _deviation_headline(data.comparison)
    yield HeadlineNumber(
        f"{summary.groove_length_mm:.0f} mm of groove",
        f"{summary.sections} sections, {describe_coverage(data)}",
    )
    yield from summary_headline(summary)


def summary_headline(summary: ScanSummary) -> Iterator[HeadlineNumber]:
    """Give what a summary alone says of the headline: the verdict, and how sure a corner is."""
    did = "did" if summary.complete else "did not do"
    yield verdict_on(summary.complete, f"the scan {did} what was asked")
    if summary.uncertainty is not None:
        corner = summary.uncertainty.combined.corner_mm
        yield HeadlineNumber(f"± {corner:.2f} mm", "standard uncertainty of a corner's place")


def name_of_reference(comparison: Comparison) -> str:
    """What a run was compared with, in words."""
    name = comparison.reference.name
    return "the joint as designed" if name == Path(JOINT_FILE).stem else name


def _deviation_headline(comparison: Comparison) -> HeadlineNumber:
    reference = name_of_reference(comparison)
    corners = [d for d in comparison.deviations if d.kind.startswith("corners")]
    if corners:
        s = corners[0].statistics
        value, what = s.p95, f"95 % of the corners are closer to {reference}; {s.mean:.2f} mean"
    else:
        value = 1e3 * float(np.median(np.abs(comparison.deviations[0].known)))
        what = f"half of the points are closer to {reference}"
    if comparison.tolerance is None:
        return HeadlineNumber(f"{value:.2f} mm", what)
    verdict = "within" if comparison.passed else "OUTSIDE"
    return HeadlineNumber(
        f"{value:.2f} mm, {verdict}",
        f"the tolerance of {1e3 * comparison.tolerance:g} mm: {what}",
        "good" if comparison.passed else "bad",
    )
