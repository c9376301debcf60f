"""What is left of a crawl over a broker that is broken off while it welds, and then resumed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

import numpy as np
from _stops import START_LIMIT, Break

from tjscan.core.errors import CrawlStopped, TjscanError, VehicleFault
from tjscan.crawler.journal import CrawlCycle
from tjscan.job.crawl.job import read_crawl_job
from tjscan.runs.crawl.results import read_recorded_crawl
from tjscan.runs.crawl.run import CrawlContext, resume_crawl, run_crawl
from tjscan_loopback.broker import MosquittoProcess
from tjscan_loopback.process import VehicleLoopbackProcess

BROKEN: Final = (Break.LINK_CUT, Break.PROGRAM_KILLED, Break.DRIVE_FAULT)
"""What breaks a crawl off: in turn."""

WELD: Final = 0.03
"""Metres of each of the two passes."""

RESUMES: Final = 5
"""How often a crawl is gone on with that a guard stops again."""

JOB: Final = """
[vehicle]
driver = "mqtt"
[vehicle.mqtt]
port = {port}
silence_s = 10.0
[alignment]
length_mm = 50
longest_mm = 100
offset_mm = 20
offset_sigma_mm = 20
in_view_s = 0.1
speed_mm_s = 40
return_speed_mm_s = 40
[guards]
torch_sigma_mm = 20
[weld]
length_m = {weld}
run_up_mm = 30
[[pass]]
speed_mm_s = 20
[[pass]]
speed_mm_s = 20
[simulation.vehicle]
start_mm = [-30.0, 1.0]
[simulation.vehicle.slip]
ratio = 0.1
"""


def passes_lost(what: Break, broker: MosquittoProcess, directory: Path) -> int:
    """Break a crawl off in its first pass, resume it, and count what is not there in the end.

    Parameters
    ----------
    what : Break
        One of `BROKEN`.
    broker : MosquittoProcess
        Between the crawl and a vehicle that is started here.
    directory : Path
        Empty.

    Returns
    -------
    int
        Passes whose record is missing or too short, of two.

    Raises
    ------
    VehicleFault
        If the arc is not struck.
    """
    file, out = directory / "job.toml", directory / "run"
    file.write_text(JOB.format(port=broker.port, weld=WELD))
    with VehicleLoopbackProcess(broker.address, "--settings", str(file)) as vehicles:
        processes = multiprocessing.get_context("forkserver")
        burns, theirs = processes.Pipe(duplex=False)
        process = processes.Process(target=crawl_until_broken, args=(file, out, theirs))
        process.start()
        try:
            if not burns.poll(START_LIMIT) or process.pid is None:
                raise VehicleFault("the crawl that should be broken off does not weld")
            match what:
                case Break.PROGRAM_KILLED:
                    os.kill(process.pid, signal.SIGKILL)
                case Break.LINK_CUT:
                    vehicles.schedule_fault("drop-link 1")
                case Break.DRIVE_FAULT:
                    vehicles.schedule_fault("drive-fault 1")
            process.join(START_LIMIT)
        finally:
            process.kill()
            process.join()
        vehicles.schedule_fault("clear")
        copied = out / "job.toml"
        for _ in range(RESUMES):
            try:
                resume_crawl(CrawlContext(read_crawl_job(copied), copied), overlap=0.005)
                break
            except CrawlStopped as stop:  # a guard of a machine that was held up: go on again
                print(f"{what}: resumed, and then: {stop}", file=sys.stderr)
            except TjscanError as error:  # what is missing then is counted
                print(f"{what}: not gone on with: {error}", file=sys.stderr)
                break
    found = read_recorded_crawl(out)
    # An arc is struck in the first cycle that begins beyond its place: on a busy machine, late.
    late = float(np.abs(np.diff([cycle.travel for cycle in found.cycles])).max())
    return 2 - sum(one.length >= WELD - late for one in found.passes)


class _TellsThatItBurns:
    """A journal that says once that the arc has burned for a third of the weld."""

    def __init__(self, burns: Connection) -> None:
        self._burns, self._told = burns, False

    def record(self, cycle: object) -> None:
        if self._told or not isinstance(cycle, CrawlCycle):
            return
        if cycle.arc and cycle.travel > WELD / 3:
            self._told = True
            self._burns.send(None)


def crawl_until_broken(file: Path, out: Path, burns: Connection) -> None:
    """Crawl as a job file says, and say when the arc burns."""
    with suppress(TjscanError):
        run_crawl(CrawlContext(read_crawl_job(file), file, _TellsThatItBurns(burns)), out)
