"""Scans in processes of their own, that are killed or run out of room, and what is left of them."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from _corpus import EXAMPLES

from tjscan.core.errors import TjscanError
from tjscan.core.frames import Array
from tjscan.recording.parts import recording_files
from tjscan.result.directory import JOB_FILE
from tjscan.scanning.recording import read_recorded_scan

SECTIONS: Final = 8
LASER_FAULTS: Final = ("noise_mm", "bias_mm", "dropout", "missing", "ghosts", "flyers")
JOB_OPTIONS: Final = [
    str(EXAMPLES / "paper.toml"),
    *(f"--scan.sections={SECTIONS}", "--simulation.laser.resolution_mm=0"),
    *(f"--simulation.laser.{name}=0" for name in LASER_FAULTS),
    *("--simulation.arm.repeatability_mm=0", "--simulation.arm.repeatability_deg=0"),
    # In real time, so that a kill finds the arm on its way; fast, so that many fit in a soak.
    *("--arm.speed_mm_s=2000", "--arm.acceleration_mm_s2=20000", "--simulation.arm.realtime=true"),
]
NO_REPORT: Final = """
import tjscan.report.write
tjscan.report.write.write_run_report = lambda directory: None
"""
"""Run before a scan goes on: a report takes most of its time, and is not looked at."""

TRACE: Final = "Traceback"
SAME_MM: Final = 1e-9
LONGEST: Final = 120.0
"""Seconds after which a scan hangs."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a scan that was broken off, and gone on with, came to.

    Parameters
    ----------
    complete : bool
        Whether it went on to its end.
    kept : bool
        Whether every byte recorded before is still there.
    apart_mm : float
        Largest distance of its corners from those of the unbroken scan.
    told : str
        What was said, where something is wrong.
    """

    complete: bool
    kept: bool
    apart_mm: float
    told: str = ""


def scan(*arguments: object, first: str = "") -> subprocess.Popen[bytes]:
    """Begin ``tjscan scan`` in a process of its own; `first` is run before."""
    script = f"{first}\nimport sys\nfrom tjscan.cli import main\nmain(sys.argv[1:])"
    command = [sys.executable, "-c", script, "scan", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def finish(process: subprocess.Popen[bytes]) -> tuple[int, str]:
    """Exit code and words of a process."""
    _, told = process.communicate(timeout=LONGEST)
    return process.returncode, told.decode(errors="replace")


def corners(run: Path) -> Array:
    """The five points of every section as recorded, mm, shape (n, 5, 3)."""
    found = read_recorded_scan(run).sections
    return 1e3 * np.array([found[i].points_b for i in sorted(found)])


def unbroken(run: Path, options: Sequence[str] = JOB_OPTIONS) -> tuple[Array, float]:
    """Scan without a break; gives its corners, and the seconds that it took."""
    began = time.perf_counter()
    code, told = finish(scan(*options, "--out", run))
    if code:
        raise SystemExit(told)
    return corners(run), time.perf_counter() - began


def killed(run: Path, whole: Array, life: float, seed: int) -> Outcome | None:
    """Kill a scan at a random moment of its life, and go on with it; None where it had ended.

    A third of them is killed once more while it goes on.
    """
    dice = random.Random(seed)
    if not _kill(scan(*JOB_OPTIONS, "--out", run), dice.uniform(0, life)):
        return None
    if dice.random() < 1 / 3 and (run / JOB_FILE).exists():
        _kill(scan("--resume", run), dice.uniform(0, life))
    return go_on(run, whole)


def go_on(
    run: Path, whole: Array, options: Sequence[str] = JOB_OPTIONS, *, same_mm: float = SAME_MM
) -> Outcome:
    """Go on with a scan that was broken off, and hold it against the unbroken one."""
    before = {file: file.read_bytes() for file in recording_files(run) if file.exists()}
    begun = (run / JOB_FILE).exists()
    again: list[Any] = ["--resume", run] if begun else [*options, "--out", run]
    code, told = finish(scan(*again, "--simulation.arm.realtime=false", first=NO_REPORT))
    kept = all(file.read_bytes() == data for file, data in before.items())
    try:
        found = corners(run)
        apart = float(np.abs(found - whole).max()) if found.shape == whole.shape else np.inf
        complete = bool(json.loads((run / "summary.json").read_text())["complete"])
    except (OSError, TjscanError) as error:
        return Outcome(False, kept, np.inf, f"{told}\n{error}")
    right = code == 0 and complete and kept and apart <= same_mm
    return Outcome(code == 0 and complete, kept, apart, "" if right else told)


def _kill(process: subprocess.Popen[bytes], after: float) -> bool:
    """Kill a process after some seconds; False where it ended before."""
    try:
        process.communicate(timeout=after)
        return False
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
        process.communicate()
        return True


def without_room(run: Path, whole: Array, room: int) -> tuple[bool, Outcome]:
    """Scan where no file may grow beyond `room` bytes, and go on where there is room again.

    Returns
    -------
    bool
        Whether the first scan ended in one clear error.
    Outcome
        What it came to.
    """
    limit = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room}))"
    code, told = finish(scan(*JOB_OPTIONS, "--out", run, first=limit))
    return _is_clear(code, told), go_on(run, whole)


def _is_clear(code: int, told: str) -> bool:
    """Whether a scan said once and in words that it could not write."""
    return code == 1 and told.count("tjscan: ") == 1 and "can't be" in told and TRACE not in told


def on_a_small_disk(disk: Path, whole: Array, room: int) -> tuple[bool, Outcome] | None:
    """The same on a file system of its own that is full; None where mounting is not permitted."""
    disk.mkdir(parents=True)
    options = ["-t", "tmpfs", "-o", f"size={max(room, 64_000)}", "tmpfs", str(disk)]
    if os.geteuid() or subprocess.run(["mount", *options], capture_output=True).returncode:
        return None
    try:
        code, told = finish(scan(*JOB_OPTIONS, "--out", disk / "run"))
        subprocess.run(["mount", "-o", "remount,size=50m", str(disk)], check=True)
        return _is_clear(code, told), go_on(disk / "run", whole)
    finally:
        subprocess.run(["umount", str(disk)], check=False)
