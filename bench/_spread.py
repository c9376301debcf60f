"""What the parts of a soak share: processes of their own, files in memory, and what to say."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Final, TypeVar

WORKERS: Final = 2

T = TypeVar("T")
U = TypeVar("U")


def spread(
    do: Callable[[T], U], over: Sequence[T], *, workers: int = WORKERS, each_anew: bool = False
) -> list[U]:
    """Do it for each, in processes of their own; one that crashes ends the bench.

    Parameters
    ----------
    do : callable
    over : sequence
        What it is done for.
    workers : int, optional
        How many at a time.
    each_anew : bool, optional
        Whether each is done in a new process.
    """
    context = multiprocessing.get_context("spawn")
    tasks = 1 if each_anew else None
    try:
        with ProcessPoolExecutor(
            min(workers, len(over)), mp_context=context, max_tasks_per_child=tasks
        ) as pool:
            return list(pool.map(do, over))
    except BrokenProcessPool:
        raise SystemExit("a process crashed: see above what it was doing") from None


def in_memory() -> str | None:
    """Where files take no disk."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None


def say_what_is_wrong(told: Sequence[str]) -> None:
    """Print the first five that say something, on stderr."""
    for words in [words for words in told if words][:5]:
        print(words.strip()[-2000:], file=sys.stderr)
