"""Tows with vehicles behind a real broker, in processes of their own, while something breaks."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final

import numpy as np
import tomli_w
from _tows import EXAMPLES, Tow, passer_by

from tjscan.core.config import table_to_dict
from tjscan.core.errors import TjscanError
from tjscan.job.tow.job import read_tow_job
from tjscan.runs.tow.results import read_recorded_tow
from tjscan_loopback.broker import MosquittoProcess
from tjscan_loopback.process import VehicleLoopbackProcess

PROGRAM: Final = (sys.executable, "-c", "from tjscan.cli import main; main()", "tow", "run")
START_LIMIT: Final = 240.0
"""Seconds in which a tow starts; a busy machine takes its time."""

LONGEST: Final = 120.0
"""Seconds after which a tow hangs."""

KEYS: Final = ("--vehicles.driver=mqtt", "--following.patience-s=8")

PIECE: Final = Tow("tow-simulation", {"seam.points_mm": [[2600.0, -300.0], [2600.0, -200.0]]})
"""What is towed, unless a fault needs something else."""

BEND: Final = float(np.degrees(read_tow_job(EXAMPLES / "tow-simulation.toml").chain.joint_limit))
"""Degrees that a joint may be bent."""

KEPT_UP: Final = 0.9
"""Share of real time below which the simulated world did not keep up with its vehicles' orders:
they are then seen to drive slower than they are told."""

NOBODY_WALKS: Final = "passer-stands"
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
    tow : Tow, optional
        What is towed.
    """

    orders: tuple[tuple[float, str], ...]
    tow: Tow = PIECE


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


def _somebody_stops(near: float = 0.4) -> FaultPlan:
    """Who heads for the cable comes as near to where it lay, metres, and stands there for good."""
    tow = passer_by(1)
    (path,) = tow.keys["obstacles"]
    start, end = np.array(path["points_mm"])
    towards = start + 2000.0 * (end - start) / np.linalg.norm(end - start)
    begin = towards + 0.6 * (start - towards)  # nearer than there, to be quick
    speed = 25.0
    path = {**path, "points_mm": np.array((begin, end)).tolist(), "speed_mm_min": 60 * speed}
    at = (float(np.linalg.norm(towards - begin)) - 1e3 * near) / speed
    keys = {**tow.keys, "obstacles": [path], "seam.stand_s": at + 15.0}
    return FaultPlan(((at, NOBODY_WALKS),), Tow(tow.job, keys))


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
    "somebody stops in the way": _somebody_stops(),
}


def random_fault(seed: int) -> FaultPlan:
    """One to three faults of any kind at any time."""
    rng = np.random.default_rng(seed)
    names = list(FAULTS)
    orders: list[tuple[float, str]] = []
    tow = PIECE
    for _ in range(int(rng.integers(1, 4))):
        plan, shift = FAULTS[names[int(rng.integers(len(names)))]], float(rng.uniform(-1.5, 3.0))
        tow = tow if plan.tow is PIECE else plan.tow
        orders += [(at + shift, what) for at, what in plan.orders]
    kinds = [what for _, what in orders]
    if PROGRAM_KILLED in kinds:  # nothing is heard of a program that was killed
        orders = [one for one in orders if one[1] != INTERRUPTED]
    return FaultPlan(tuple(sorted(orders)), tow)


def fault_over_broker(plan: FaultPlan, *, seed: int) -> FaultOutcome:
    """Tow a little with vehicles behind a broker of its own while things go wrong.

    Nobody walks but while a program plans: who comes to a cable that nobody moves touches it.
    """
    job = read_tow_job(EXAMPLES / f"{plan.tow.job}.toml", plan.tow.keys)
    with tempfile.TemporaryDirectory() as folder, MosquittoProcess() as broker:
        settings = Path(folder) / "job.toml"
        settings.write_text(tomli_w.dumps(table_to_dict(job)), encoding="utf-8")
        options = ("--vehicles", "6", "--settings", str(settings), "--seed", str(seed))
        with VehicleLoopbackProcess(broker.address, *options) as vehicles:
            out = Path(folder) / "run"
            port = f"--vehicles.mqtt.port={broker.port}"
            vehicles.schedule_fault(NOBODY_WALKS)  # until the program plans
            begins = time.monotonic(), vehicles.ask_for_truth()["time_s"]
            first = [str(settings), *KEYS, port, "--out", str(out)]
            ended, said = _run(first, plan, broker, vehicles)
            if any(what == PROGRAM_KILLED for _, what in plan.orders) and ended == -signal.SIGKILL:
                vehicles.schedule_fault("clear")
                vehicles.schedule_fault(NOBODY_WALKS)
                ended, more = _run(["--resume", str(out)], FaultPlan(()), broker, vehicles)
                said += more
            truth = vehicles.ask_for_truth()
            rate = (truth["time_s"] - begins[1]) / (time.monotonic() - begins[0])
        outcome = _judge(out, ended, said, truth)
        if rate < KEPT_UP:
            outcome = replace(outcome, words=f"{outcome.words}; world at {rate:.0%} of real time")
        return outcome


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
            if line.startswith("stop:"):
                vehicles.schedule_fault(NOBODY_WALKS)
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
    vehicles.schedule_fault("clear")
    for at, what in plan.orders if began is not None else ():
        with suppress(subprocess.TimeoutExpired):
            process.wait(max(0.0, (began or 0.0) + at - time.monotonic()))
            break
        _order(what, process, broker, vehicles)
    try:
        ended = process.wait(LONGEST)
    except subprocess.TimeoutExpired:
        process.kill()
        ended = process.wait()
        said.append("it hangs")
    vehicles.schedule_fault(NOBODY_WALKS)
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
