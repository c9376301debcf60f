"""How long vehicles behind a broker go on moving after something broke."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import StrEnum
from typing import Final

from _commander import drive_until_ended

from tjscan.core.errors import VehicleFault
from tjscan_loopback.broker import MosquittoProcess
from tjscan_loopback.process import VehicleLoopbackProcess

START_LIMIT: Final = 600.0
"""Seconds in which a program starts; a busy machine takes its time."""


class Break(StrEnum):
    """What breaks."""

    PROGRAM_KILLED = "program killed"
    PROGRAM_FROZEN = "program frozen"
    LINK_CUT = "link cut"
    DRIVE_FAULT = "drive fault"
    BROKER_KILLED = "broker killed"


@contextmanager
def commander_process(broker: MosquittoProcess, speed: float) -> Iterator[int]:
    """Run a process that drives vehicle 1 at a speed in m/s until it is ended; its number."""
    processes = multiprocessing.get_context("forkserver")
    processes.set_forkserver_preload(["_commander"])
    ready, theirs = processes.Pipe(duplex=False)
    process = processes.Process(target=drive_until_ended, args=(broker.port, speed, theirs))
    process.start()
    try:
        if not ready.poll(START_LIMIT) or process.pid is None:
            raise VehicleFault("the program that should drive does not")
        yield process.pid
    finally:
        process.kill()
        process.join()
        process.close()
        ready.close()
        theirs.close()


def seconds_until_rest(
    what: Break, broker: MosquittoProcess, vehicles: VehicleLoopbackProcess, *, speed: float = 0.1
) -> float:
    """Drive vehicle 1, break something, and mend it; how long the vehicle went on, seconds.

    Parameters
    ----------
    what : Break
        What breaks.
    broker : MosquittoProcess
        The broker.
    vehicles : VehicleLoopbackProcess
        The vehicles.
    speed : float, optional
        m/s.

    Raises
    ------
    VehicleFault
        If it goes on for ten seconds.
    """
    with commander_process(broker, speed) as commander:
        vehicles.wait_for_line("moving 1 ")
        time.sleep(0.3)  # it has reached its speed
        vehicles.unread_output()
        since = time.monotonic()
        match what:
            case Break.PROGRAM_KILLED:
                os.kill(commander, signal.SIGKILL)
            case Break.PROGRAM_FROZEN:
                os.kill(commander, signal.SIGSTOP)
            case Break.LINK_CUT:
                vehicles.schedule_fault("drop-link 1")
            case Break.DRIVE_FAULT:
                vehicles.schedule_fault("drive-fault 1")
            case Break.BROKER_KILLED:
                broker.kill()
        try:
            return vehicles.wait_until_at_rest() - since
        finally:
            with suppress(ProcessLookupError):  # it saw what broke, and ended
                os.kill(commander, signal.SIGKILL)
            if what is Break.BROKER_KILLED:
                broker.start()
            vehicles.schedule_fault("clear")
