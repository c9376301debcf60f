"""Whether nothing that was measured is ever lost: kills, cuts, full disks, bad sensors, bad files.

``--quick`` takes a small part of each, to see that it runs.
"""

from __future__ import annotations

import random
import sys
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from _faulty import FaultyScan, faulty_scan
from _fuzz import section_ends
from _moved_arm import resume_from_elsewhere, scan_whole
from _processes import SAME_MM, Outcome, killed, on_a_small_disk, unbroken, without_room
from _recording_time import recording_time
from _run_uses import SoundRun, make_crawls, make_scans, make_tows
from _spoilt_files import large_files, spoilt_files
from _spoilt_runs import SpoiltTally, spoil_runs
from _spread import in_memory, say_what_is_wrong, spread
from _table import Row, main
from _ur_methods import call_every_method
from wire import measure as wire_faults

from tjscan.core.errors import TjscanError
from tjscan.core.frames import Array
from tjscan.scanning.recording import read_recorded_scan

WRONG_MM: Final = 1.0
"""A corner that is further from the true edge is a wrong one."""
MOVED_MM: Final = 0.01
"""By which corners of a scan that goes on with its arm moved may differ from the unbroken one's."""

UR_HOST: Final = "127.6.0.1"
"""Of a loopback controller."""

SPOILT_TOGETHER: Final = 20
"""Run directories that one process spoils in turn."""


@dataclass(frozen=True, slots=True)
class Counts:
    """How much is done."""

    kills: int
    cuts: int
    disks: int
    moved: int
    faulty: int
    inputs: int
    spoilt: tuple[int, int, int]
    wire: int
    timed: int
    timed_sections: int


FULL: Final = Counts(100, 1000, 10, 100, 200, 20_000, (1700, 200, 100), 200, 3, 6)
QUICK: Final = Counts(4, 100, 2, 4, 9, 2000, (20, 20, 20), 14, 1, 4)


def measure(counts: Counts) -> Iterator[Row]:
    """Measure every bar."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        whole, life = unbroken(folder / "whole")
        yield from _kills(folder / "kills", whole, life, counts.kills)
        yield from _cuts(folder / "cut", folder / "whole", counts.cuts)
        yield from _disks(folder / "disks", whole, counts.disks)
    yield from _moved_arms(counts.moved)
    yield from _faults(counts.faulty)
    yield from spoilt_files(counts.inputs)
    yield from large_files()
    yield from _spoilt_runs(*counts.spoilt)
    yield _ur_methods()
    yield from wire_faults(counts.wire)
    yield recording_time(counts.timed, counts.timed_sections)


def _kills(folder: Path, whole: Array, life: float, count: int) -> list[Row]:
    outcomes: list[Outcome] = []
    seed = 0
    while len(outcomes) < count:
        wanted = range(seed, seed + count - len(outcomes))
        seed = wanted.stop
        found = spread(partial(_kill_in, folder, whole, life), wanted)
        outcomes += [one for one in found if one is not None]
    say_what_is_wrong([one.told for one in outcomes])
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
    found = spread(partial(_disk_in, folder, whole), rooms)
    small = [on_a_small_disk(folder / f"disk-{room}", whole, room) for room in rooms[: count // 3]]
    found += [one for one in small if one is not None]
    say_what_is_wrong([outcome.told for _, outcome in found])
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


def _moved_arms(count: int) -> list[Row]:
    """Move the arm of scans that were cut off, and go on."""
    with TemporaryDirectory() as name:
        whole = Path(name) / "whole"
        scan_whole(whole)
        found = spread(partial(resume_from_elsewhere, whole), range(count))
    say_what_is_wrong([one.told for one in found])
    done = [one.apart_mm for one in found if one.apart_mm <= MOVED_MM]
    refused = sum(one.refused for one in found)
    return [
        Row(
            f"{count} scans resumed with the arm moved: as unbroken",
            100 * len(done) / count,
            100,
            "%",
            at_least=99,
        ),
        Row("… the others: not refused before anything moved", count - len(done) - refused, 0),
        Row("… corners from an unbroken scan", max(done, default=float("nan")), MOVED_MM, "mm"),
    ]


def _faults(count: int) -> list[Row]:
    scans: list[FaultyScan] = spread(faulty_scan, range(count))
    say_what_is_wrong([s.told for s in scans if not s.complete or s.worst_mm > WRONG_MM])
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


def _spoilt_runs(scans: int, crawls: int, tows: int) -> list[Row]:
    """Flip a bit or cut a file of run directories, then read, read again and go on with each."""
    with TemporaryDirectory(dir=in_memory()) as name:
        folder = Path(name)
        batches = [
            (runs, seed)
            for make, count in ((make_scans, scans), (make_crawls, crawls), (make_tows, tows))
            for runs in (make(folder),)
            for seed in range(ceil(count / SPOILT_TOGETHER))
        ]
        tallies = spread(partial(_spoil_batch, folder), batches)
    say_what_is_wrong([told for tally in tallies for told in (*tally.silent, *tally.wrong)])
    used = sum(tally.cases for tally in tallies)
    refused = sum(tally.refused for tally in tallies)
    spoilt, asked = SPOILT_TOGETHER * len(batches), scans + crawls + tows
    return [
        Row("runs with a bit flipped or a file cut", spoilt, float("inf"), at_least=asked),
        Row("… read, resumed, reprocessed: refused", 100 * refused / used, 100, "%", at_least=25),
        Row("… silently different", sum(len(t.silent) for t in tallies), 0),
        Row("… that ended in a traceback", sum(len(t.wrong) for t in tallies), 0),
    ]


def _ur_methods() -> Row:
    """Call every method of the client library's control interface."""
    called = call_every_method(UR_HOST)
    say_what_is_wrong([one.told for one in called if not one.right])
    share = 100 * sum(one.right for one in called) / len(called)
    name = f"{len(called)} calls of ur_rtde: do as they say, or end the program by name"
    return Row(name, share, 100, "%", at_least=100)


def _spoil_batch(folder: Path, batch: tuple[Sequence[SoundRun], int]) -> SpoiltTally:
    warnings.simplefilter("ignore")
    runs, seed = batch
    return spoil_runs(folder, runs, SPOILT_TOGETHER, seed)


if __name__ == "__main__":
    chosen = QUICK if "--quick" in sys.argv else FULL
    words = [word for word in sys.argv[1:] if word != "--quick"]
    sys.exit(main("No scan is ever lost", partial(measure, chosen), words))
