"""How well the scan of the paper's joint holds what it promises."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from itertools import product
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, Final

import numpy as np
from _table import Row, main

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core.frames import transform_points
from tjscan.job import read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.result.frame import JointOrBaseFrame
from tjscan.result.summary import ScanSummary
from tjscan.runs.context import RunContext
from tjscan.runs.results import summarise_scan
from tjscan.runs.scan import scan_in_cell
from tjscan.scanning.journal import CombinedJournal
from tjscan.scanning.progress import StopReason

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
def scan(way: str, case: int, step_mm: int, faultless: bool = False) -> tuple[ScanSummary, float]:
    """Scan an example, and return its summary and the seconds that the loop took."""
    file = JOBS[way]
    keys = {"scan.prediction_case": case, "scan.step_mm": step_mm}
    job = read_scan_job(file, keys | (FAULTLESS if faultless else {}))
    joint = RunContext(job, file).joint
    if joint is None or job.joint is None:
        raise SystemExit(f"{file} names no joint to compare with")
    cell = RunContext(job, file).cell()
    start = perf_counter()
    result = scan_in_cell(cell, job, CombinedJournal())
    seconds = perf_counter() - start
    frame = JointOrBaseFrame(job.joint.T_w_j)
    corners = np.array([transform_points(frame.T_r_b, s.points_b) for s in result.sections])
    errors = corner_to_edge_distances(corners, feature_edges(joint))
    return summarise_scan(result, job.scan, frame, errors), seconds


def step_error(summary: ScanSummary) -> float:
    """Mean step error in percent of the nominal step."""
    mean = summary.step_mm.mean
    return float("nan") if mean is None else 100 * abs(mean / summary.step_mm.nominal - 1)


def lost(way: str, case: int) -> int:
    """Count the step lengths that a case does not complete."""
    summaries = [scan(way, case, step)[0] for step in STEPS_MM]
    return sum(summary.stopped_because != StopReason.LENGTH for summary in summaries)


def command_seconds() -> float:
    """Wall clock of ``tjscan scan`` on the paper's example, the start of Python included."""
    with TemporaryDirectory() as folder:
        tjscan = Path(sys.executable).with_name("tjscan")
        start = perf_counter()
        subprocess.run(
            [tjscan, "scan", JOBS["ccw"], "--out", f"{folder}/run"], check=True, capture_output=True
        )
        return perf_counter() - start


def profile_ms() -> float:
    """Median time of one simulated profile of 640 points, all faults on."""
    job = read_scan_job(JOBS["ccw"])
    cell, times = RunContext(job, JOBS["ccw"]).cell(), []
    with cell:
        cell.arm.move_joint_to_pose(job.start_poses[0].T)
        for _ in range(200):
            start = perf_counter()
            cell.laser.capture()
            times.append(perf_counter() - start)
    return 1e3 * median(times)


def help_seconds() -> float:
    """Median wall clock of ``tjscan --help``."""
    times = []
    for _ in range(5):
        start = perf_counter()
        tjscan = Path(sys.executable).with_name("tjscan")
        subprocess.run([tjscan, "--help"], check=True, capture_output=True)
        times.append(perf_counter() - start)
    return median(times)


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
    rates = [
        summary.sections / seconds for summary, seconds in (scan("ccw", 3, s) for s in (10, 20, 40))
    ]
    rows += [
        Row("sections per second in the loop", median(rates), float("inf"), "1/s", at_least=30),
        Row("one simulated profile, 640 points", profile_ms(), 3, "ms"),
        Row("tjscan scan, start to end", command_seconds(), 15, "s"),
        Row("tjscan --help", help_seconds(), 0.6, "s"),
    ]
    return rows


if __name__ == "__main__":
    sys.exit(main("The scan of the paper's joint", measure, sys.argv[1:]))
