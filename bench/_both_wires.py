"""Scans with arm and laser both over the wire: as they should be, and broken off."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from _lasers import address
from _processes import JOB_OPTIONS, Outcome, corners, finish, go_on, unbroken
from _processes import scan as begin_scan
from _table import Row

from tjscan.core.frames import Array
from tjscan.job.files import read_scan_job
from tjscan.recording.journal import CombinedJournal
from tjscan.runs.scan.run import ScanContext, scan_in_cell
from tjscan.scanning.section import ProfileView
from tjscan_loopback.process import LaserLoopbackProcess, UrLoopbackProcess

PAPER: Final = Path(__file__).resolve().parents[1] / "examples" / "paper.toml"
HALF_COUNT_MM: Final = 0.0025
SAME_MM: Final = 0.005
"""Corners of a scan that was gone on with, from those of the unbroken one."""


class Views:
    """A journal that keeps the views."""

    def __init__(self) -> None:
        self.views: list[ProfileView] = []

    def record(self, message: object) -> None:
        """Keep a view."""
        if isinstance(message, ProfileView):
            self.views.append(message)


def scan(arm: UrLoopbackProcess, keys: dict[str, Any]) -> tuple[list[ProfileView], Array]:
    """Views of a scan of the paper's joint with the loopback arm, and its corners."""
    arm.schedule_fault("clear")
    arm.schedule_fault("home")
    job = read_scan_job(PAPER, {"arm.driver": "ur", "arm.ur": {"host": arm.host}} | keys)
    journal = Views()
    result = scan_in_cell(ScanContext(job, PAPER).make_cell(), job, CombinedJournal(journal))
    return journal.views, np.array([section.points_b for section in result.sections])


def whole_scan() -> list[Row]:
    """The same scan with the simulated laser and over the wire, points and corners apart."""
    host = address()
    with (
        UrLoopbackProcess(address(), "--fast") as arm,
        LaserLoopbackProcess(host, str(PAPER), "--arm", arm.host) as laser,
    ):
        one, corners_one = scan(arm, {})
        wire = {"laser.driver": "genicam", "laser.genicam": {"address": laser.host}}
        other, corners_other = scan(arm, wire)
    apart, corner = np.nan, np.nan
    if len(one) == len(other) and corners_one.shape == corners_other.shape:
        pairs = [(a.profile, b.profile) for a, b in zip(one, other, strict=True)]
        same = all(np.array_equal(a.valid, b.valid) for a, b in pairs)
        gaps = [np.abs(a.points_s - b.points_s).max() for a, b in pairs] if same else [np.nan]
        apart, corner = 1e3 * max(gaps), 1e3 * float(np.abs(corners_one - corners_other).max())
    return [
        Row("whole scan over the wire: points apart", apart, HALF_COUNT_MM, "mm"),
        Row("whole scan over the wire: corners apart", corner, 0.005, "mm"),
    ]


def broken_off(rounds: int) -> list[Row]:
    """Scans over both wires that are killed, or whose laser or arm is cut off, and gone on with."""
    random, outcomes = Random(7), []
    with (
        TemporaryDirectory() as folder,
        UrLoopbackProcess(address(), "--fast") as arm,
        LaserLoopbackProcess(address(), str(PAPER), "--arm", arm.host, *_faultless()) as laser,
    ):
        wires = ["--arm.driver=ur", f"--arm.ur.host={arm.host}"]
        wires += ["--laser.driver=genicam", f"--laser.genicam.address={laser.host}"]
        options = [*JOB_OPTIONS, *wires]
        whole, life = unbroken(Path(folder, "whole"), options)
        for k in range(rounds):
            for process in (arm, laser):
                process.schedule_fault("clear")
            arm.schedule_fault("home")
            run, after = Path(folder, str(k)), random.uniform(0.0, life)
            _break_off(
                begin_scan(*options, "--out", run),
                ("kill", "laser", "arm")[k % 3],
                after,
                arm,
                laser,
            )
            for process in (arm, laser):
                process.schedule_fault("clear")
            if not (run / "scan.mcap").exists():
                arm.schedule_fault("home")
            outcomes.append(_gone_on(run, whole, options))
    return [
        Row(
            "killed or cut over both wires: recordings whole",
            sum(o.kept for o in outcomes),
            rounds,
            "",
            rounds,
        ),
        Row(
            "killed or cut over both wires: gone on to the end",
            sum(o.complete for o in outcomes),
            rounds,
            "",
            rounds,
        ),
        Row(
            "killed or cut over both wires: corners from the unbroken scan's",
            max(o.apart_mm for o in outcomes),
            SAME_MM,
            "mm",
        ),
    ]


def _faultless() -> list[str]:
    return [option for option in JOB_OPTIONS if option.startswith("--simulation.laser")]


def _break_off(
    process: subprocess.Popen[bytes],
    how: str,
    after: float,
    arm: UrLoopbackProcess,
    laser: LaserLoopbackProcess,
) -> None:
    """Kill a scan after some seconds, or cut off one of its devices and wait for its end."""
    with suppress(subprocess.TimeoutExpired):
        process.communicate(timeout=after)
        return
    if how == "kill":
        process.kill()
        process.communicate()
        return
    if how == "laser":
        laser.schedule_fault("silent")
    else:
        arm.schedule_fault("drop-link")
    finish(process)


def _gone_on(run: Path, whole: Array, options: Sequence[str]) -> Outcome:
    if (run / "summary.json").exists() and corners(run).shape == whole.shape:
        return Outcome(True, True, float(np.abs(corners(run) - whole).max()))
    found = go_on(run, whole, options, same_mm=SAME_MM)
    if found.told:
        print(found.told, file=sys.stderr)
    return found
