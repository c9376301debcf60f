"""One scan of a study: settings in, what came out of it."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, JointOrBaseFrame, rotation_angle_between, transform_points
from tjscan.core.units import pose_from_rows_mm
from tjscan.job.cell import make_scan_cell
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import FeatureEdges, feature_edges
from tjscan.result.section import absent_corners
from tjscan.result.summary import ScanSummary
from tjscan.runs.scan.results import summarise_scan
from tjscan.runs.scan.run import scan_in_cell
from tjscan.runs.scan_study.outcome import ScanOutcome
from tjscan.runs.scan_study.settings import StudyScanSettings
from tjscan.scanning.journal import CombinedJournal
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.result import ScanResult
from tjscan.scanning.section import Substep

EDGES_KEPT = 4
"""Joints whose edges a process keeps: trials of one joint follow each other."""


def run_study_scan(settings: StudyScanSettings) -> ScanOutcome:
    """Execute one scan of a study and return its outcome.

    Raises
    ------
    TjscanError
        If the settings are wrong or a device fails.
    """
    job, joint = settings.job, settings.joint.definition("joint")
    if job.joint is None or job.calibration.T_f_s_mm is None:
        raise ConfigurationError("a scan of a study holds its joint and its calibration")
    cell = make_scan_cell(job, pose_from_rows_mm(job.calibration.T_f_s_mm), joint)
    result = scan_in_cell(cell, job, CombinedJournal())
    return _outcome(result, job.scan, JointOrBaseFrame(job.joint.T_w_j), joint)


def _outcome(
    result: ScanResult, plan: ScanPlan, frame: JointOrBaseFrame, joint: JointDefinition
) -> ScanOutcome:
    corners = np.array([transform_points(frame.T_r_b, s.points_b) for s in result.sections])
    absent = absent_corners([s.groove for s in result.sections])
    errors = corner_to_edge_distances(corners, _edges(joint), absent)
    summary = summarise_scan(result, plan, frame, errors)
    step, error = summary.step_mm, summary.corner_error_mm
    predicted, corrected = (
        _moved(result, substep) for substep in (Substep.PREDICTION, Substep.CORRECTION)
    )
    return ScanOutcome(
        complete=summary.complete,
        reason=summary.stopped_because,
        detail=summary.detail,
        sections=summary.sections,
        scans=summary.scans,
        scans_per_section=_per_section(summary),
        half_steps=summary.half_steps,
        groove_length_mm=summary.groove_length_mm,
        step_nominal_mm=step.nominal,
        step_mean_mm=step.mean,
        step_std_mm=step.std,
        step_error_percent=None if step.mean is None else 100 * (step.mean / step.nominal - 1),
        travel_mm=summary.flange_travel_mm,
        travel_prediction_mm=predicted[0],
        travel_correction_mm=corrected[0],
        rotation_deg=summary.flange_rotation_deg,
        rotation_prediction_deg=predicted[1],
        rotation_correction_deg=corrected[1],
        motion_time_s=summary.motion_time_s,
        corner_mean_mm=None if error is None else error.mean,
        corner_p95_mm=None if error is None else error.p95,
        path=_path(result, frame),
    )


def _per_section(summary: ScanSummary) -> float | None:
    own = summary.sections - 2
    return (summary.scans - 2) / own if own > 0 else None


def _moved(result: ScanResult, substep: Substep) -> tuple[float, float]:
    """Millimetres and degrees that the flange moved into views of one kind."""
    hops = [(a, b) for a, b in pairwise(result.views) if b.substep is substep]
    travel = sum(float(np.linalg.norm(b.T_b_f[:3, 3] - a.T_b_f[:3, 3])) for a, b in hops)
    return 1e3 * travel, float(
        np.degrees(sum(rotation_angle_between(a.T_b_f, b.T_b_f) for a, b in hops))
    )


def _path(result: ScanResult, frame: JointOrBaseFrame) -> tuple[tuple[float, float, float], ...]:
    """The flange's path in cylinder coordinates of frame j, degrees and mm, rounded for a plot."""
    flange = transform_points(frame.T_r_b, [view.T_b_f[:3, 3] for view in result.views])
    azimuth = np.degrees(np.unwrap(np.arctan2(flange[:, 1], flange[:, 0])))
    distance = 1e3 * np.hypot(flange[:, 0], flange[:, 1])
    points: Array = np.round(np.column_stack((azimuth, distance, 1e3 * flange[:, 2])), 3)
    return tuple((float(a), float(r), float(z)) for a, r, z in points)


@lru_cache(maxsize=EDGES_KEPT)
def _edges(joint: JointDefinition) -> FeatureEdges:
    return feature_edges(joint)
