"""How quickly an arm's poses are solved and its paths checked."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, Final

import numpy as np
from _table import Row, main

from tjscan.core.frames import Array
from tjscan.job import read_scan_job
from tjscan.robot.collision_checked import CollisionCheckedArm
from tjscan.runs.context import RunContext
from tjscan.runs.scan import scan_in_cell
from tjscan.scanning.journal import CombinedJournal
from tjscan.scanning.section import View

PAPER: Final = Path(__file__).resolve().parents[1] / "examples" / "paper.toml"


def milliseconds(work: Callable[[], Any]) -> float:
    start = perf_counter()
    work()
    return 1e3 * (perf_counter() - start)


def scanned() -> tuple[CollisionCheckedArm, tuple[View, ...]]:
    """An arm that knows the whole groove it scanned, and the views it scanned it from."""
    job = read_scan_job(PAPER)
    cell = RunContext(job, PAPER).cell()
    views = scan_in_cell(cell, job, CombinedJournal()).views
    return CollisionCheckedArm(cell.arm, cell.clearance, cell.T_f_s), views


def inverse_ms(arm: CollisionCheckedArm, views: tuple[View, ...]) -> float:
    """Median time of an inverse solution 5 mm and 1 degree from where the arm stands."""
    kinematics, random, times = arm.clearance.kinematics, np.random.default_rng(1), []
    for view in views * 20:
        near: Array = view.q + 5e-3 * random.standard_normal(view.q.size)
        times.append(milliseconds(partial(kinematics.inverse, view.T_b_f, near)))
    return median(times)


def path_ms(arm: CollisionCheckedArm, views: tuple[View, ...]) -> list[float]:
    """Times of checking the lines of a scan, collisions with everything included."""
    return [
        milliseconds(partial(arm.clear_path, before.q, after.T_b_f, straight=True))
        for before, after in pairwise(views[1:])
    ]


def first_ms(arm: CollisionCheckedArm, views: tuple[View, ...]) -> float:
    """Time of checking the first move, across the cell."""
    q = np.radians((-110, -95, 160, 105, -110, 0))
    return milliseconds(lambda: arm.clear_path(q, views[0].T_b_f, straight=False))


def measure() -> list[Row]:
    """Measure every bar."""
    arm, views = scanned()
    lines = path_ms(arm, views)
    return [
        Row("inverse solution near the last one", inverse_ms(arm, views), 0.3, "ms"),
        Row("check of a 40 mm step, median", median(lines), 20, "ms"),
        Row("check of a 40 mm step, longest", max(lines), 20, "ms"),
        Row("check of the first move", first_ms(arm, views), 200, "ms"),
    ]


if __name__ == "__main__":
    sys.exit(main("The arm's kinematics and clearance", measure, sys.argv[1:]))
