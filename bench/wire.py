"""Faults of the network and of processes, in a move of the real arm's driver: rest, and the cause.

Each is one of 200, with ``--quick`` of 20: a move through a network of its own, a fault somewhere
in it, and then: does the arm rest within 1.5 s of the fault, and does the error name what happened?
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from threading import Thread
from typing import Final

import numpy as np
from _spread import spread
from _table import Row, main
from _wire import Wire
from rtde_receive import RTDEReceiveInterface

from tjscan.core.errors import (
    ArmConnectionLost,
    ArmFault,
    ArmNotResponding,
    MoveSupervisionLost,
    ProgramStopped,
    message_with_notes,
)
from tjscan.core.frames import pose
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits
from tjscan.robot.ur.arm import UrArm
from tjscan.robot.ur.settings import UrSettings
from tjscan_loopback.process import UrLoopbackProcess

CASES: Final = 200
QUICK: Final = 20
TOGETHER: Final = 4
"""Cases at a time: each waits for most of its seven seconds."""

REST_S: Final = 1.5
LONGEST_S: Final = 20.0
AT_REST: Final = 1e-3
HOME: Final = np.radians([-110, -95, 160, 105, -110, 0])
KINEMATICS: Final = Kinematics.load("ur10e")
SLOWLY: Final = MotionLimits(tcp_speed=0.1)

Inject = Callable[[Wire, UrLoopbackProcess, Random], None]


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault, and how a move with it in its middle may end.

    Parameters
    ----------
    inject : callable
        Brings it about.
    ends_in : tuple of type
        Errors that name what happened; none where the move must arrive.
    """

    inject: Inject
    ends_in: tuple[type[ArmFault], ...] = ()


def _held(least: float, most: float) -> Inject:
    def inject(wire: Wire, loopback: UrLoopbackProcess, random: Random) -> None:
        wire.hold()
        time.sleep(random.uniform(least, most))
        wire.release()

    return inject


def _stalled(whose: Callable[[UrLoopbackProcess], int], least: float, most: float) -> Inject:
    def inject(wire: Wire, loopback: UrLoopbackProcess, random: Random) -> None:
        pid = whose(loopback)
        os.kill(pid, signal.SIGSTOP)
        time.sleep(random.uniform(least, most))
        with suppress(ProcessLookupError):  # the driver may have ended it
            os.kill(pid, signal.SIGCONT)

    return inject


def _delayed(wire: Wire, loopback: UrLoopbackProcess, random: Random) -> None:
    wire.delay = random.uniform(0.01, 0.1)


def _garbled(wire: Wire, loopback: UrLoopbackProcess, random: Random) -> None:
    wire.garbled = 1.0


def _client(loopback: UrLoopbackProcess) -> int:
    for file in Path("/proc/self/task").glob("*/children"):
        for pid in file.read_text(encoding="ascii").split():
            if b"ur.client" in Path(f"/proc/{pid}/cmdline").read_bytes():
                return int(pid)
    raise ProcessLookupError("there is no client")


_SILENT: Final = (ArmConnectionLost, ArmNotResponding)
_HELD_UP: Final = (MoveSupervisionLost, ArmNotResponding)

FAULTS: Final[dict[str, Fault]] = {
    "all connections reset": Fault(lambda wire, *_: wire.reset(), _SILENT),
    "data connections reset": Fault(lambda wire, *_: wire.reset(30004), _SILENT),
    "dashboard reset": Fault(lambda wire, *_: wire.reset(29999)),
    "everything lost, connections stay": Fault(lambda wire, *_: wire.swallow(), _SILENT),
    "network held for a moment": Fault(_held(0.05, 0.4)),
    "network held too long": Fault(_held(1.5, 3.0), (*_SILENT, MoveSupervisionLost)),
    "network slow": Fault(_delayed),
    "a bit flipped in every package": Fault(_garbled, (*_SILENT, ArmFault)),
    "client held up for a moment": Fault(_stalled(_client, 0.05, 0.4)),
    "client held up too long": Fault(_stalled(_client, 1.5, 3.0), _HELD_UP),
    "client killed": Fault(lambda w, loop, r: os.kill(_client(loop), signal.SIGKILL), _SILENT),
    "controller held up for a moment": Fault(_stalled(lambda loop: loop.pid, 0.05, 0.4)),
    "controller held up too long": Fault(_stalled(lambda loop: loop.pid, 2.5, 3.0), _SILENT),
    "somebody stops the program": Fault(
        lambda w, loop, r: loop.schedule_fault("stop-program"), (ProgramStopped,)
    ),
}

BLAMES_PEOPLE: Final = ("somebody on its pendant", "local control", "emergency stop is pressed")


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a fault.

    Parameters
    ----------
    right : bool
        Whether the error names what happened.
    blamed : bool
        Whether it names somebody who did nothing.
    rest : float
        Seconds until the arm rested, where the fault ends the move; zero elsewhere.
    """

    right: bool
    blamed: bool
    rest: float = 0.0


def _case(seed: int) -> Outcome:
    """Move, bring the fault about, and note how that ends."""
    name = list(FAULTS)[seed % len(FAULTS)]
    fault, random, rest = FAULTS[name], Random(seed), 0.0
    block, row = divmod(seed, 250)
    controller, host = (f"127.{7 + block}.{row + 1}.{i}" for i in (1, 2))
    with UrLoopbackProcess(controller) as loopback, Wire(host, controller, seed) as wire:
        error: list[ArmFault | None] = []
        with UrArm(KINEMATICS, UrSettings(host), SLOWLY) as arm:
            mover = Thread(target=partial(_move, arm, error))
            mover.start()
            loopback.wait_for_line("move")
            time.sleep(random.uniform(0.2, 1.2))
            fault.inject(wire, loopback, random)
            since = time.monotonic()
            if fault.ends_in:
                rest = _until_rest(controller, since)
                if rest > REST_S:
                    print(f"{name}, seed {seed}: rests after {rest:.2f} s", file=sys.stderr)
            mover.join(LONGEST_S)
            wire.release()
    ended = error[0] if error else ArmFault("the move did not end")
    right = ended is None if not fault.ends_in else isinstance(ended, fault.ends_in)
    said = "" if ended is None else message_with_notes(ended)
    blamed = fault.ends_in != (ProgramStopped,) and any(word in said for word in BLAMES_PEOPLE)
    if not right or blamed:
        print(f"{name}, seed {seed}: {type(ended).__name__}: {said}", file=sys.stderr)
    return Outcome(right, blamed, rest)


def _move(arm: UrArm, error: list[ArmFault | None]) -> None:
    try:
        arm.move_linear(pose(p=(0.25, 0.0, 0.0)) @ KINEMATICS.forward(HOME))
        error.append(None)
    except ArmFault as fault:
        error.append(fault)


def _until_rest(controller: str, since: float) -> float:
    """Seconds until the arm rests, as its controller says on a connection that no fault touches."""
    watch = RTDEReceiveInterface(controller)
    try:
        while time.monotonic() - since < LONGEST_S:
            if np.abs(watch.getActualQd()).max() < AT_REST:
                return time.monotonic() - since
            time.sleep(0.005)
        return float("inf")
    finally:
        watch.disconnect()


def measure(cases: int) -> list[Row]:
    """Measure every bar."""
    ended = spread(_case, range(cases), workers=TOGETHER)
    right = sum(one.right for one in ended) / cases
    return [
        Row(f"faults on the wire, {cases}: the cause is named", right, 1, "", 0.95),
        Row("… somebody is blamed who did nothing", sum(one.blamed for one in ended), 0),
        Row("… slowest rest where it ends the move", max(one.rest for one in ended), REST_S, "s"),
    ]


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--quick"]
    number = QUICK if "--quick" in sys.argv else CASES
    sys.exit(main("Faults on the wire to a real arm", partial(measure, number), words))
