"""Files that are spoilt, lie or are as large as any that is read, for every reader of files."""

from __future__ import annotations

import logging
import os
import resource
import warnings
from functools import partial
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from _corpus import readers
from _fuzz import Reader, Tally, fuzz
from _hostile import read_hostile_files
from _large_files import LARGE, read_large_file
from _spread import in_memory, say_what_is_wrong, spread
from _table import Row

HANG: Final = 5.0
"""Seconds of an input that count as a hang."""
MEMORY: Final = 4_000_000_000
"""Bytes of address space that a reader may take beyond what the program has; more is refused."""
GROWTH_MB: Final = 500.0
"""What reading any of the inputs may add to the memory in use."""


def spoilt_files(count: int) -> list[Row]:
    """Spoil a number of files, drawn over all readers, and read each."""
    with TemporaryDirectory(dir=in_memory()) as name:
        folder = Path(name)
        shares = [reader.share for reader in _quiet_readers(folder / "corpus")]
        size = max(20, count // 400)
        batches = [
            (i, seed)
            for i, share in enumerate(shares)
            for seed in range(ceil(count * share / sum(shares) / size))
        ]
        tallies = spread(partial(_fuzz_batch, folder, size), batches)
        (lies,) = spread(_read_hostile_files, [folder])
    say_what_is_wrong([told for tally in (*tallies, lies) for _, told in tally.wrong])
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


def large_files() -> list[Row]:
    """Read the largest file of shapes of each kind, each in a new process."""
    with TemporaryDirectory(dir=in_memory()) as name:
        taken = spread(partial(read_large_file, Path(name)), list(LARGE), each_anew=True)
    memory, seconds = (max(values) for values in zip(*taken, strict=True))
    return [
        Row("largest files of each kind: memory they added", memory, GROWTH_MB, "MB"),
        Row("… the slowest", seconds, HANG, "s"),
    ]


_READERS: dict[Path, list[Reader]] = {}


def _quiet_readers(folder: Path) -> list[Reader]:
    """The readers, made once in each process."""
    if folder not in _READERS:
        _be_quiet()
        own = folder / str(os.getpid())
        own.mkdir(parents=True)
        _READERS[folder] = list(readers(own))
    return _READERS[folder]


def _read_hostile_files(folder: Path) -> Tally:
    _be_quiet()
    return read_hostile_files(folder)


def _be_quiet() -> None:
    """Let parsers of third parties say nothing of what they stumble over."""
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)


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
