"""One scan of a study: a task in, a row out. Whatever happens in between is told by the row."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from time import perf_counter

import numpy as np

from tjscan.comparison.distance import corner_errors
from tjscan.core.errors import ConfigurationError, TjscanError
from tjscan.core.frames import Array, rotation_angle, transform
from tjscan.core.units import rows_to_pose
from tjscan.job.cell import open_cell
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import FeatureEdges, feature_edges
from tjscan.result.frame import ResultFrame
from tjscan.result.summary import Summary
from tjscan.runs.results import summarise
from tjscan.runs.scan import scan_in
from tjscan.scanning.journal import Journals
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.result import ScanResult
from tjscan.scanning.section import Substep
from tjscan.study.row import Measured, Row
from tjscan.study.task import Task

EDGES_KEPT = 4
"""Joints whose edges a process keeps: tasks of one joint stand together."""


def run_task(task: Task) -> Row:
    """Make one scan; a failure is a row too."""
    start = perf_counter()
    try:
        result, plan, frame, joint = _scan(task)
    except TjscanError as error:
        return Row.failed(task, type(error).__name__, str(error), perf_counter() - start)
    except Exception as error:
        # A fault of the program: it costs this row and no other, and its name is told.
        detail = f"unexpected: {error}"
        return Row.failed(task, type(error).__name__, detail, perf_counter() - start)
    measured, path = _measured(result, plan, frame, joint), _path(result, frame)
    return Row(task.key, task.index, task.inputs, measured, path, perf_counter() - start)


def _scan(task: Task) -> tuple[ScanResult, ScanPlan, ResultFrame, JointDefinition]:
    job, joint = task.job_file, task.joint_definition
    if job.joint is None or job.calibration.T_f_s_mm is None:
        raise ConfigurationError("a task holds its joint and its calibration")
    cell = open_cell(job, rows_to_pose(job.calibration.T_f_s_mm), joint)
    return scan_in(cell, job, Journals()), job.scan, ResultFrame(job.joint.T_w_j), joint


def _measured(
    result: ScanResult, plan: ScanPlan, frame: ResultFrame, joint: JointDefinition
) -> Measured:
    corners = np.array([transform(frame.T_r_b, s.points_b) for s in result.sections])
    summary = summarise(result, plan, frame, corner_errors(corners, _edges(joint)))
    step, error = summary.step_mm, summary.corner_error_mm
    predicted, corrected = (
        _moved(result, substep) for substep in (Substep.PREDICTION, Substep.CORRECTION)
    )
    return Measured(
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
    )


def _per_section(summary: Summary) -> float | None:
    own = summary.sections - 2
    return (summary.scans - 2) / own if own > 0 else None


def _moved(result: ScanResult, substep: Substep) -> tuple[float, float]:
    """Millimetres and degrees that the flange moved into views of one kind."""
    hops = [(a, b) for a, b in pairwise(result.views) if b.substep is substep]
    travel = sum(float(np.linalg.norm(b.T_b_f[:3, 3] - a.T_b_f[:3, 3])) for a, b in hops)
    return 1e3 * travel, float(np.degrees(sum(rotation_angle(a.T_b_f, b.T_b_f) for a, b in hops)))


def _path(result: ScanResult, frame: ResultFrame) -> tuple[tuple[float, float, float], ...]:
    """The flange's way in cylinder coordinates of frame j, degrees and mm, rounded for a plot."""
    flange = transform(frame.T_r_b, [view.T_b_f[:3, 3] for view in result.views])
    azimuth = np.degrees(np.unwrap(np.arctan2(flange[:, 1], flange[:, 0])))
    distance = 1e3 * np.hypot(flange[:, 0], flange[:, 1])
    points: Array = np.round(np.column_stack((azimuth, distance, 1e3 * flange[:, 2])), 3)
    return tuple((float(a), float(r), float(z)) for a, r, z in points)


@lru_cache(maxsize=EDGES_KEPT)
def _edges(joint: JointDefinition) -> FeatureEdges:
    return feature_edges(joint)
