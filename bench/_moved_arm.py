"""Scans that were cut off, and go on after somebody moved the arm to a place drawn by lot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from _corpus import EXAMPLES
from _fuzz import section_ends
from _run_uses import NO_FAULTS

from tjscan.core.errors import PoseUnreachable
from tjscan.core.frames import Array
from tjscan.job.cell import Cell
from tjscan.job.files import read_scan_job
from tjscan.recording.journal import CombinedJournal
from tjscan.result.directory import RECORDING_FILE
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.scan.run import ScanContext, run_scan, scan_in_cell
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import ProfileView

FILE: Final = EXAMPLES / "paper.toml"
JOB: Final = read_scan_job(FILE, NO_FAULTS)

JOGS: Final = 6
"""By which the arm is moved."""

SHARES: Final = (1.0, 0.5, 0.2, 0.05)
"""Of the way to a posture: the first that is clear is gone."""


@dataclass(frozen=True, slots=True)
class Resumed:
    """What came of one.

    Parameters
    ----------
    refused : bool
        Whether it was refused, with the arm where it stood.
    apart_mm : float
        Largest distance of a corner from the unbroken scan's; infinite where it has others.
    told : str
        Where it stood, and what was said, if it did not come to the unbroken scan.
    """

    refused: bool
    apart_mm: float
    told: str = ""


def scan_whole(run: Path) -> None:
    """Scan without a break, noise off."""
    run_scan(ScanContext(JOB, FILE), run)


def resume_from_elsewhere(whole: Path, seed: int) -> Resumed:
    """Cut a scan off after a section, move the arm, and go on.

    Parameters
    ----------
    whole : Path
        Its run directory, with nothing missing; it stays as it is.
    seed : int
        Of the section, and of the postures towards which the arm was jogged one after another,
        as far as its cell lets it.
    """
    dice = np.random.default_rng(seed)
    data = (whole / RECORDING_FILE).read_bytes()
    end = int(dice.choice(section_ends(data)[1:-1]))
    with TemporaryDirectory() as name:
        (Path(name) / RECORDING_FILE).write_bytes(data[:end])
        done = read_recorded_scan(Path(name))
    cell, q = _cell_elsewhere(dice, done.views[-1])
    where = f"seed {seed}, section {len(done.sections)}, {np.degrees(q).round().tolist()}"
    try:
        result = scan_in_cell(cell, JOB, CombinedJournal(), done)
    except PoseUnreachable as error:
        with cell.arm as arm:
            stayed = np.array_equal(arm.state().q, q)
        return Resumed(stayed, np.inf, f"{where}: {error}")
    found = np.array([section.points_b for section in result.sections])
    recorded = read_recorded_scan(whole).sections
    right = np.array([recorded[index].points_b for index in sorted(recorded)])
    apart = 1e3 * float(np.abs(found - right).max()) if found.shape == right.shape else np.inf
    return Resumed(False, apart, "" if np.isfinite(apart) else f"{where}: {result.detail}")


def _cell_elsewhere(dice: np.random.Generator, last: ProfileView) -> tuple[Cell, Array]:
    """A cell whose arm was jogged away from the last view, and its joint angles now."""
    context, arm = ScanContext(JOB, FILE), Kinematics.load(JOB.arm.model)
    clearance = context.make_cell().clearance
    q = last.q
    for _ in range(JOGS):
        way = dice.uniform(-np.pi, np.pi, len(q)) - q
        far = next((share for share in SHARES if clearance.line_is_clear(q, q + share * way)), 0.0)
        q = q + far * way
    return context.make_cell(left=replace(last, q=q, T_b_f=arm.forward(q))), q
