"""A study of a million runs in this process: how long it takes to check, and what memory it needs.

The scheduler is a stand-in that makes the first rows at once, so that the time is the client's own;
writing, reading and reporting them is the product's.
"""

from __future__ import annotations

import json
import resource
import sys
from collections.abc import Callable, Generator, Iterable
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, Final

from tjscan.runs.scan.study import ScanOutcome
from tjscan.runs.tasks import study_backend_of_task
from tjscan.study.plan import plan_study
from tjscan.study.run import make_study_directory, row_of_trial, run_study
from tjscan.study.schedule import EndedTask
from tjscan.study.trial import StudyRow, Trial

PAPER: Final = Path(__file__).resolve().parents[1] / "examples" / "paper.toml"
STUDY: Final = f"""job = "{PAPER}"
seeds = 100_000
[grid]
scan.step_mm = [20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0]
"""


def measure(rows: int) -> dict[str, float]:
    """Seconds until the first row, runs that were planned, seconds for all, megabytes at most."""

    def at_once(
        work: Callable[[Trial], StudyRow[Any]], trials: Iterable[Trial], count: int
    ) -> Generator[EndedTask[Trial, StudyRow[Any]]]:
        for trial in islice(trials, rows):
            done = ScanOutcome(True, "at the length", f"after {trial.index} mm")
            yield EndedTask(trial, row_of_trial(trial, done, code="0", wall_s=0.1))

    start, first = perf_counter(), 0.0

    def watch(row: StudyRow[Any]) -> None:
        nonlocal first
        first = first or perf_counter() - start

    with TemporaryDirectory() as name:
        file = Path(name) / "study.toml"
        file.write_text(STUDY, encoding="utf-8")
        plan = plan_study(file, study_backend_of_task)
        make_study_directory(Path(name) / "out", plan)
        made = run_study(Path(name) / "out", at_once, watch, study_backend_of_task)
        assert len(made) == rows
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"runs": len(plan), "first_s": first, "all_s": perf_counter() - start, "peak_mb": peak}


if __name__ == "__main__":
    print(json.dumps(measure(int(sys.argv[1]))))
