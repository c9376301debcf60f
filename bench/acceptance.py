"""Whether the acceptance of a cell tells what is wrong with it, and of one in order nothing.

Simulated cells of `examples/accept.toml`, each with one fault or none; the fault's own row has to
fail and every other has to pass. ``--seeds N`` draws N cells of each kind instead of 20; ``--first
N`` begins at another seed; ``--quick`` draws two.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from _table import Row, main, numbers_to_draw

from tjscan.calibration.wizard.operator import DefaultAnswerOperator
from tjscan.core.units import pose_to_rows_mm
from tjscan.job.files import read_acceptance_job
from tjscan.runs.accept.run import accept_cell

JOB: Final = Path(__file__).parent.parent / "examples" / "accept.toml"

MOUNT_OFF: Final = 0.5e-3
"""Metres, in a drawn direction."""

LEAST_SHARE: Final = 95.0
"""Per cent of cells."""

FAULTS: Final[dict[str, dict[str, Any]]] = {
    "none": {},
    "calibration": {},
    "linearity": {"simulation.laser.linearity_mm": 0.3},
    "repeatability": {"simulation.arm.repeatability_mm": 0.2},
    "radius": {"artefact.radius_mm": 30.212},
    "clock": {"simulation.laser.clock_drift_ppm": -250.0},
    "noise": {"simulation.laser.noise_mm": 0.06},
}
"""Row that has to fail, and the keys that are then wrong."""


def failing_rows(fault: str, seed: int) -> set[str]:
    """Rows that fail of a cell with a fault."""
    keys = FAULTS[fault] | {"simulation.seed": seed}
    if fault == "calibration":
        T = np.array(read_acceptance_job(JOB).calibration.T_f_s)
        off = np.random.default_rng([seed, 35]).standard_normal(3)
        T[:3, 3] += MOUNT_OFF * off / np.linalg.norm(off)
        keys["simulation.T_f_s_mm"] = [list(row) for row in pose_to_rows_mm(T)]
    job = read_acceptance_job(JOB, keys)
    with TemporaryDirectory() as directory:
        found = accept_cell(job, JOB, Path(directory) / "run", DefaultAnswerOperator())
    return {row.key for row in found.rows if not row.passes}


def measure(seeds: range) -> Iterator[Row]:
    """Rows of the bench."""
    for fault in FAULTS:
        meant = set() if fault == "none" else {fault}
        right = 0
        for seed in seeds:
            found = failing_rows(fault, seed)
            right += found == meant
            print(
                f"{fault}, seed {seed}: {', '.join(sorted(found)) or 'accepted'}", file=sys.stderr
            )
        what = "no fault: accepted" if fault == "none" else f"{fault} wrong: its row alone fails"
        yield Row(what, 100 * right / len(seeds), 100, "%", LEAST_SHARE)


if __name__ == "__main__":
    ARGUMENTS = sys.argv[1:]
    DRAWN = numbers_to_draw(ARGUMENTS, "--seeds", 20, first=1)
    sys.exit(main("acceptance", lambda: measure(DRAWN), ARGUMENTS))
