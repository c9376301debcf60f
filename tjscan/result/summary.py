"""``summary.json`` and ``stations.json``: a scan in few numbers, and how stations were stitched."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from pydantic_core import to_json

from tjscan.comparison.distance import DistanceStatistics
from tjscan.core.config import read_unaltered_json
from tjscan.core.errors import ConfigurationError, RecordingError
from tjscan.core.frames import Array, pose_from_euler_zyx
from tjscan.core.provenance import Provenance
from tjscan.core.units import DEG, MM, MM2
from tjscan.groove.measured import MeasuredSection
from tjscan.result.directory import STATIONS_FILE
from tjscan.result.section import lengths_along_groove
from tjscan.uncertainty.budget import (
    COVERAGE_FACTOR,
    BudgetComponent,
    BudgetSummary,
    UncertaintyBudget,
    budget_in_words,
)

MOST_SUMMARY_BYTES: Final = 1_000_000
"""A larger file is no summary."""


MOST_STITCHING_REPORT_BYTES: Final = 1_000_000
"""A larger file reports no stitching."""

LOOP_OPEN_TEXT: Final = (
    "no overlap closes the way round, so that how well its two ends meet is not known"
)
"""What is reported if there is no loop gap."""

Triple = tuple[float, float, float]

SUMMED_SUMMARY_KEYS: Final = (
    "scans",
    "half_steps",
    "corrections_skipped",
    "taken_again",
    "merged",
    "nudges",
    "retreats",
    "stepwise",
    "flange_travel_mm",
    "flange_rotation_deg",
    "motion_time_s",
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
    taken_again, merged, nudges, retreats, stepwise : int
        How often each remedy was tried, see `tjscan.scanning.journal.RetryCounts`.
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
    stepwise: int = 0
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
    error = None if corner_error is None else DistanceStatistics.from_distances(corner_error)
    # Two sections of each station are taught: no profile was taken for them.
    scanned = [one for one in all_parts if one.scans_per_section is not None]
    untaught = sum(one.sections - 2 for one in scanned)
    scans = sum((one.scans_per_section or 0.0) * (one.sections - 2) for one in scanned)
    bad = [f"{name}: {part.detail}" for name, part in parts.items() if not part.complete]
    shared = [field.name for field in fields(StationSummary) if field.name != "name"]
    return ScanSummary(
        sections=len(sections),
        complete=all(part.complete for part in all_parts),
        stopped_because=", ".join(dict.fromkeys(part.stopped_because for part in all_parts)),
        detail="; ".join(bad) or f"{len(parts)} stations did what was asked",
        frame=frame,
        groove_length_mm=float(steps.sum()),
        step_mm=StepStatistics.from_steps(all_parts[0].step_mm.nominal, steps),
        corner_error_mm=error,
        calibration=", ".join(dict.fromkeys(part.calibration for part in all_parts)),
        stations=tuple(
            StationSummary(name, **{key: getattr(part, key) for key in shared})
            for name, part in parts.items()
        ),
        scans_per_section=scans / untaught if untaught else None,
        uncertainty=uncertainty,
        **{name: sum(getattr(part, name) for part in all_parts) for name in SUMMED_SUMMARY_KEYS},
    )


def read_summary(file: Path) -> ScanSummary:
    """Read ``summary.json``.

    Raises
    ------
    ConfigurationError
        If it is missing, or is no summary.
    RecordingError
        If it is not as it was written.
    """
    return read_unaltered_json(ScanSummary, file, MOST_SUMMARY_BYTES, "summary of a scan")


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
    return to_json(summary, indent=2).decode()


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


@dataclass(frozen=True, slots=True)
class StationPlacement:
    """Where stitching placed a station, how sure that is, and what the station saw.

    Parameters
    ----------
    name, source : str
        Which, and its run directory, seen from the stitched run's.
    position_mm, euler_zyx_deg : tuple of float
        Its base in frame j.
    sigma_position_mm, sigma_rotation_deg : tuple of float
        Standard deviations along and about the axes of j, about its origin.
    sigma_groove_mm : float
        By how much its groove may be wrong as a whole, root mean square of three directions.
    azimuth_deg : tuple of float
        From where to where it saw.
    sections, views : int
        Finished sections, and views in which a groove was read.
    nominal_off_mm, nominal_off_deg : float
        How far its nominal pose is off, measured from the first station; 0 for that.
    walls_rms_mm, walls_misfit : float
        Of its wall points about leg and brace: distance, and chi-squared per degree of freedom.
    """

    name: str
    source: str
    position_mm: Triple
    euler_zyx_deg: Triple
    sigma_position_mm: Triple
    sigma_rotation_deg: Triple
    sigma_groove_mm: float
    azimuth_deg: tuple[float, float]
    sections: int
    views: int
    nominal_off_mm: float
    nominal_off_deg: float
    walls_rms_mm: float
    walls_misfit: float

    @property
    def T_j_b(self) -> Array:
        """Pose of its base in frame j, shape (4, 4), metres."""
        return pose_from_euler_zyx(
            1e-3 * np.array(self.position_mm), np.radians(self.euler_zyx_deg)
        )


@dataclass(frozen=True, slots=True)
class OverlapReport:
    """How well two stations fit each other where they overlap.

    Parameters
    ----------
    stations : tuple of str
        Both names.
    azimuth_deg, arc_deg : float
        Its middle and its length.
    sections : tuple of int
        How many each has there.
    views : int
        That were registered.
    left_out : int
        Of these, views whose weight in the robust fit is small: outliers.
    residual_rms_mm, misfit : float
        Of the corners about one smooth groove: size, and chi-squared per degree of freedom.
    sigma_mm : float
        How uncertain the overlap alone leaves the second station's place there, root mean square
        of three directions.
    covariance : tuple of tuple of float
        Of the second station's pose on the first, translation (mm) and rotation vector (degrees)
        in j, from the overlap alone.
    gap_mm : float
        How far apart the placed stations see the groove there, across it.
    """

    stations: tuple[str, str]
    azimuth_deg: float
    arc_deg: float
    sections: tuple[int, int]
    views: int
    left_out: int
    residual_rms_mm: float
    misfit: float
    sigma_mm: float
    covariance: tuple[tuple[float, ...], ...]
    gap_mm: float


@dataclass(frozen=True, slots=True)
class StitchingReport:
    """How stations were stitched, as ``stations.json`` holds it.

    Parameters
    ----------
    frame : str
        j, found from leg and brace.
    covered_deg : float
        Azimuth without a gap.
    brace_diameter_mm, leg_diameter_mm, angle_deg, offset_mm : float
        What the tubes are like: the angle between their axes, and how far these pass each other.
    sigma_brace_diameter_mm, sigma_leg_diameter_mm, sigma_angle_deg, sigma_offset_mm : float
        Standard deviations of these.
    out_of_round_mm : float
        How far the tubes' walls were taken to bulge from circles.
    loop_gap_before_mm, loop_gap_after_mm : float or None
        Largest gap across the groove if the way round closes: with the stations chained by
        their overlaps, and in the end. None if it does not close.
    stations : tuple of StationPlacement
        By name.
    overlaps : tuple of OverlapReport
        Every one that was used.
    provenance : Provenance or None
        Of the file that holds it; None in files of version 0.1.0.
    """

    frame: str
    covered_deg: float
    brace_diameter_mm: float
    leg_diameter_mm: float
    angle_deg: float
    offset_mm: float
    sigma_brace_diameter_mm: float
    sigma_leg_diameter_mm: float
    sigma_angle_deg: float
    sigma_offset_mm: float
    out_of_round_mm: float
    loop_gap_before_mm: float | None
    loop_gap_after_mm: float | None
    stations: tuple[StationPlacement, ...]
    overlaps: tuple[OverlapReport, ...]
    provenance: Provenance | None = None


def write_stitching_report(file: Path, report: StitchingReport) -> None:
    """Write ``stations.json``."""
    file.write_bytes(to_json(report, indent=2) + b"\n")


def read_stitching_report(directory: Path) -> StitchingReport | None:
    """Read ``stations.json`` of a stitched run.

    Parameters
    ----------
    directory : Path
        The run directory.

    Returns
    -------
    StitchingReport or None
        None if it was scanned from one place, and not stitched.

    Raises
    ------
    ConfigurationError
        If its ``stations.json`` is damaged.
    RecordingError
        If it is not as it was written.
    """
    file = directory / STATIONS_FILE
    if not file.is_file():
        return None
    return read_unaltered_json(
        StitchingReport, file, MOST_STITCHING_REPORT_BYTES, "report of a stitching"
    )


MOST_BUDGET_BYTES: Final = 100_000_000
"""A larger file is no budget: a section takes some ten kilobytes."""

SIGNIFICANT_DIGITS: Final = 6
"""Of the largest number of a component."""

_MEASURE_UNITS: Final = np.array((DEG.factor, MM.factor, MM.factor, MM2.factor))


@dataclass(frozen=True, slots=True)
class ComponentInFile:
    """A component in the file."""

    name: str
    evidence: str
    shared: bool
    points_mm: list[list[list[list[float]]]]
    measures: list[list[list[float]]]


@dataclass(frozen=True, slots=True)
class BudgetFile:
    """The file: how p1 to p5 (millimetres) and the measures (degrees, mm, mm²) answer to draws."""

    provenance: Provenance | None
    coverage_factor: float
    components: list[ComponentInFile]


def write_budget(file: Path, budget: UncertaintyBudget, provenance: Provenance) -> None:
    """Write ``uncertainty.json``: the whole of a budget, so that correlations can be computed."""
    components = []
    for one in budget.components:
        values = one.points / MM.factor, one.measures / _MEASURE_UNITS[:, None]
        lists = map(_rounded_lists, values)
        components.append(ComponentInFile(one.name, one.evidence, one.is_shared, *lists))
    file.write_bytes(to_json(BudgetFile(provenance, COVERAGE_FACTOR, components)) + b"\n")


def _rounded_lists(values: Array) -> Any:
    """Values to so many digits, as nested lists."""
    size = np.abs(values).max(initial=0.0)
    decimals = SIGNIFICANT_DIGITS - int(np.floor(np.log10(size))) if size > 0 else 0
    return np.round(values, decimals).tolist()


def read_budget(file: Path, count: int) -> UncertaintyBudget | None:
    """Read ``uncertainty.json``; None if a run has none, as one of an earlier version.

    Parameters
    ----------
    file : Path
        The file.
    count : int
        Sections of the run.

    Raises
    ------
    ConfigurationError
        If it is damaged, or of other sections.
    """
    if not file.is_file():
        return None
    found = read_unaltered_json(BudgetFile, file, MOST_BUDGET_BYTES, "budget of uncertainty")
    parts = []
    with suppress(ValueError):
        for one in found.components:
            points = np.reshape(one.points_mm, (count, 5, 3, -1)) * MM.factor
            measures = np.reshape(one.measures, (count, 4, -1)) * _MEASURE_UNITS[:, None]
            parts.append(BudgetComponent(one.name, one.evidence, one.shared, points, measures))
    alike = (one.points.shape[-1] == one.measures.shape[-1] for one in parts)
    if not parts or len(parts) < len(found.components) or not all(alike):
        raise ConfigurationError(f"is not of the {count} sections beside it", file=file)
    return UncertaintyBudget(tuple(parts))
