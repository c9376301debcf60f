"""What the smooth case wins over the paper's: the paper's joint, every step, both ways, many seeds.

``--quick`` takes two seeds and three step lengths.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np
from _stopwatch import Stopwatch
from _table import Row, main

from tjscan.core.frames import JointOrBaseFrame
from tjscan.job.files import read_scan_job
from tjscan.recording.journal import CombinedJournal
from tjscan.runs.scan.results import summarise_scan
from tjscan.runs.scan.run import ScanContext, scan_in_cell
from tjscan.scanning.journal import groove_length
from tjscan.scanning.smooth import predictor_for_plan

EXAMPLES: Final = Path(__file__).resolve().parents[1] / "examples"
JOBS: Final = {"ccw": EXAMPLES / "paper.toml", "cw": EXAMPLES / "paper-clockwise.toml"}
STEPS_MM: Final = (10, 20, 30, 40, 50, 60, 70, 80, 90, 100)
SEEDS: Final = tuple(range(1, 21))
QUICK_STEPS_MM: Final = (10, 40, 100)
QUICK_SEEDS: Final = (1, 2)
CASES: Final = ("smooth", 1, 3)
TIMED_MM: Final = 40
"""The step length at which the paper tells its time."""


@dataclass(frozen=True)
class Scanned:
    """One scan in the numbers that count here.

    Parameters
    ----------
    complete : bool
        Whether it did what was asked.
    remedies : int
        Steps and views that had to be tried otherwise.
    step_error : float
        Mean step over the nominal one, less 1.
    step_std : float
        Millimetres.
    scans : float
        Profiles per section.
    travel, rotation, time : float
        Of the flange, per metre of groove that the scan found by itself: mm, degrees, seconds.
        Scans that end elsewhere can be compared so.
    """

    complete: bool
    remedies: int
    step_error: float
    step_std: float
    scans: float
    travel: float
    rotation: float
    time: float


def scan(key: tuple[str, str | int, int, int]) -> Scanned:
    """Scan one way, by one case, with one step and one seed."""
    way, case, step_mm, seed = key
    file = JOBS[way]
    job = read_scan_job(
        file,
        {"scan.prediction_case": case, "scan.step_mm": step_mm, "simulation.seed": seed},
    )
    cell = ScanContext(job, file).make_cell()
    result = scan_in_cell(cell, job, CombinedJournal())
    summary = summarise_scan(result, job.scan, JointOrBaseFrame(), None)
    metres = max(groove_length(result.sections[1:]), 1e-9)
    return Scanned(
        complete=summary.complete,
        remedies=summary.half_steps + summary.retreats + summary.nudges + summary.taken_again,
        step_error=(summary.step_mm.mean or np.nan) / step_mm - 1,
        step_std=summary.step_mm.std or np.nan,
        scans=summary.scans / summary.sections,
        travel=summary.flange_travel_mm / metres,
        rotation=summary.flange_rotation_deg / metres,
        time=summary.motion_time_s / metres,
    )


def time_predictor() -> Stopwatch:
    """Time predictions from thirty sections."""
    job = read_scan_job(JOBS["ccw"], {"scan.prediction_case": "smooth", "scan.step_mm": 15})
    cell = ScanContext(job, JOBS["ccw"]).make_cell()
    sections = scan_in_cell(cell, job, CombinedJournal()).sections
    predictor, watch = predictor_for_plan(job.scan), Stopwatch()
    for _ in range(50):
        with watch:
            predictor(sections, 0.015)
    return watch


def measure(steps: Iterable[int], seeds: Iterable[int]) -> list[Row]:
    """Measure every bar; each row is the worst of the step lengths, the mean of the seeds."""
    steps, seeds = tuple(steps), tuple(seeds)
    keys = list(product(JOBS, CASES, steps, seeds))
    # The longest first, so that no process is left with them alone.
    keys.sort(key=lambda key: key[2])
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        found = dict(zip(keys, pool.map(scan, keys), strict=True))

    @cache
    def mean(way: str, case: str | int, step: int, name: str) -> float:
        values = [getattr(found[way, case, step, seed], name) for seed in seeds]
        return float(np.nanmean(values))

    def against(case: int, name: str, step: int) -> float:
        both = [
            sum(mean(way, one, step, name) for way in JOBS) / len(JOBS) for one in ("smooth", case)
        ]
        return both[0] / both[1]

    errors = [100 * abs(mean(way, "smooth", step, "step_error")) for way in JOBS for step in steps]
    stds = [
        mean(way, "smooth", step, "step_std") / mean(way, 1, step, "step_std")
        for way in JOBS
        for step in steps
    ]
    smooth = [found[key] for key in keys if key[1] == "smooth"]
    rows = [
        Row("scans not completed", sum(not one.complete for one in smooth), 0),
        Row("remedies needed", sum(one.remedies for one in smooth), 0),
        Row("mean step error", max(errors), 0.3, "%"),
        Row("std of the step, against case 1", max(stds), 1),
        Row(
            "scans per section",
            max(mean(way, "smooth", step, "scans") for way in JOBS for step in steps),
            1.25,
        ),
    ]
    for name, limit in (("travel", 0.97), ("rotation", 0.95)):
        worst = max(against(3, name, step) for step in steps)
        rows.append(Row(f"flange {name}, against case 3", worst, limit))
    rows.append(
        Row(f"motion time at {TIMED_MM} mm, against case 3", against(3, "time", TIMED_MM), 0.65)
    )
    longest = max(steps)
    lost = sum(
        found[way, "smooth", longest, seed].remedies > 0
        or not found[way, "smooth", longest, seed].complete
        for way, seed in product(JOBS, seeds)
    )
    rows += [
        Row(f"scans at {longest} mm that lost the groove", lost, 0),
        time_predictor().row("one prediction from thirty sections", median, 15),
    ]
    return rows


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--quick"]
    few = len(words) < len(sys.argv) - 1
    chosen = (QUICK_STEPS_MM, QUICK_SEEDS) if few else (STEPS_MM, SEEDS)
    sys.exit(main("The smooth case against the paper's", partial(measure, *chosen), words))
