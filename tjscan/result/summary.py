"""``summary.json``: a scan in a few numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final, Self

import numpy as np
from pydantic_core import to_json as to_json_bytes

from tjscan.comparison.distance import DistanceStatistics
from tjscan.core.config import read_json_as_written
from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.groove.measured import MeasuredSection
from tjscan.result.section import lengths_along_groove
from tjscan.uncertainty.budget import BudgetSummary, budget_in_words

MOST_SUMMARY_BYTES: Final = 1_000_000
"""A larger file is no summary."""


SUMMED_KEYS: Final = (
    "scans",
    "half_steps",
    "flange_travel_mm",
    "flange_rotation_deg",
    "motion_time_s",
    "corrections_skipped",
    "taken_again",
    "merged",
    "nudges",
    "retreats",
)
"""Numbers of a stitched groove that are sums over its stations."""


@dataclass(frozen=True, slots=True)
class StepStatistics:
    """Nominal, mean and standard deviation of a scan's steps, in millimetres.

    Parameters
    ----------
    nominal : float
        As asked.
    mean, std : float or None
        As measured between groove origins; None without a step.
    """

    nominal: float
    mean: float | None
    std: float | None

    @classmethod
    def from_steps(cls, nominal: float, steps: Array) -> Self:
        """Compute the statistics of steps, shape (n,) in millimetres.

        Parameters
        ----------
        nominal : float
            As asked, millimetres.
        steps : ndarray, shape (n,)
            As measured, millimetres.
        """
        mean = float(steps.mean()) if len(steps) else None
        return cls(nominal, mean, float(steps.std(ddof=1)) if len(steps) > 1 else None)


@dataclass(frozen=True, slots=True)
class StationSummary:
    """Summary of one station's scan in a few numbers; for the parameters see `ScanSummary`."""

    name: str
    sections: int
    scans: int
    complete: bool
    stopped_because: str
    detail: str
    half_steps: int
    flange_travel_mm: float
    flange_rotation_deg: float
    motion_time_s: float
    calibration: str


@dataclass(frozen=True, slots=True)
class ScanSummary:
    """A scan in a few numbers; travel, rotation and time run from the second taught pose on.

    Parameters
    ----------
    sections, scans : int
        Finished sections, and profiles taken.
    complete : bool
        Whether the scan did what was asked.
    stopped_because, detail : str
        Why the scan ended, short and in one sentence.
    frame : str
        Letter of the frame of ``sections.csv`` and ``groove.ply``: j or b.
    groove_length_mm : float
        Length of the chain of groove origins, the step between the taught ones included.
    half_steps : int
        How often a section was tried again at half the step; these count in `step_mm`.
    step_mm : StepStatistics
        Nominal and measured step.
    flange_travel_mm, flange_rotation_deg : float
        Summed over all moves of the flange.
    motion_time_s : float
        On the arm's clock.
    corner_error_mm : DistanceStatistics or None
        Distance of p2, p3, p4 to the joint's feature edges; None if no joint is named.
    calibration : str
        Where the sensor's pose on the flange comes from.
    stations : tuple of StationSummary
        The places it was scanned from; empty if that was one. Numbers of the whole are then
        sums over them, or hold for the stitched groove.
    scans_per_section : float or None
        Profiles for each section that was not taught; None without one.
    corrections_skipped : int
        Sections whose prediction view was good enough.
    taken_again, merged, nudges, retreats : int
        How often each remedy was tried, see `tjscan.scanning.events.RetryCounts`.
    uncertainty : BudgetSummary or None
        Where the uncertainty of its corners and measures comes from; None in older files.
    provenance : Provenance or None
        Of the file that holds it; None before it is written, and in files of version 0.1.0.
    """

    sections: int
    scans: int
    complete: bool
    stopped_because: str
    detail: str
    frame: str
    groove_length_mm: float
    half_steps: int
    step_mm: StepStatistics
    flange_travel_mm: float
    flange_rotation_deg: float
    motion_time_s: float
    corner_error_mm: DistanceStatistics | None
    calibration: str = ""
    stations: tuple[StationSummary, ...] = ()
    scans_per_section: float | None = None
    corrections_skipped: int = 0
    taken_again: int = 0
    merged: int = 0
    nudges: int = 0
    retreats: int = 0
    uncertainty: BudgetSummary | None = None
    provenance: Provenance | None = None


def summarise_stations(
    parts: Mapping[str, ScanSummary],
    sections: Sequence[MeasuredSection],
    frame: str,
    corner_error: Array | None = None,
    *,
    closed: bool = False,
    uncertainty: BudgetSummary | None = None,
) -> ScanSummary:
    """Summarise a stitched groove from the summaries of its stations.

    Parameters
    ----------
    parts : mapping of str to ScanSummary
        Each station's own summary, by its name; one at least.
    sections : sequence of MeasuredSection
        The stitched sections, in the order along the groove.
    frame : str
        Letter of their frame.
    corner_error : ndarray, optional
        As of `summarise_scan`.
    closed : bool
        Whether the way round closes: a step leads from the last section to the first, too.
    uncertainty : BudgetSummary, optional
        Where their uncertainty comes from.
    """
    steps = np.diff(1e3 * lengths_along_groove([*sections, *sections[:1]] if closed else sections))
    all_parts = list(parts.values())
    return ScanSummary(
        sections=len(sections),
        complete=all(part.complete for part in all_parts),
        stopped_because=_each_once(part.stopped_because for part in all_parts),
        detail=_detail(parts),
        frame=frame,
        groove_length_mm=float(steps.sum()),
        step_mm=StepStatistics.from_steps(all_parts[0].step_mm.nominal, steps),
        corner_error_mm=None
        if corner_error is None
        else DistanceStatistics.from_distances(corner_error),
        calibration=_each_once(part.calibration for part in all_parts),
        stations=tuple(_station(name, part) for name, part in parts.items()),
        scans_per_section=_mean_scans(all_parts),
        uncertainty=uncertainty,
        **{name: sum(getattr(part, name) for part in all_parts) for name in SUMMED_KEYS},
    )


def _each_once(words: Iterable[str]) -> str:
    return ", ".join(dict.fromkeys(words))


def _detail(parts: Mapping[str, ScanSummary]) -> str:
    """What each station reports that did not do what was asked."""
    bad = [f"{name}: {part.detail}" for name, part in parts.items() if not part.complete]
    return "; ".join(bad) or f"{len(parts)} stations did what was asked"


def _mean_scans(parts: Sequence[ScanSummary]) -> float | None:
    """Profiles for each section that was not taught, two of each station being taught."""
    found = [p for p in parts if p.scans_per_section is not None]
    sections = sum(part.sections - 2 for part in found)
    scans = sum((part.scans_per_section or 0.0) * (part.sections - 2) for part in found)
    return scans / sections if sections else None


def _station(name: str, part: ScanSummary) -> StationSummary:
    shared = {field.name for field in fields(StationSummary)} - {"name"}
    return StationSummary(name, **{key: getattr(part, key) for key in shared})


def read_summary(file: Path) -> ScanSummary:
    """Read ``summary.json``.

    Raises
    ------
    ConfigurationError
        If it is missing, or is no summary.
    RecordingError
        If it is not as it was written.
    """
    return read_json_as_written(ScanSummary, file, MOST_SUMMARY_BYTES, "summary of a scan")


def check_recording_complete(directory: Path, summary: ScanSummary, sections: int) -> None:
    """Refuse a recording that was cut short since its scan was summarised.

    Raises
    ------
    RecordingError
        If it holds fewer sections than the summary states.
    """
    if sections < summary.sections:
        raise RecordingError(
            f"{directory}: its recording holds {sections} sections, its summary "
            f"{summary.sections}: it was cut short or damaged since. Put back a copy of it"
        )


def summary_to_json(summary: ScanSummary) -> str:
    """The summary as JSON text."""
    return to_json_bytes(summary, indent=2).decode()


def write_summary(file: Path, summary: ScanSummary) -> None:
    """Write ``summary.json``."""
    file.write_text(summary_to_json(summary) + "\n", encoding="utf-8")


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
