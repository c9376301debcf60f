"""How long the program takes to start: processor time, held against that of loading NumPy."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Final

from _table import Row, main

ROOT: Final = Path(__file__).parents[1]

TIMES: Final = 5
"""Runs of each task; the tasks take turns, so that a busy machine slows all of them."""

REFERENCE: Final = (sys.executable, "-c", "import numpy, pydantic")
"""Takes 0.2 s where NumPy takes 0.15 s."""

PURE_TESTS: Final = (
    "tests/core/test_provenance.py",
    "tests/groove/test_section.py",
    "tests/scanning/test_target.py",
)


def seconds(command: Sequence[str]) -> float:
    """Processor time that a command takes, user and system, whether it succeeds or not."""
    before = os.times()
    subprocess.run(command, cwd=ROOT, capture_output=True, check=False)
    after = os.times()
    return (
        after.children_user - before.children_user + after.children_system - before.children_system
    )


def measure() -> list[Row]:
    """Time each task and the reference in turns."""
    with TemporaryDirectory() as folder:
        typo = Path(folder) / "typo.toml"
        typo.write_text("[scna]\nstep_mm = 40\n", encoding="utf-8")
        command = "import sys; from tjscan.cli import main; main(sys.argv[1:])"
        tests = (sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider")
        tasks: dict[str, tuple[tuple[str, ...], float]] = {
            "import tjscan": ((sys.executable, "-c", "import tjscan"), 0.3),
            "tjscan --help": ((sys.executable, "-c", command, "--help"), 0.5),
            "tjscan scan --help": ((sys.executable, "-c", command, "scan", "--help"), 0.7),
            "tjscan scan typo.toml": (
                (sys.executable, "-c", command, "scan", str(typo)),
                0.7,
            ),
            **{f"pytest {file}": ((*tests, file), 0.8) for file in PURE_TESTS},
        }
        taken: dict[str, list[float]] = {name: [] for name in ("reference", *tasks)}
        for _ in range(TIMES):
            taken["reference"].append(seconds(REFERENCE))
            for name, (task, _) in tasks.items():
                taken[name].append(seconds(task))
    reference = median(taken["reference"])
    rows = [Row("import numpy, pydantic (the reference)", reference, float("inf"), "s", 0.0)]
    for name, (_, limit) in tasks.items():
        # The limits are seconds on a machine where the reference takes 0.2 s.
        ratio = median(taken[name]) / reference
        shown = f"{name} ({median(taken[name]):.2f} s)"
        rows.append(Row(shown, ratio, limit / 0.2, "references"))
    return rows


if __name__ == "__main__":
    sys.exit(main("start, processor time", measure, sys.argv[1:]))
