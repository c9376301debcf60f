"""How fast studies run, whether it matters where, and what a million runs need.

With --full all rows of the million are written, and the study of joints is run.
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import pyarrow.parquet as pq
from _stopwatch import Stopwatch
from _table import Row, main

EXAMPLES: Final = Path(__file__).resolve().parents[1] / "examples"
PAPER, JOINTS = EXAMPLES / "paper-study.toml", EXAMPLES / "joints-study.toml"
FULL: Final = "--full"
SEEDS: Final = 4
"""Seeds of the longer study: the start of Python and of its workers, some 4 s, hardly counts."""


def run(study: Path, out: Path, *options: object) -> Stopwatch:
    """Time ``tjscan study`` by the wall clock, the start of Python included."""
    tjscan = Path(sys.executable).with_name("tjscan")
    words = [str(word) for word in (tjscan, "study", study, "--out", out, *options)]
    watch = Stopwatch()
    with watch:
        subprocess.run(words, check=True, capture_output=True)
    return watch


def table(out: Path) -> Any:
    """The table of a study but for the clock on the wall."""
    return pq.read_table(out / "study.parquet").drop(["wall_s"])


@contextmanager
def cluster(workers: int) -> Iterator[str]:
    """Start a scheduler and workers of one thread on the loopback interface, by hand."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    scheduler = ["dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    worker = ["dask_worker", address, "--nthreads", "1", "--no-dashboard"]
    with ExitStack() as stack:
        for name, *options in (scheduler, *[worker] * workers):
            process = subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{name}", *options],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            stack.callback(process.wait)
            stack.callback(process.terminate)
        yield address


def longer(folder: Path) -> Path:
    """The paper's programme with several seeds."""
    text = PAPER.read_text(encoding="utf-8").replace('job = "', f'job = "{EXAMPLES}/', 1)
    file = folder / "longer.toml"
    file.write_text(f"seeds = {SEEDS}\n{text}", encoding="utf-8")
    return file


def speed(folder: Path) -> list[Row]:
    """The paper's 36 tests: how long, how much faster with two, and the same on a cluster."""
    short = run(PAPER, folder / "short", "--workers", 2)
    study = longer(folder)
    one = run(study, folder / "one", "--workers", 1)
    two = run(study, folder / "two", "--workers", 2)
    with cluster(2) as address:
        run(study, folder / "cluster", "--scheduler", address)
    truth = table(folder / "one")
    other = sum(not table(folder / name).equals(truth) for name in ("two", "cluster"))
    return [
        short.row("36 tests, two workers", max, 60e3),
        Row(
            f"{len(truth)} tests: one worker's time over that of two",
            one.seconds[0] / two.seconds[0],
            inf,
            at_least=1.7,
        ),
        Row("tables of two workers and of a cluster that differ from one worker's", other, 0),
    ]


def joints(folder: Path) -> list[Row]:
    """The study of joints: minutes, not seconds."""
    run(JOINTS, folder / "joints")
    complete = table(folder / "joints")["complete"].to_pylist()
    share = 100 * sum(complete) / len(complete)
    return [
        Row("joints: scans", len(complete), inf, at_least=1000),
        Row("joints: complete", share, 100, "%", at_least=99.5),
    ]


def million(made: int) -> list[Row]:
    """A study of a million runs, of which the first are made: the client's time and memory."""
    script = Path(__file__).with_name("_many_runs.py")
    told = subprocess.run(
        [sys.executable, str(script), str(made)], check=True, capture_output=True, text=True
    )
    found = json.loads(told.stdout)
    return [
        Row("a study of many: runs", found["runs"], inf, at_least=1_000_000),
        Row("… checked, and the first row", found["first_s"], 60, "s"),
        Row(f"… memory of the client with {made} rows", found["peak_mb"], 1000, "MB"),
    ]


def measure(full: bool) -> list[Row]:
    """Measure every bar."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        rows = [*speed(folder), *million(1_000_000 if full else 20_000)]
        return [*rows, *(joints(folder) if full else [])]


if __name__ == "__main__":
    arguments = [word for word in sys.argv[1:] if word != FULL]
    sys.exit(main("Studies", partial(measure, FULL in sys.argv), arguments))
