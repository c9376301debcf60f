"""The numbers that a report begins with: what was asked for comes first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from tjscan.comparison.result import Comparison
from tjscan.report.data import ReportData
from tjscan.report.findings import describe_coverage
from tjscan.result.directory import JOINT


@dataclass(frozen=True, slots=True)
class HeadlineNumber:
    """A number of the headline: its text, what it says, and whether that is good or bad.

    Parameters
    ----------
    value, meaning : str
    judged : str
        ``good``, ``bad`` or nothing.
    """

    value: str
    meaning: str
    judged: Literal["", "good", "bad"] = ""


def headline_numbers(data: ReportData) -> Iterator[HeadlineNumber]:
    """Give the headline's numbers: the deviation where there is one, then the groove itself.

    Corners speak for a deviation, for a cloud's extremes are the laser's ghosts. Where a cloud
    alone was compared, the half of it that lies closest does.

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
        yield _deviation(data.comparison)
    yield HeadlineNumber(
        f"{summary.groove_length_mm:.0f} mm of groove",
        f"{summary.sections} sections, {describe_coverage(data)}",
    )
    yield HeadlineNumber(
        "complete" if summary.complete else "not complete",
        f"the scan did {'' if summary.complete else 'not do '}what was asked",
        "good" if summary.complete else "bad",
    )
    if summary.uncertainty is not None:
        corner = summary.uncertainty.combined.corner_mm
        yield HeadlineNumber(f"± {corner:.2f} mm", "standard uncertainty of a corner's place")


def name_of_reference(comparison: Comparison) -> str:
    """What a run was compared with, in words."""
    name = comparison.reference.name
    return "the joint as designed" if name == Path(JOINT).stem else name


def _deviation(comparison: Comparison) -> HeadlineNumber:
    reference = name_of_reference(comparison)
    corners = [d for d in comparison.deviations if d.kind.startswith("corners")]
    if corners:
        s = corners[0].statistics
        value, what = s.p95, f"95 % of the corners lie closer to {reference}; {s.mean:.2f} mean"
    else:
        value = 1e3 * float(np.median(np.abs(comparison.deviations[0].known)))
        what = f"half of the points lie closer to {reference}"
    if comparison.tolerance is None:
        return HeadlineNumber(f"{value:.2f} mm", what)
    verdict = "within" if comparison.passed else "OUTSIDE"
    return HeadlineNumber(
        f"{value:.2f} mm, {verdict}",
        f"the tolerance of {1e3 * comparison.tolerance:g} mm: {what}",
        "good" if comparison.passed else "bad",
    )
