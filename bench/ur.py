"""The real arm's driver against the loopback controller: every fault, again and again."""

from __future__ import annotations

import sys
from itertools import cycle, islice
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from threading import Thread, Timer
from time import perf_counter
from typing import Any, Final

import numpy as np
from _table import Row, main

from tjscan.core.errors import (
    ArmConnectionLost,
    ArmFault,
    ArmNotInRemoteMode,
    ArmNotPowered,
    ArmNotResponding,
    EmergencyStop,
    PoseNotReached,
    ProgramStopped,
    ProtectiveStop,
    TargetRefused,
)
from tjscan.core.frames import Array, pose
from tjscan.job.files import read_scan_job
from tjscan.recording.journal import CombinedJournal
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.ur.arm import UrArm
from tjscan.robot.ur.settings import UrSettings
from tjscan.runs.scan.run import ScanContext, run_scan, scan_in_cell
from tjscan.scanning.journal import ScanResult
from tjscan.scanning.recording import read_recorded_scan
from tjscan_loopback.process import UrLoopbackProcess
from tjscan_loopback.ur.faults import InjectedFault

PAPER: Final = Path(__file__).resolve().parents[1] / "examples" / "paper.toml"
HOSTS: Final = ("127.0.0.2", "127.0.0.3")
HOME: Final = np.radians([-110, -95, 160, 105, -110, 0])
KINEMATICS: Final = Kinematics.load("ur10e")

ROUNDS: Final = 5
RANDOM_FAULTS: Final = 100
LONGEST_SCAN: Final = 1.5
"""Seconds from the start of a scan within which a random fault comes."""

ENDS_IN: Final[dict[InjectedFault, type[ArmFault]]] = {
    InjectedFault.PROTECTIVE_STOP: ProtectiveStop,
    InjectedFault.EMERGENCY_STOP: EmergencyStop,
    InjectedFault.POWER_OFF: ArmNotPowered,
    InjectedFault.LOCAL_MODE: ArmNotInRemoteMode,
    InjectedFault.DROP_LINK: ArmConnectionLost,
    InjectedFault.FREEZE: ArmNotResponding,
    InjectedFault.REFUSE_TARGETS: TargetRefused,
    InjectedFault.STOP_PROGRAM: ProgramStopped,
    InjectedFault.MISS_TARGET: PoseNotReached,
}
FAULTLESS: Final[dict[str, Any]] = {
    **{
        f"simulation.laser.{name}": 0
        for name in ("noise_mm", "bias_mm", "dropout", "missing", "ghosts", "flyers")
    },
    "simulation.laser.resolution_mm": 0,
    "simulation.arm.repeatability_mm": 0,
    "simulation.arm.repeatability_deg": 0,
}


def beside_home(x: float) -> Array:
    """Flange pose some metres beside where the controller starts."""
    return pose(p=(x, 0.0, 0.0)) @ KINEMATICS.forward(HOME)


def arm_at(host: str) -> UrArm:
    """The driver for a controller."""
    return UrArm(KINEMATICS, UrSettings(host))


def park(loopback: UrLoopbackProcess) -> None:
    """Set a controller right, and its arm where it started."""
    loopback.schedule_fault("clear")
    loopback.schedule_fault("home")


def driven(host: str) -> dict[str, Any]:
    """Keys of a job whose arm is the controller's."""
    return {"arm.driver": "ur", "arm.ur": {"host": host}}


def scan(keys: dict[str, Any]) -> ScanResult:
    """Scan the paper's joint."""
    job = read_scan_job(PAPER, keys)
    return scan_in_cell(ScanContext(job, PAPER).make_cell(), job, CombinedJournal())


def difference_mm(loopback: UrLoopbackProcess) -> float:
    """Largest distance of a corner of the scan over the wire from the simulated arm's."""
    park(loopback)
    one, other = scan(FAULTLESS), scan(FAULTLESS | driven(loopback.host))
    if len(one.sections) != len(other.sections):
        return float("nan")
    pairs = zip(one.sections, other.sections, strict=True)
    return 1e3 * max(float(np.abs(a.points_b - b.points_b).max()) for a, b in pairs)


def as_it_should(loopback: UrLoopbackProcess, fault: InjectedFault) -> tuple[bool, float]:
    """Whether a fault in a move ends in its error, and the seconds that took."""
    park(loopback)
    with arm_at(loopback.host) as arm:
        now = fault in (InjectedFault.REFUSE_TARGETS, InjectedFault.MISS_TARGET)
        loopback.schedule_fault(str(fault) if now else f"{fault} 1")
        start = perf_counter()
        try:
            arm.move_linear(beside_home(0.08))
        except ArmFault as error:
            return type(error) is ENDS_IN[fault], perf_counter() - start
    return False, perf_counter() - start


def survives(loopback: UrLoopbackProcess, fault: InjectedFault, seconds: float, move: int) -> bool:
    """Whether a scan with a fault in it ends in that fault, with a recording that reads."""
    park(loopback)
    timer = Timer(
        0.0 if move else seconds, loopback.schedule_fault, [f"{fault} {move}" if move else fault]
    )
    timer.start()
    job = read_scan_job(PAPER, driven(loopback.host))
    with TemporaryDirectory() as folder:
        try:
            run_scan(ScanContext(job, PAPER), Path(folder) / "run")
            known = True  # the fault came after the last move
        except ArmFault as error:
            known = type(error) in ENDS_IN.values()
            if not known:
                print(f"{fault}: ended in {error!r}", file=sys.stderr)
        timer.join()
        read_recorded_scan(Path(folder) / "run")
        return known


def side_by_side(*loopbacks: UrLoopbackProcess) -> int:
    """How many of the arms scan to the end when all scan at once."""
    found: list[ScanResult] = []
    for loopback in loopbacks:
        park(loopback)
    threads = [
        Thread(target=lambda host=one.host: found.append(scan(driven(host)))) for one in loopbacks
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return sum(len(result.sections) == 16 for result in found)


def clients_left() -> int:
    """How many processes of the client library this process has left behind."""
    children = Path("/proc/self/task").glob("*/children")
    pids = [pid for file in children for pid in file.read_text(encoding="ascii").split()]
    return sum(b"ur.client" in Path(f"/proc/{pid}/cmdline").read_bytes() for pid in pids)


def measure() -> list[Row]:
    """Measure every bar."""
    random = np.random.default_rng(1)
    rows = []
    with (
        UrLoopbackProcess(HOSTS[0], "--fast") as first,
        UrLoopbackProcess(HOSTS[1], "--fast") as second,
    ):
        rows.append(Row("same scan over the wire: corners apart", difference_mm(first), 0.01, "mm"))
        for fault in ENDS_IN:
            found = [as_it_should(first, fault) for _ in range(ROUNDS)]
            name = f"{fault}: ends in its error, {ROUNDS} times"
            right = sum(good for good, _ in found)
            rows.append(Row(name, right, ROUNDS, at_least=ROUNDS))
            rows.append(Row(f"{fault}: slowest", max(s for _, s in found), 5, "s"))
        readable, seconds = 0, []
        for fault in islice(cycle(ENDS_IN), RANDOM_FAULTS):
            start = perf_counter()
            move = int(random.integers(1, 30)) if random.random() < 0.5 else 0
            readable += survives(first, fault, random.uniform(0, LONGEST_SCAN), move)
            seconds.append(perf_counter() - start)
        rows += [
            Row(
                "random faults: ends as it should, recording reads",
                readable,
                RANDOM_FAULTS,
                "",
                RANDOM_FAULTS,
            ),
            Row("random faults: slowest scan", max(seconds), 30, "s"),
            Row("random faults: median scan", median(seconds), 30, "s"),
            Row("two arms side by side: scans finished", side_by_side(first, second), 2, "", 2),
        ]
    rows.append(Row("processes of the client left behind", clients_left(), 0))
    return rows


if __name__ == "__main__":
    sys.exit(main("The real arm's driver against the loopback controller", measure, sys.argv[1:]))
