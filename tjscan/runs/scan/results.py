"""From what a scan found to the numbers and files of its run directory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tjscan.calibration.file import read_calibration
from tjscan.comparison.distance import DistanceStatistics, corner_to_edge_distances
from tjscan.core.files import write_files_atomically
from tjscan.core.frames import (
    Array,
    JointOrBaseFrame,
    rotation_angle_between,
    transform_points,
)
from tjscan.core.provenance import Provenance
from tjscan.groove.measured import MeasuredSection, section_to_result_frame
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import feature_edges
from tjscan.result import directory as run_files
from tjscan.result.picture import write_png
from tjscan.result.section import absent_corners
from tjscan.result.summary import ScanSummary, StepStatistics, write_budget, write_summary
from tjscan.result.table import GrooveCloud, write_cloud_ply, write_sections_csv, write_smoothed_csv
from tjscan.scanning import journal
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import ProfileView, ScannedSection, Substep
from tjscan.uncertainty.budget import BudgetSummary, UncertaintyBudget


def write_run_results(
    directory: Path,
    sections: Sequence[MeasuredSection],
    cloud: GrooveCloud,
    summary: ScanSummary,
    picture: Any,
    job: str,
    budget: UncertaintyBudget,
    smoothed: Array | None = None,
) -> ScanSummary:
    """Write sections, cloud, picture, uncertainty budget and summary of a run, all or none.

    Parameters
    ----------
    directory : Path
        The run directory.
    sections : sequence of MeasuredSection
        In the frame that the summary names, in the order along the groove.
    cloud : GrooveCloud
        The groove's points in the same frame.
    summary : ScanSummary
        The rest in a few numbers.
    picture : matplotlib Figure
        See `draw_groove_overview`.
    job : str
        The job that all of it comes from, see `job_label_of_run`.
    budget : UncertaintyBudget
        Of the sections.
    smoothed : ndarray, shape (n, 3, 3), optional
        Their corners smoothed along the groove, metres, in the same frame; of a continuous scan.

    Returns
    -------
    ScanSummary
        With the provenance of its file.

    Raises
    ------
    RecordingError
        If a file can't be written.
    """
    provenance = Provenance.for_file_written_now(job, summary.frame)
    summary = replace(summary, provenance=provenance)
    with write_files_atomically(directory, last=run_files.SUMMARY_FILE, listed=True) as draft:
        write_sections_csv(draft / run_files.SECTIONS_FILE, sections, provenance)
        if smoothed is not None:
            write_smoothed_csv(draft / run_files.SMOOTHED_FILE, sections, smoothed, provenance)
        write_cloud_ply(draft / run_files.CLOUD_FILE, cloud, provenance)
        write_png(draft / run_files.SCAN_PICTURE, picture, provenance)
        write_budget(draft / run_files.BUDGET_FILE, budget, provenance)
        write_summary(draft / run_files.SUMMARY_FILE, summary)
    return summary


def calibration_label(directory: Path) -> str:
    """Which calibration a run was made with, or that its job states the sensor's pose.

    Raises
    ------
    ConfigurationError
        If the ``calibration.toml`` in the run directory can't be read.
    """
    file = directory / run_files.CALIBRATION_FILE
    if not file.is_file():
        return f"T_f_s_mm in {run_files.JOB_FILE}"
    found = read_calibration(file)
    return f"{found.arm} with {found.laser}, {found.date:%Y-%m-%d %H:%M}"


def sections_in_result_frame(
    sections: Sequence[ScannedSection], frame: JointOrBaseFrame, station: str = "1"
) -> tuple[MeasuredSection, ...]:
    """Transform every finished section into the frame of the result."""
    transform = partial(section_to_result_frame, frame=frame.letter, station=station)
    return tuple(
        transform(scan.groove, frame.T_r_b @ scan.view.T_b_s, index=scan.view.index)
        for scan in sections
    )


def cloud_of_sections(sections: Sequence[ScannedSection], frame: JointOrBaseFrame) -> GrooveCloud:
    """All profile points of the sections, in the result's frame."""
    return GrooveCloud.joined([_cloud_of_section(scan, frame) for scan in sections])


def _cloud_of_section(scan: ScannedSection, frame: JointOrBaseFrame) -> GrooveCloud:
    """Profile points of a section; a side's normal is across its chord and the groove."""
    T, points, groove = frame.T_r_b @ scan.view.T_b_s, scan.view.profile.points_s, scan.groove
    # The wall is at high x_s; a corner that is not seen parts nothing.
    sides = (groove.points_s[1:4, 0] > points[:, :1]).sum(axis=1)
    across = np.cross(np.diff(groove.points_s, axis=0), groove.T_s_g[:3, 0])
    away = (across * groove.points_s[:4]).sum(axis=1, keepdims=True) > 0
    lengths = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(away, -across, across) / np.where(lengths > 0, lengths, np.nan)
    normals = np.where(np.isfinite(across), across, (0.0, 0.0, -1.0)) @ T[:3, :3].T
    return GrooveCloud(transform_points(T, points), normals[sides], sides)


def corner_errors(
    sections: Sequence[MeasuredSection], joint: JointDefinition | None
) -> Array | None:
    """Distances of the corners from the edges of a joint in their frame, metres; None without."""
    if joint is None:
        return None
    corners = np.array([section.points for section in sections])
    return corner_to_edge_distances(corners, feature_edges(joint), absent_corners(sections))


def flange_motion(hops: Iterable[tuple[ProfileView, ProfileView]]) -> tuple[float, float]:
    """Millimetres and degrees that the flange moved from view to view."""
    poses = [(a.T_b_f, b.T_b_f) for a, b in hops]
    travel = sum(float(np.linalg.norm(b[:3, 3] - a[:3, 3])) for a, b in poses)
    return 1e3 * travel, float(np.degrees(sum(rotation_angle_between(a, b) for a, b in poses)))


def summarise_scan(
    result: journal.ScanResult,
    plan: ScanPlan,
    frame: JointOrBaseFrame,
    corner_error: Array | None,
    calibration: str = "",
    uncertainty: BudgetSummary | None = None,
) -> ScanSummary:
    """Summarise what a scan found in a few numbers.

    Parameters
    ----------
    result, plan, frame
        What was found, what was asked, and the frame of the result.
    corner_error : ndarray, optional
        Raw distances of the corners from the joint's edges, metres, any shape.
    calibration : str
        Where the sensor's pose on the flange comes from.
    uncertainty : BudgetSummary, optional
        Where the uncertainty of its corners comes from.
    """
    steps = 1e3 * np.array(journal.untaught_step_lengths(result.sections))
    profiles = [view for view in result.views if view.substep is not Substep.FUSED]
    second = (i for i, v in enumerate(profiles) if v.substep is Substep.TAUGHT and v.index > 0)
    views = profiles[next(second, 0) :]
    travel, rotation = flange_motion(pairwise(views))
    taken = [view for view in profiles if view.substep is not Substep.TAUGHT]
    found = sum(s.view.substep is not Substep.TAUGHT for s in result.sections)
    error = None if corner_error is None else DistanceStatistics.from_distances(corner_error)
    return ScanSummary(
        sections=len(result.sections),
        scans=len(profiles),
        complete=journal.plan_is_fulfilled(result.stop, plan),
        stopped_because=str(result.stop),
        detail=result.detail,
        frame=frame.letter,
        groove_length_mm=1e3 * journal.groove_length(result.sections),
        step_mm=StepStatistics.from_steps(1e3 * plan.spacing, steps),
        flange_travel_mm=travel,
        flange_rotation_deg=rotation,
        motion_time_s=views[-1].time - views[0].time,
        corner_error_mm=error,
        calibration=calibration,
        scans_per_section=len(taken) / found if found else None,
        corrections_skipped=sum(s.view.substep is Substep.PREDICTION for s in result.sections),
        uncertainty=uncertainty,
        **asdict(result.counts),
    )
