"""From what a scan found to the numbers and files of its run directory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from tjscan.calibration.file import read_calibration
from tjscan.comparison.distance import DistanceStatistics, corner_to_edge_distances
from tjscan.core.frames import Array, JointOrBaseFrame, rotation_angle_between, transform_points
from tjscan.groove.measured import MeasuredSection, section_to_result_frame
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import feature_edges
from tjscan.result.directory import CALIBRATION_FILE, JOB_FILE, job_label_of_run
from tjscan.result.picture import draw_groove_overview
from tjscan.result.readings import ProfileReading
from tjscan.result.section import absent_corners
from tjscan.result.summary import ScanSummary, StepStatistics
from tjscan.result.wireframe import joint_wireframe
from tjscan.result.write import write_run_results
from tjscan.runs.scan.uncertainty import StatedCauses
from tjscan.scanning.journal import (
    ScanResult,
    groove_length,
    plan_is_fulfilled,
    untaught_step_lengths,
)
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import ProfileView, ScannedSection, Substep
from tjscan.uncertainty.budget import BudgetSummary, summarise_budget
from tjscan.uncertainty.causes import budget_of_causes


def calibration_label(directory: Path) -> str:
    """Which calibration a run was made with, or that its job states the sensor's pose.

    Raises
    ------
    ConfigurationError
        If the ``calibration.toml`` in the run directory can't be read.
    """
    file = directory / CALIBRATION_FILE
    if not file.is_file():
        return f"T_f_s_mm in {JOB_FILE}"
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


def all_profile_points(sections: Sequence[ScannedSection], frame: JointOrBaseFrame) -> Array:
    """All profile points of the sections, shape (n, 3), metres, in the result's frame."""
    views = [scan.view for scan in sections]
    return np.concatenate(
        [transform_points(frame.T_r_b @ view.T_b_s, view.profile.points_s) for view in views]
    )


def corner_errors(
    sections: Sequence[MeasuredSection], joint: JointDefinition | None
) -> Array | None:
    """Distances of the corners from the edges of a joint in their frame, metres; None without."""
    if joint is None:
        return None
    corners = np.array([section.points for section in sections])
    return corner_to_edge_distances(corners, feature_edges(joint), absent_corners(sections))


def flange_way(hops: Iterable[tuple[ProfileView, ProfileView]]) -> tuple[float, float]:
    """Millimetres and degrees that the flange moved from view to view."""
    poses = [(a.T_b_f, b.T_b_f) for a, b in hops]
    travel = sum(float(np.linalg.norm(b[:3, 3] - a[:3, 3])) for a, b in poses)
    return 1e3 * travel, float(np.degrees(sum(rotation_angle_between(a, b) for a, b in poses)))


def summarise_scan(
    result: ScanResult,
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
    steps = 1e3 * np.array(untaught_step_lengths(result.sections))
    views = [v for v in result.views if v.substep is not Substep.TAUGHT or v.index == 1]
    travel, rotation = flange_way(pairwise(views))
    taken = [view for view in result.views if view.substep is not Substep.TAUGHT]
    found = sum(s.view.substep is not Substep.TAUGHT for s in result.sections)
    error = None if corner_error is None else DistanceStatistics.from_distances(corner_error)
    return ScanSummary(
        sections=len(result.sections),
        scans=len(result.views),
        complete=plan_is_fulfilled(result.stop, plan),
        stopped_because=str(result.stop),
        detail=result.detail,
        frame=frame.letter,
        groove_length_mm=1e3 * groove_length(result.sections),
        step_mm=StepStatistics.from_steps(1e3 * plan.step, steps),
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


def write_scan_results(
    directory: Path,
    result: ScanResult,
    plan: ScanPlan,
    frame: JointOrBaseFrame,
    joint: JointDefinition | None,
    causes: StatedCauses,
    *,
    station: str = "1",
) -> ScanSummary:
    """Write the results of a scan from one place; raises as `write_run_results` does.

    Parameters
    ----------
    directory : Path
        The run directory.
    result, plan, frame
        What was found, what was asked, and the frame of the result.
    joint : JointDefinition, optional
        What to compare the corners with.
    causes : StatedCauses
        What makes the sections err.
    station : str
        Where it was scanned from.
    """
    budget = budget_of_causes(causes.causes, frame.T_r_b, len(result.sections))
    sections = budget.state_in(sections_in_result_frame(result.sections, frame, station))
    points = all_profile_points(result.sections, frame)
    error, calibration = corner_errors(sections, joint), calibration_label(directory)
    uncertainty = summarise_budget(budget, ~absent_corners(sections), causes.left_out)
    summary = summarise_scan(result, plan, frame, error, calibration, uncertainty)
    middle = result.sections[len(result.sections) // 2]
    groove, view = middle.groove, middle.view
    example = ProfileReading(f"section {view.index}", view.profile, groove.points_s, groove)
    picture = draw_groove_overview(
        sections,
        points,
        frame=frame.letter,
        title=f"{len(sections)} sections, {result.stop}",
        outline=() if joint is None else joint_wireframe(joint),
        paths=[transform_points(frame.T_r_b, [view.T_b_f[:3, 3] for view in result.views])],
        example=example,
    )
    job = job_label_of_run(directory)
    return write_run_results(directory, sections, points, summary, picture, job, budget)
