"""A scan's summary in words, a name and a text for each line."""

from __future__ import annotations

from collections.abc import Iterator

from tjscan.result.summary import ScanSummary
from tjscan.uncertainty.summary import budget_in_words


def summary_in_words(summary: ScanSummary) -> Iterator[tuple[str, str]]:
    """Why the scan ended, and its numbers with their units."""
    step, error = summary.step_mm, summary.corner_error_mm
    yield "stopped because", summary.detail
    yield "sections", f"{summary.sections} from {summary.scans} profiles"
    yield "groove length", f"{summary.groove_length_mm:.1f} mm"
    if step.mean is not None:
        spread = "" if step.std is None else f" ± {step.std:.2f}"
        yield "step", f"{step.mean:.2f}{spread} mm, {step.nominal:g} mm asked"
    yield "flange", f"{summary.flange_travel_mm:.0f} mm, {summary.flange_rotation_deg:.0f}°"
    yield "motion time", f"{summary.motion_time_s:.1f} s"
    if error is not None:
        yield "corner error", f"{error.mean:.3f} mm mean, {error.p95:.3f} p95, {error.max:.3f} max"
    yield from uncertainty_lines(summary)


def uncertainty_lines(summary: ScanSummary) -> Iterator[tuple[str, str]]:
    """How sure the corners are, and what is not counted; nothing for older runs."""
    if (budget := summary.uncertainty) is not None:
        yield "uncertainty", budget_in_words(budget)
        for words in budget.left_out:
            yield "not counted", words
