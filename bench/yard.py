"""How well a joint as a yard leaves it is scanned: both ways, three steps, two cases, many seeds.

``--quick`` takes two seeds.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
from _table import Row, main

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core.errors import LaserFault
from tjscan.core.frames import Array, JointOrBaseFrame, transform_points
from tjscan.job.files import read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.recording.journal import CombinedJournal
from tjscan.result.section import absent_corners
from tjscan.runs.scan.run import ScanContext, scan_in_cell
from tjscan.scanning.journal import plan_is_fulfilled

JOB: Final = Path(__file__).resolve().parents[1] / "examples" / "yard-joint.toml"
WAYS: Final[dict[str, dict[str, Any]]] = {
    "ccw": {},
    "cw": {
        "scan.direction": "clockwise",
        "scan.first.position_mm": [954.8, 430.9, 145.6],
        "scan.first.euler_zyx_deg": [-142.59, -66.53, 81.72],
        "scan.second.position_mm": [904.4, 388.9, 94.4],
        "scan.second.euler_zyx_deg": [-136.59, -67.57, 70.19],
    },
}
STEPS_MM: Final = (10, 40, 80)
CASES: Final = (3, "smooth")
SEEDS: Final = tuple(range(1, 21))
QUICK_SEEDS: Final = (1, 2)


@dataclass(frozen=True)
class Scanned:
    """One scan in the numbers that count here.

    Parameters
    ----------
    complete : bool
        Whether it did what was asked.
    scans : float
        Profiles per section.
    errors : ndarray, shape (n,)
        Distances of the corners that were seen from the edges of the bent joint, mm.
    tacks, found : int
        Sections whose root a tack buries, and how many of them are recorded as tack.
    """

    complete: bool
    scans: float
    errors: Array
    tacks: int
    found: int


def scan(key: tuple[str, str | int, int, int]) -> Scanned:
    """Scan one way, by one case, with one step and one seed."""
    way, case, step_mm, seed = key
    keys = {"scan.prediction_case": case, "scan.step_mm": step_mm, "simulation.seed": seed}
    job = read_scan_job(JOB, WAYS[way] | keys)
    context = ScanContext(job, JOB)
    if context.joint is None or job.joint is None:
        raise SystemExit(f"{JOB} names no joint to compare with")
    try:
        result = scan_in_cell(context.make_cell(), job, CombinedJournal())
    except LaserFault:
        return Scanned(False, np.nan, np.empty(0), 0, 0)
    T_j_b = JointOrBaseFrame(job.joint.T_w_j).T_r_b
    corners = np.array([transform_points(T_j_b, section.points_b) for section in result.sections])
    edges = feature_edges(context.joint)
    grooves = [section.groove for section in result.sections]
    errors = 1e3 * corner_to_edge_distances(corners, edges, absent_corners(grooves))
    # Across the end of a tack one corner of the root lies bare: it may be read.
    buried = edges.on_tack(corners[:, 2]) & edges.on_tack(corners[:, 3])
    named = np.array([groove.on_tack for groove in grooves])
    return Scanned(
        plan_is_fulfilled(result.stop, job.scan),
        len(result.views) / len(grooves),
        errors[~np.isnan(errors)],
        int(buried.sum()),
        int((buried & named).sum()),
    )


def measure(seeds: Iterable[int]) -> list[Row]:
    """Measure every bar, a row of each for each case and step."""
    seeds, rows = tuple(seeds), []
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for case, step in product(CASES, STEPS_MM):
            some = list(pool.map(scan, product(WAYS, (case,), (step,), seeds)))
            name = f"{case}, {step} mm"
            errors = np.concatenate([one.errors for one in some])
            share = 100 * float(np.mean([one.complete for one in some]))
            tacks = max(sum(one.tacks for one in some), 1)
            scans = float(np.nanmean([one.scans for one in some]))
            rows += [
                Row(f"{name}: complete", share, 100, "%", at_least=99),
                Row(f"{name}: scans a section", scans, 1.6 if case == "smooth" else np.inf),
                Row(f"{name}: corner error p95", float(np.percentile(errors, 95)), 0.3, "mm"),
                Row(
                    f"{name}: tacks found",
                    100 * sum(one.found for one in some) / tacks,
                    100,
                    "%",
                    at_least=99,
                ),
            ]
    return rows


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--quick"]
    few = len(words) < len(sys.argv) - 1
    sys.exit(main("A yard's joint", partial(measure, QUICK_SEEDS if few else SEEDS), words))
