"""Tows with vehicles behind a real broker, in processes of their own, while something breaks."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final

import numpy as np
from _tows import EXAMPLES

from tjscan.core.errors import TjscanError
from tjscan.job.tow_reading import read_tow_job
from tjscan.runs.tow_results import read_recorded_tow
from tjscan.vehicle.loopback.broker import MosquittoProcess
from tjscan.vehicle.loopback.process import VehicleLoopbackProcess

PROGRAM: Final = (sys.executable, "-c", "from tjscan.cli import main; main()", "tow", "run")
START_LIMIT: Final = 240.0
"""Seconds in which a tow starts; a busy machine takes its time."""

LONGEST: Final = 120.0
"""Seconds after which a tow hangs."""

KEYS: Final = (
    "--vehicles.driver=mqtt",
    "--seam.points-mm=[[2600, -300], [2600, -200]]",
    "--following.patience-s=8",
)

BEND: Final = float(np.degrees(read_tow_job(EXAMPLES / "tow-simulation.toml").chain.joint_limit))
"""Degrees that a joint may be bent."""

BROKER_KILLED: Final = "broker killed"
BROKER_STARTED: Final = "broker started"
PROGRAM_KILLED: Final = "program killed"
INTERRUPTED: Final = "interrupted"


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """What goes wrong in a tow, and when.

    Parameters
    ----------
    orders : tuple of (float, str)
        Seconds after its start, and what then: a line for the loopback, or one of the words above.
    """

    orders: tuple[tuple[float, str], ...]


@dataclass(frozen=True, slots=True)
class FaultOutcome:
    """What came of it.

    Parameters
    ----------
    sound : bool
        Whether nothing was touched and nothing lost, and the tow ended with a stated cause.
    words : str
        How it ended, and what was wrong.
    """

    sound: bool
    words: str


def _for_a_while(fault: str, seconds: float = 2.0) -> FaultPlan:
    return FaultPlan(((2.0, fault), (2.0 + seconds, "clear")))


FAULTS: Final[dict[str, FaultPlan]] = {
    "a vehicle stops for good": FaultPlan(((2.0, "stop 3"),)),
    "broker killed and restarted": FaultPlan(((2.0, BROKER_KILLED), (3.0, BROKER_STARTED))),
    "program killed and resumed": FaultPlan(((3.0, PROGRAM_KILLED),)),
    "Ctrl-C": FaultPlan(((3.0, INTERRUPTED),)),
    "a vehicle is pushed": FaultPlan(((2.0, "push 3"),)),
    "noise": FaultPlan(((2.0, "pose-noise"),)),
    "poses late": FaultPlan(((2.0, "pose-late"),)),
    "poses out of order": FaultPlan(((2.0, "pose-disorder"),)),
    "poses frozen": _for_a_while("pose-frozen 2"),
    "poses jump": _for_a_while("pose-jump 4"),
    "poses swapped": _for_a_while("pose-swap 3"),
    "poses lost": _for_a_while("pose-lost 5"),
    "NaN in poses": _for_a_while("pose-nan 2"),
    "NaN in states": _for_a_while("nan 2"),
    "a clock jumps": _for_a_while("pose-clock 2"),
    "a vehicle's link is cut": _for_a_while("drop-link 2"),
    "a vehicle's computer freezes": _for_a_while("freeze 2"),
    "a drive fails": FaultPlan(((2.0, "drive-fault 4"),)),
}


def random_fault(seed: int) -> FaultPlan:
    """One to three faults of any kind at any time."""
    rng = np.random.default_rng(seed)
    names = list(FAULTS)
    orders: list[tuple[float, str]] = []
    for _ in range(int(rng.integers(1, 4))):
        plan, shift = FAULTS[names[int(rng.integers(len(names)))]], float(rng.uniform(-1.5, 3.0))
        orders += [(at + shift, what) for at, what in plan.orders]
    kinds = [what for _, what in orders]
    if PROGRAM_KILLED in kinds:  # nothing is heard of a program that was killed
        orders = [one for one in orders if one[1] != INTERRUPTED]
    return FaultPlan(tuple(sorted(orders)))


def fault_over_broker(plan: FaultPlan, *, seed: int) -> FaultOutcome:
    """Tow a little with vehicles behind a broker of its own while things go wrong."""
    job = EXAMPLES / "tow-simulation.toml"
    with tempfile.TemporaryDirectory() as folder, MosquittoProcess() as broker:
        settings = Path(folder) / "job.toml"
        text = job.read_text(encoding="utf-8")
        begin = text.index("points_mm"), text.index("speed_mm_min")
        piece = "points_mm = [[2600, -300], [2600, -200]]\n"
        settings.write_text(text[: begin[0]] + piece + text[begin[1] :], encoding="utf-8")
        options = ("--vehicles", "6", "--settings", str(settings), "--seed", str(seed))
        with VehicleLoopbackProcess(broker.address, *options) as vehicles:
            out = Path(folder) / "run"
            port = f"--vehicles.mqtt.port={broker.port}"
            first = [str(settings), *KEYS, port, "--out", str(out)]
            ended, said = _run(first, plan, broker, vehicles)
            if any(what == PROGRAM_KILLED for _, what in plan.orders) and ended == -signal.SIGKILL:
                vehicles.schedule_fault("clear")
                ended, more = _run(["--resume", str(out)], FaultPlan(()), broker, vehicles)
                said += more
            truth = vehicles.ask_for_truth()
        return _judge(out, ended, said, truth)


def _run(
    arguments: list[str],
    plan: FaultPlan,
    broker: MosquittoProcess,
    vehicles: VehicleLoopbackProcess,
) -> tuple[int, list[str]]:
    """Exit code, and what was said."""
    process = subprocess.Popen(
        [*PROGRAM, *arguments], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    )
    lines: SimpleQueue[str] = SimpleQueue()
    assert process.stderr is not None
    pipe = process.stderr

    def read() -> None:
        for line in pipe:
            lines.put(line)

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    said: list[str] = []
    limit, began = time.monotonic() + START_LIMIT, None
    while process.poll() is None and began is None and time.monotonic() < limit:
        try:
            said.append(lines.get(timeout=0.1))
        except Empty:
            continue
        if "start:" in said[-1]:
            began = time.monotonic()
    for at, what in plan.orders if began is not None else ():
        time.sleep(max(0.0, (began or 0.0) + at - time.monotonic()))
        if process.poll() is not None:
            break
        _order(what, process, broker, vehicles)
    try:
        ended = process.wait(LONGEST)
    except subprocess.TimeoutExpired:
        process.kill()
        ended = process.wait()
        said.append("it hangs")
    reader.join()
    while not lines.empty():
        said.append(lines.get())
    return ended, said


def _order(
    what: str,
    process: subprocess.Popen[str],
    broker: MosquittoProcess,
    vehicles: VehicleLoopbackProcess,
) -> None:
    if what == BROKER_KILLED:
        broker.kill()
    elif what == BROKER_STARTED:
        broker.start()
    elif what == PROGRAM_KILLED:
        os.kill(process.pid, signal.SIGKILL)
    elif what == INTERRUPTED:
        os.kill(process.pid, signal.SIGINT)
    else:
        vehicles.schedule_fault(what)


def _judge(out: Path, ended: int, said: list[str], truth: dict[str, Any]) -> FaultOutcome:
    wrong = [f"touched: {one}" for one in truth["touches"][:1]]
    if truth["bend_deg"] > BEND:
        wrong.append(f"a joint was bent by {truth['bend_deg']:.1f}°")
    if any("Traceback" in line for line in said):
        wrong.append("it ended in a traceback")
    if any("it hangs" in line for line in said):
        wrong.append("it hangs")
    try:
        recorded = read_recorded_tow(out)
        if not recorded.cycles:
            wrong.append("nothing was recorded")
        if ended == 0 and not recorded.complete:
            wrong.append("it says that all is welded, and it is not")
    except TjscanError as error:
        wrong.append(f"its recording is lost: {error}")
    if not (out / "report.html").is_file():
        wrong.append("there is no report")
    stated = {0: "welded", 1: "halted", 4: "stopped by a device", 130: "interrupted"}
    if ended not in stated:
        wrong.append(f"exit code {ended}")
    return FaultOutcome(not wrong, "; ".join([stated.get(ended, "?"), *wrong]))
