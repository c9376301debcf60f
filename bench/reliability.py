"""Whether nothing that was measured is ever lost: kills, cuts, full disks, bad sensors, bad files.

``--quick`` takes a small part of each, to see that it runs.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import random
import resource
import sys
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from math import ceil
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Final, TypeVar

from _corpus import EXAMPLES, readers
from _faulty import FaultyScan, faulty_scan
from _fuzz import Reader, Tally, fuzz, section_ends
from _hostile import read_hostile_files
from _large_files import LARGE, read_large_file
from _processes import SAME_MM, Outcome, killed, on_a_small_disk, unbroken, without_room
from _run_uses import SoundRun, make_crawls, make_scans, make_tows
from _spoilt_runs import SpoiltTally, spoil_runs
from _table import Row, main

from tjscan.core.errors import TjscanError
from tjscan.core.frames import Array
from tjscan.job import read_scan_job
from tjscan.runs.context import RunContext
from tjscan.runs.scan import scan_in_cell
from tjscan.scanning.reader import read_recorded_scan
from tjscan.scanning.section import ProfileView, ScannedSection
from tjscan.scanning.topics import RecordingJournal, record_scan

WORKERS: Final = 2
HANG: Final = 5.0
"""Seconds of an input that count as a hang."""
MEMORY: Final = 4_000_000_000
"""Bytes of address space that a reader may take beyond what the program has; more is refused."""
GROWTH_MB: Final = 500.0
"""What reading any of the inputs may add to the memory in use."""
WRONG_MM: Final = 1.0
"""A corner that is further from the true edge is a wrong one."""

SPOILT_TOGETHER: Final = 20
"""Run directories that one process spoils in turn."""

T = TypeVar("T")
U = TypeVar("U")


@dataclass(frozen=True, slots=True)
class Counts:
    """How much is done."""

    kills: int
    cuts: int
    disks: int
    faulty: int
    inputs: int
    spoilt: tuple[int, int, int]
    timed: int
    timed_sections: int


FULL: Final = Counts(100, 1000, 10, 200, 100_000, (2000, 200, 100), 3, 6)
QUICK: Final = Counts(4, 100, 2, 9, 2000, (20, 20, 20), 1, 4)


def measure(counts: Counts) -> list[Row]:
    """Measure every bar."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        whole, life = unbroken(folder / "whole")
        rows = _kills(folder / "kills", whole, life, counts.kills)
        rows += _cuts(folder / "cut", folder / "whole", counts.cuts)
        rows += _disks(folder / "disks", whole, counts.disks)
    rows += _faults(counts.faulty)
    rows += _files(counts.inputs)
    rows += _large_files()
    rows += _spoilt_runs(*counts.spoilt)
    rows.append(_overhead(counts.timed, counts.timed_sections))
    return rows


def _kills(folder: Path, whole: Array, life: float, count: int) -> list[Row]:
    outcomes: list[Outcome] = []
    seed = 0
    while len(outcomes) < count:
        wanted = range(seed, seed + count - len(outcomes))
        seed = wanted.stop
        found = _spread(partial(_kill_in, folder, whole, life), wanted)
        outcomes += [one for one in found if one is not None]
    _say_what_is_wrong([one.told for one in outcomes])
    apart = max(one.apart_mm for one in outcomes)
    return [
        Row("killed at a random moment: scans", len(outcomes), float("inf"), at_least=count),
        Row("… that did not go on to their end", sum(not one.complete for one in outcomes), 0),
        Row("… whose recording lost a byte", sum(not one.kept for one in outcomes), 0),
        Row("… corners from an unbroken scan", apart, SAME_MM, "mm"),
    ]


def _kill_in(folder: Path, whole: Array, life: float, seed: int) -> Outcome | None:
    return killed(folder / str(seed), whole, life, seed)


def _cuts(folder: Path, run: Path, count: int) -> list[Row]:
    """Cut a recording at random bytes, and count what is lost or said wrongly."""
    folder.mkdir()
    data, dice = (run / "scan.mcap").read_bytes(), random.Random(0)
    ends = section_ends(data)
    lost = failed = 0
    for _ in range(count):
        size = dice.randrange(len(data) + 1)
        (folder / "scan.mcap").write_bytes(data[:size])
        try:
            found = len(read_recorded_scan(folder).sections)
        except TjscanError:
            failed += 1
            continue
        lost += found != sum(end <= size for end in ends)
    return [
        Row(f"recording cut at {count} random bytes: a whole section not read", lost, 0),
        Row("… not read at all", failed, 0),
    ]


def _disks(folder: Path, whole: Array, count: int) -> list[Row]:
    """Let a file grow so far and no further; where it is permitted, fill a small disk as well."""
    dice = random.Random(1)
    rooms = [dice.randrange(20_000, 500_000) for _ in range(count)]
    found = _spread(partial(_disk_in, folder, whole), rooms)
    small = [on_a_small_disk(folder / f"disk-{room}", whole, room) for room in rooms[: count // 3]]
    found += [one for one in small if one is not None]
    _say_what_is_wrong([outcome.told for _, outcome in found])
    return [
        Row(f"no room left, {len(found)} scans: no clear error", sum(not c for c, _ in found), 0),
        Row(
            "… not whole, or not gone on with",
            sum(not (o.complete and o.kept and o.apart_mm <= SAME_MM) for _, o in found),
            0,
        ),
    ]


def _disk_in(folder: Path, whole: Array, room: int) -> tuple[bool, Outcome]:
    return without_room(folder / str(room), whole, room)


def _faults(count: int) -> list[Row]:
    scans: list[FaultyScan] = _spread(faulty_scan, range(count))
    _say_what_is_wrong([s.told for s in scans if not s.complete or s.worst_mm > WRONG_MM])
    wrong = sum(scan.worst_mm > WRONG_MM for scan in scans)
    return [
        Row(
            f"sensor faults in {count} scans: complete",
            100 * sum(scan.complete for scan in scans) / count,
            100,
            "%",
            at_least=99,
        ),
        Row("… not stopped cleanly", sum(not scan.clean for scan in scans), 0),
        Row("… that claim a wrong section", wrong, 0),
        Row("… worst corner of all", max(scan.worst_mm for scan in scans), WRONG_MM, "mm"),
    ]


def _files(count: int) -> list[Row]:
    with TemporaryDirectory(dir=_in_memory()) as name:
        folder = Path(name)
        shares = [reader.share for reader in _quiet_readers(folder / "corpus")]
        size = max(20, count // 400)
        batches = [
            (i, seed)
            for i, share in enumerate(shares)
            for seed in range(ceil(count * share / sum(shares) / size))
        ]
        tallies = _spread(partial(_fuzz_batch, folder, size), batches)
        (lies,) = _spread(read_hostile_files, [folder])
    _say_what_is_wrong([told for tally in (*tallies, lies) for _, told in tally.wrong])
    inputs = sum(tally.inputs for tally in tallies)
    return [
        Row("spoiled files read", inputs, float("inf"), at_least=0.99 * count),
        Row(
            "… refused by an error of the tree",
            100 * sum(t.refused for t in tallies) / inputs,
            100,
            "%",
            at_least=25,
        ),
        Row("… that ended otherwise", sum(len(t.wrong) for t in tallies), 0),
        Row("… the slowest", max(t.slowest for t in tallies), HANG, "s"),
        Row("… memory they added", max(t.grown for t in tallies) / 1e6, GROWTH_MB, "MB"),
        Row("files that lie, each to two readers", lies.inputs, float("inf"), at_least=60),
        Row("… that ended otherwise", len(lies.wrong), 0),
        Row("… the slowest", lies.slowest, HANG, "s"),
        Row("… memory they added", lies.grown / 1e6, GROWTH_MB, "MB"),
    ]


def _large_files() -> list[Row]:
    """Read the largest file of shapes of each kind, each in a new process."""
    spawn = multiprocessing.get_context("spawn")
    with (
        TemporaryDirectory(dir=_in_memory()) as name,
        ProcessPoolExecutor(WORKERS, mp_context=spawn, max_tasks_per_child=1) as pool,
    ):
        taken = list(pool.map(partial(read_large_file, Path(name)), LARGE))
    return [
        Row("largest files of each kind: memory they added", max(m for m, _ in taken), 500, "MB"),
        Row("… the slowest", max(s for _, s in taken), HANG, "s"),
    ]


def _spoilt_runs(scans: int, crawls: int, tows: int) -> list[Row]:
    """Flip a bit or cut a file of run directories, then read, read again and go on with each."""
    with TemporaryDirectory(dir=_in_memory()) as name:
        folder = Path(name)
        batches = [
            (runs, seed)
            for make, count in ((make_scans, scans), (make_crawls, crawls), (make_tows, tows))
            for runs in (make(folder),)
            for seed in range(ceil(count / SPOILT_TOGETHER))
        ]
        tallies = _spread(partial(_spoil_batch, folder), batches)
    _say_what_is_wrong([told for tally in tallies for told in (*tally.silent, *tally.wrong)])
    used = sum(tally.cases for tally in tallies)
    refused = sum(tally.refused for tally in tallies)
    spoilt = SPOILT_TOGETHER * len(batches)
    return [
        Row("runs with a bit flipped or a file cut", spoilt, float("inf"), at_least=scans),
        Row("… read, resumed, reprocessed: refused", 100 * refused / used, 100, "%", at_least=25),
        Row("… silently different", sum(len(t.silent) for t in tallies), 0),
        Row("… that ended in a traceback", sum(len(t.wrong) for t in tallies), 0),
    ]


def _spoil_batch(folder: Path, batch: tuple[Sequence[SoundRun], int]) -> SpoiltTally:
    warnings.simplefilter("ignore")
    runs, seed = batch
    return spoil_runs(folder, runs, SPOILT_TOGETHER, seed)


_READERS: dict[Path, list[Reader]] = {}


def _quiet_readers(folder: Path) -> list[Reader]:
    """The readers, made once in each process."""
    if folder not in _READERS:
        warnings.simplefilter("ignore")
        logging.disable(logging.CRITICAL)
        own = folder / str(os.getpid())
        own.mkdir(parents=True)
        _READERS[folder] = list(readers(own))
    return _READERS[folder]


def _fuzz_batch(folder: Path, size: int, batch: tuple[int, int]) -> Tally:
    """Spoil some files of one reader, in a process that may take so much memory and no more."""
    index, seed = batch
    reader = _quiet_readers(folder / "corpus")[index]
    _bound_memory()
    own = folder / f"{index}-{seed}"
    (own / reader.file).parent.mkdir(parents=True)
    silent = os.open(os.devnull, os.O_WRONLY)
    stderr = os.dup(2)
    os.dup2(silent, 2)  # the parser of URDF says there what it stumbled over
    try:
        return fuzz(reader, size, seed, own)
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(silent)


def _bound_memory() -> None:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    bound = pages * resource.getpagesize() + MEMORY
    if resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_AS, (bound, resource.RLIM_INFINITY))


class _Timed:
    """A recording, and the seconds that it takes."""

    def __init__(self, recording: RecordingJournal) -> None:
        self._recording, self.seconds = recording, 0.0

    def record_view(self, view: ProfileView) -> None:
        began = perf_counter()
        self._recording.record_view(view)
        self.seconds += perf_counter() - began

    def record_section(self, scan: ScannedSection) -> None:
        began = perf_counter()
        self._recording.record_section(scan)
        self.seconds += perf_counter() - began

    def record_event(self, name: str, detail: str) -> None:
        began = perf_counter()
        self._recording.record_event(name, detail)
        self.seconds += perf_counter() - began


def _overhead(times: int, sections: int) -> Row:
    """Share of a scan's wall time that recording takes, the arm moving in real time."""
    file = EXAMPLES / "paper.toml"
    job = read_scan_job(file, {"scan.sections": sections, "simulation.arm.realtime": True})
    shares = []
    for _ in range(times):
        cell = RunContext(job, file).make_cell()
        with TemporaryDirectory() as name:
            began = perf_counter()
            with record_scan(Path(name) / "scan.mcap") as recording:
                timed = _Timed(recording)
                scan_in_cell(cell, job, timed)
                ending = perf_counter()
            ended = perf_counter()
        shares.append((timed.seconds + ended - ending) / (ended - began))
    return Row("recording, share of a scan's wall time", 100 * median(shares), 5, "%")


def _spread(do: Callable[[T], U], over: Sequence[T]) -> list[U]:
    """Do it for each, in processes of their own; one that crashes ends the bench."""
    context = multiprocessing.get_context("spawn")
    try:
        with ProcessPoolExecutor(min(WORKERS, len(over)), mp_context=context) as pool:
            return list(pool.map(do, over))
    except BrokenProcessPool:
        raise SystemExit("a process crashed: see above what it was doing") from None


def _in_memory() -> str | None:
    """Where files take no disk."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None


def _say_what_is_wrong(told: Sequence[str]) -> None:
    for words in [words for words in told if words][:5]:
        print(words.strip()[-2000:], file=sys.stderr)


if __name__ == "__main__":
    chosen = QUICK if "--quick" in sys.argv else FULL
    words = [word for word in sys.argv[1:] if word != "--quick"]
    sys.exit(main("No scan is ever lost", partial(measure, chosen), words))
