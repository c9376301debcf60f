"""How quickly an arm's poses are solved and its paths checked."""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np
from _stopwatch import Stopwatch
from _table import Row, main

from tjscan.core.frames import Array
from tjscan.job.files import read_scan_job
from tjscan.recording.journal import CombinedJournal
from tjscan.robot.collision_checked import CollisionCheckedArm
from tjscan.runs.scan.run import ScanContext, scan_in_cell
from tjscan.scanning.section import ProfileView

PAPER: Final = Path(__file__).resolve().parents[1] / "examples" / "paper.toml"


def scanned() -> tuple[CollisionCheckedArm, tuple[ProfileView, ...]]:
    """An arm that knows the whole groove it scanned, and the views it scanned it from."""
    job = read_scan_job(PAPER)
    cell = ScanContext(job, PAPER).make_cell()
    views = scan_in_cell(cell, job, CombinedJournal()).views
    return CollisionCheckedArm(cell.arm, cell.clearance, cell.T_f_s), views


def time_inverse(arm: CollisionCheckedArm, views: tuple[ProfileView, ...]) -> Stopwatch:
    """Time inverse solutions 5 mm and 1 degree from where the arm stands."""
    kinematics, random, watch = arm.clearance.kinematics, np.random.default_rng(1), Stopwatch()
    for view in views * 20:
        near: Array = view.q + 5e-3 * random.standard_normal(view.q.size)
        with watch:
            kinematics.inverse(view.T_b_f, near)
    return watch


def time_lines(arm: CollisionCheckedArm, views: tuple[ProfileView, ...]) -> Stopwatch:
    """Time checks of the lines of a scan, collisions with everything included."""
    watch = Stopwatch()
    for before, after in pairwise(views[1:]):
        with watch:
            arm.plan_clear_path(before.q, after.T_b_f, straight=True)
    return watch


def time_first_move(arm: CollisionCheckedArm, views: tuple[ProfileView, ...]) -> Stopwatch:
    """Time checks of the first move, across the cell."""
    q, watch = np.radians((-110, -95, 160, 105, -110, 0)), Stopwatch()
    for _ in range(5):
        with watch:
            arm.plan_clear_path(q, views[0].T_b_f, straight=False)
    return watch


def measure() -> list[Row]:
    """Measure every bar."""
    arm, views = scanned()
    lines = time_lines(arm, views)
    return [
        time_inverse(arm, views).row("inverse solution near the last one", median, 0.3),
        lines.row("check of a 40 mm step, median", median, 20),
        lines.row("check of a 40 mm step, longest", max, 20),
        time_first_move(arm, views).row("check of the first move", median, 200),
    ]


if __name__ == "__main__":
    sys.exit(main("The arm's kinematics and clearance", measure, sys.argv[1:]))
