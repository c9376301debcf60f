"""Run directories with one bit flipped or a file cut: read, read again, and gone on with."""

from __future__ import annotations

import os
import random
import shutil
import traceback
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from _corpus import EXAMPLES
from _fuzz import section_ends
from _processes import LASER_FAULTS

from tjscan.core.errors import TjscanError
from tjscan.job import read_scan_job
from tjscan.recording.damage import RecordingDamage
from tjscan.report.data import read_report_data
from tjscan.result.directory import JOB, RECORDING
from tjscan.result.table import read_sections_csv
from tjscan.runs.context import RunContext
from tjscan.runs.reprocess import reprocess_run
from tjscan.runs.scan import resume_scan, run_scan
from tjscan.scanning.progress import StopReason
from tjscan.scanning.reader import read_recorded_scan
from tjscan.scanning.section import ProfileView, ScannedSection

SECTIONS: Final = 3
SAME: Final = 1e-6
"""Metres: half of the last digit that a table states, and what rounding leaves."""

NO_FAULTS: Final = dict.fromkeys(
    (
        *(f"simulation.laser.{name}" for name in (*LASER_FAULTS, "resolution_mm")),
        *("simulation.arm.repeatability_mm", "simulation.arm.repeatability_deg"),
    ),
    0.0,
)
RESULTS: Final = ("sections.csv", "groove.ply", "scan.png", "summary.json", "uncertainty.json")


@dataclass(slots=True)
class SpoiltTally:
    """What became of spoilt run directories.

    Parameters
    ----------
    cases, refused, told : int
        How many uses of one, and of them how many were refused, or gave less and said so.
    silent, wrong : list of str
        Those that gave another result without a word, and those that ended in a traceback.
    """

    cases: int = 0
    refused: int = 0
    told: int = 0
    silent: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)


class _Events:
    """A journal that keeps the names of events."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def record_view(self, view: ProfileView) -> None:
        pass

    def record_section(self, scan: ScannedSection) -> None:
        pass

    def record_event(self, name: str, detail: str) -> None:
        self.names.append(name)


def make_runs(folder: Path) -> tuple[Path, Path]:
    """A finished run, noise off, and the same as if it had been killed behind a section."""
    whole, killed = folder / "whole", folder / "killed"
    job = read_scan_job(EXAMPLES / "paper.toml", {"scan.sections": SECTIONS, **NO_FAULTS})
    run_scan(RunContext(job, EXAMPLES / "paper.toml"), whole)
    shutil.copytree(whole, killed)
    for name in RESULTS:
        (killed / name).unlink(missing_ok=True)
    data = (killed / RECORDING).read_bytes()
    (killed / RECORDING).write_bytes(data[: section_ends(data)[1]])
    return whole, killed


def spoil_runs(folder: Path, runs: tuple[Path, Path], count: int, seed: int) -> SpoiltTally:
    """Flip a bit, or cut a file, of copies of the runs, and use each in every way.

    Parameters
    ----------
    folder : Path
        For the copies.
    runs : (Path, Path)
        As `make_runs` gives them.
    count, seed : int
        How many; the same seed spoils the same bits.
    """
    dice, tally = random.Random(seed), SpoiltTally()
    whole, killed = runs
    for number in range(count):
        run = killed if number % 4 == 3 else whole
        copy = folder / f"{seed}-{number}"
        shutil.copytree(run, copy)
        what = _spoil(dice, copy, flips=number % 2 == 0)
        uses = [_reprocess, _resume] if run is killed else [_read, _reprocess, _resume]
        for use in uses:
            tally.cases += 1
            name = f"{run.name}: {what}: {use.__name__[1:]}"
            try:
                said, changed = use(copy, whole, killed=run is killed)
            except TjscanError:
                tally.refused += 1
            except Exception:
                tally.wrong.append(f"{name}\n{traceback.format_exc()}")
            else:
                tally.told += said and changed
                if changed and not said:
                    tally.silent.append(name)
        shutil.rmtree(copy)
    return tally


def _spoil(dice: random.Random, run: Path, *, flips: bool) -> str:
    """Spoil a file, a recording as often as all others together."""
    names = sorted(file.name for file in run.iterdir() if file.suffix != ".png")
    file = run / (RECORDING if dice.random() < 0.5 else dice.choice(names))
    data = bytearray(file.read_bytes())
    place = dice.randrange(len(data))
    if flips:
        data[place] ^= 1 << dice.randrange(8)
        file.write_bytes(data)
    else:
        os.truncate(file, place)
    return f"{file.name} {'flipped' if flips else 'cut'} at {place} of {len(data)}"


def _read(run: Path, whole: Path, *, killed: bool) -> tuple[bool, bool]:
    """Whether something was said, and something differs, of what a report reads."""
    damages: list[RecordingDamage] = []
    found, right = read_report_data(run), read_report_data(whole)
    now, then = read_recorded_scan(run, damages.append), read_recorded_scan(whole)
    changed = (
        found.summary != right.summary
        or [repr(s) for s in found.sections] != [repr(s) for s in right.sections]
        or not _same(found.shape.points, right.shape.points)
        or [event.detail for event in now.events] != [event.detail for event in then.events]
        or len(now.views) != len(then.views)
        or not all(
            _same(getattr(a, name), getattr(b, name))
            for a, b in zip(now.views, then.views, strict=False)
            for name in ("T_b_f", "T_b_s", "q")
        )
        or not all(
            _same(a.profile.z_s, b.profile.z_s) for a, b in zip(now.views, then.views, strict=False)
        )
    )
    return bool(damages) or now.stop is StopReason.CUT, changed


def _reprocess(run: Path, whole: Path, *, killed: bool) -> tuple[bool, bool]:
    """The same of a run that is read again."""
    out = run.with_name(f"{run.name}-again")
    try:
        done = reprocess_run(run, {}, out)
        changed = not _same(_points(out), _points(whole)[: 2 if killed else SECTIONS])
    finally:
        shutil.rmtree(out, ignore_errors=True)
    (station,) = done.stations
    return not station.is_whole or not station.summary.complete, changed


def _resume(run: Path, whole: Path, *, killed: bool) -> tuple[bool, bool]:
    """The same of a run that is gone on with."""
    events = _Events()
    resume_scan(RunContext(read_scan_job(run / JOB), run / JOB, events))
    return "changed" in events.names, not _same(_points(run), _points(whole))


def _points(run: Path) -> Any:
    return np.array([section.points for section in read_sections_csv(run / "sections.csv")])


def _same(one: Any, other: Any) -> bool:
    if one is None or other is None:
        return one is other
    one, other = np.asarray(one), np.asarray(other)
    return one.shape == other.shape and bool(
        np.allclose(one, other, rtol=0, atol=SAME, equal_nan=True)
    )
