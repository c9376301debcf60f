"""How well the scan of the paper's joint holds what it promises."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from itertools import product
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from _stopwatch import Stopwatch
from _table import Row, main

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core.frames import JointOrBaseFrame, transform_points
from tjscan.job.files import read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.recording.journal import CombinedJournal
from tjscan.result.summary import ScanSummary
from tjscan.runs.scan.results import summarise_scan
from tjscan.runs.scan.run import ScanContext, scan_in_cell
from tjscan.scanning.journal import StopReason

EXAMPLES: Final = Path(__file__).resolve().parents[1] / "examples"
JOBS: Final = {"ccw": EXAMPLES / "paper.toml", "cw": EXAMPLES / "paper-clockwise.toml"}
STEPS_MM: Final = (10, 20, 30, 40, 50, 60, 70, 80)
LASER_FAULTS: Final = ("noise_mm", "bias_mm", "dropout", "missing", "ghosts", "flyers")
FAULTLESS: Final[dict[str, Any]] = {
    **{f"simulation.laser.{name}": 0 for name in LASER_FAULTS},
    "simulation.laser.resolution_mm": 0,
    "simulation.arm.repeatability_mm": 0,
    "simulation.arm.repeatability_deg": 0,
}
PAPERS_STEP_ERRORS: Final = {1: 2.9, 2: 0.6, 3: 0.4, 4: 13.5}
"""Largest mean step error of each case in the paper's Fig. 14, in percent."""


@cache
def scan(
    way: str, case: int, step_mm: int, faultless: bool = False
) -> tuple[ScanSummary, Stopwatch]:
    """Scan an example, and return its summary and what the loop took."""
    file = JOBS[way]
    keys = {"scan.prediction_case": case, "scan.step_mm": step_mm}
    job = read_scan_job(file, keys | (FAULTLESS if faultless else {}))
    joint = ScanContext(job, file).joint
    if joint is None or job.joint is None:
        raise SystemExit(f"{file} names no joint to compare with")
    cell = ScanContext(job, file).make_cell()
    loop = Stopwatch()
    with loop:
        result = scan_in_cell(cell, job, CombinedJournal())
    frame = JointOrBaseFrame(job.joint.T_w_j)
    corners = np.array([transform_points(frame.T_r_b, s.points_b) for s in result.sections])
    errors = corner_to_edge_distances(corners, feature_edges(joint))
    return summarise_scan(result, job.scan, frame, errors), loop


def step_error(summary: ScanSummary) -> float:
    """Mean step error in percent of the nominal step."""
    mean = summary.step_mm.mean
    return float("nan") if mean is None else 100 * abs(mean / summary.step_mm.nominal - 1)


def lost(way: str, case: int) -> int:
    """Count the step lengths that a case does not complete."""
    summaries = [scan(way, case, step)[0] for step in STEPS_MM]
    return sum(summary.stopped_because != StopReason.LENGTH for summary in summaries)


def time_command(times: int, *arguments: str | Path) -> Stopwatch:
    """Time ``tjscan`` with arguments by the wall clock, the start of Python included."""
    watch, tjscan = Stopwatch(), Path(sys.executable).with_name("tjscan")
    for _ in range(times):
        with TemporaryDirectory() as folder, watch:
            subprocess.run([tjscan, *arguments], cwd=folder, check=True, capture_output=True)
    return watch


def time_profile() -> Stopwatch:
    """Time one simulated profile of 640 points, all faults on."""
    job = read_scan_job(JOBS["ccw"])
    cell, watch = ScanContext(job, JOBS["ccw"]).make_cell(), Stopwatch()
    with cell:
        cell.arm.move_joint_to_pose(job.start_poses[0].T)
        for _ in range(200):
            with watch:
                cell.laser.capture()
    return watch


def measure() -> list[Row]:
    """Measure every bar."""
    rows = []
    for way in JOBS:
        summary, _ = scan(way, 3, 40)
        error = summary.corner_error_mm
        if error is None:
            raise SystemExit("nothing to compare with")
        rows += [
            Row(f"{way} 40 mm case 3: steps", summary.sections - 2, 14, at_least=14),
            Row(f"{way} 40 mm case 3: mean step error", step_error(summary), 1, "%"),
            Row(f"{way} 40 mm case 3: corner error mean", error.mean, 0.15, "mm"),
            Row(f"{way} 40 mm case 3: corner error p95", error.p95, 0.4, "mm"),
        ]
    for way, case in product(JOBS, (2, 3)):
        rows.append(Row(f"{way} case {case}, 10 to 80 mm: not completed", lost(way, case), 0))
    for way, (case, limit) in product(JOBS, PAPERS_STEP_ERRORS.items()):
        summary, _ = scan(way, case, 40, faultless=True)
        name = f"{way} 40 mm case {case}, no faults: mean step error"
        rows.append(Row(name, step_error(summary), limit, "%"))
    for step in (10, 20, 40):
        summary, loop = scan("ccw", 3, step)
        limit = 1e3 / 30 * summary.sections
        rows.append(loop.row(f"{step} mm: the loop, 30 sections a second", max, limit))
    rows += [
        time_profile().row("one simulated profile, 640 points", median, 3),
        time_command(1, "scan", JOBS["ccw"], "--out", "run").row("tjscan scan", max, 15e3),
        time_command(5, "--help").row("tjscan --help", median, 600),
    ]
    return rows


if __name__ == "__main__":
    sys.exit(main("The scan of the paper's joint", measure, sys.argv[1:]))
