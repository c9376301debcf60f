"""Arms of ABB, KUKA and FANUC over their wires, against loopback controllers.

The same scan as the simulated arm's, and faults of the wire at random moments of a scan's moves: of
each one how it ends, whether the arm rests in time, and whether the recording holds all that was
measured. ``--faults N`` draws N of them for each maker instead of 200, ``--quick`` 20.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from _maker_jobs import ABB, FANUC, KUKA, SHORT, MakersArm
from _table import Row, main

from tjscan.core import errors
from tjscan.job.files import read_scan_job
from tjscan.recording.journal import CombinedJournal
from tjscan.runs.scan.run import ScanContext, scan_in_cell
from tjscan.scanning.journal import ScanResult
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import ProfileView, ScannedSection
from tjscan_loopback.process import ArmLoopbackProcess

FAULTS: Final = 200
QUICK_FAULTS: Final = 20
LATEST: Final = 5.0
"""Seconds of motion within which a fault comes."""

BRAKING: Final = 0.8
"""Seconds in which an arm brakes along its path at most, its lag and a smoothed end with it."""

SILENCE: Final = 4.0
"""Seconds for which a controller may be silent: it waits for a busy machine."""

FAULTLESS: Final[dict[str, Any]] = {
    **{
        f"simulation.laser.{name}": 0
        for name in ("noise_mm", "bias_mm", "dropout", "missing", "ghosts", "flyers")
    },
    "simulation.laser.resolution_mm": 0,
    "simulation.arm.repeatability_mm": 0,
    "simulation.arm.repeatability_deg": 0,
}

HARMLESS: Final = ("lose-answer", "late-answer", "lose-packet", "double-packet", "old-packet")
LOST, SILENT = errors.ArmConnectionLost, errors.ArmNotResponding
ENDS_IN: Final[dict[str, type[errors.ArmFault] | None]] = {
    **dict.fromkeys((*HARMLESS, "foreign-packet")),
    **dict.fromkeys(
        ("lose-answers", "lose-packets", "wrong-stamp", "wrong-type", "malformed"), LOST
    ),
    **dict.fromkeys(("frozen-stamp", "stop"), SILENT),
    "stop-program": errors.ProgramStopped,
    "stand": errors.ProtectiveStop,
}
"""What a fault of the wire ends in; None: the scan goes on."""


def ends_in(maker: MakersArm, fault: str) -> type[errors.ArmFault] | None:
    """What a fault of the wire ends in; None: the scan goes on."""
    return maker.stands_in if fault == "stand" else ENDS_IN[fault]


def driven(maker: MakersArm) -> dict[str, Any]:
    """Keys of a job whose arm is the controller's."""
    table = {"host": maker.host, "silence_s": SILENCE, "cycle_ms": float(maker.cycle_ms)}
    return {"arm.driver": maker.name, f"arm.{maker.name}": table}


class Counts:
    """A journal that counts what it is told."""

    def __init__(self) -> None:
        self.profiles = self.sections = 0

    def record(self, message: object) -> None:
        """Count a message."""
        self.profiles += isinstance(message, ProfileView)
        self.sections += isinstance(message, ScannedSection)


@contextmanager
def running(maker: MakersArm) -> Iterator[ArmLoopbackProcess]:
    """The maker's loopback controller."""
    with ArmLoopbackProcess(f"{maker.name}-loopback", maker.host, *maker.options) as loopback:
        yield loopback


def context_of(maker: MakersArm, keys: dict[str, Any]) -> ScanContext:
    """A short scan before an arm."""
    return ScanContext(read_scan_job(maker.job, SHORT | keys), maker.job)


def scan(maker: MakersArm, keys: dict[str, Any]) -> ScanResult:
    """Scan the paper's joint."""
    context = context_of(maker, keys)
    return scan_in_cell(context.make_cell(), context.job, CombinedJournal())


def difference_mm(maker: MakersArm, loopback: ArmLoopbackProcess) -> float:
    """Largest distance of a corner of the scan over the wire from the simulated arm's."""
    loopback.schedule_fault("home")
    one, other = scan(maker, FAULTLESS), scan(maker, FAULTLESS | driven(maker))
    if len(one.sections) != len(other.sections):
        return float("nan")
    pairs = zip(one.sections, other.sections, strict=True)
    return 1e3 * max(float(np.linalg.norm(a.points_b - b.points_b, axis=1).max()) for a, b in pairs)


@dataclass(frozen=True)
class Ended:
    """How a scan with a fault in it ended: at rest, its cause right, nothing lost."""

    rests: bool
    right: bool
    whole: bool


def end_of(maker: MakersArm, loopback: ArmLoopbackProcess, fault: str, cycles: int) -> Ended:
    """Scan with a fault in it."""
    loopback.schedule_fault("home")
    loopback.unread_output()
    loopback.schedule_fault(f"{fault} {cycles}".replace("stamp", maker.stamp))
    wanted, found, counts = ends_in(maker, fault), None, Counts()
    with TemporaryDirectory() as folder:
        directory = Path(folder) / "run"
        context = context_of(maker, {"scan.length_mm": 160.0} | driven(maker))
        context.make_run_directory(directory)
        cell = context.make_cell()
        with context.open_recording(directory) as journal:
            try:
                scan_in_cell(cell, context.job, CombinedJournal(journal, counts))
            except errors.TjscanError as error:
                found = error
        came = any(line.startswith("fault ") for line in loopback.unread_output())
        before, truth = loopback.ask_for_truth(), loopback.ask_for_truth()
        recorded = read_recorded_scan(directory)
    right = found is None if wanted is None or not came else type(found) is wanted
    rests = before["q_deg"] == truth["q_deg"]
    if wanted is not None and came:
        rests = rests and truth["rest_after_s"] <= maker.time_out + BRAKING
    whole = (len(recorded.views), len(recorded.sections)) == (counts.profiles, counts.sections)
    if not (right and rests and whole):
        print(f"{maker.name} {fault} {cycles}: {found!r} {truth} {whole}", file=sys.stderr)
    return Ended(rests, right, whole)


def measure(count: int) -> Iterator[Row]:
    """Measure every bar."""
    for maker in (ABB, KUKA, FANUC):
        with running(maker) as loopback:
            apart = difference_mm(maker, loopback)
            yield Row(f"{maker.name}: corners over its loopback, apart", apart, 0.02, "mm")
            random = np.random.default_rng([36, count])
            since, ends = time.monotonic(), []
            for k in range(count):
                fault = list(ENDS_IN)[k % len(ENDS_IN)]
                ends.append(
                    end_of(
                        maker,
                        loopback,
                        fault,
                        int(random.uniform(1, 1e3 * LATEST / maker.cycle_ms)),
                    )
                )
            name = f"{maker.name}: {count} faults of the wire"
            for what, good, least in (
                ("at rest in its time-out and a ramp", [end.rests for end in ends], 100),
                ("right cause named", [end.right for end in ends], 95),
                ("all that was measured is read", [end.whole for end in ends], 100),
            ):
                yield Row(f"{name}, {what}", 100 * float(np.mean(good)), 100, "%", at_least=least)
            mean = (time.monotonic() - since) / count
            yield Row(f"{name}, each", mean, np.inf, "s", at_least=0.0)


if __name__ == "__main__":
    words, faults = sys.argv[1:], FAULTS
    if "--quick" in words:
        words.remove("--quick")
        faults = QUICK_FAULTS
    if "--faults" in words:
        at = words.index("--faults")
        faults = int(words[at + 1])
        del words[at : at + 2]
    sys.exit(main("Arms of three makers over their wires", lambda: measure(faults), words))
