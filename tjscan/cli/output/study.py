"""What ``tjscan study`` prints."""

from __future__ import annotations

import json as json_
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.progress import TimeRemainingColumn

from tjscan.cli.output.console import print_message, progress_bars
from tjscan.study.trial import StudyRow


@contextmanager
def study_progress_bar(total: int) -> Iterator[Callable[[StudyRow[Any]], None]]:
    """Show a study's progress bar while the block runs; gives what moves it on by a row."""
    with progress_bars() as progress:
        progress.columns += (TimeRemainingColumn(),)
        bar = progress.add_task("runs", total=total)

        def watch(row: StudyRow[Any]) -> None:
            progress.advance(bar)
            if not row.outcome.complete:
                where = ", ".join(f"{key} {value}" for key, value in row.inputs.items())
                line = f"row {row.index} ({where}): {row.outcome.reason}"
                progress.console.print(line, markup=False)

        yield watch


def print_study_outcome(rows: Sequence[StudyRow[Any]], directory: Path, *, json: bool) -> None:
    """Print how the runs of a study ended, on stderr, or as JSON on stdout."""
    ended = Counter(row.outcome.reason for row in rows)
    complete = sum(row.outcome.complete for row in rows)
    if json:
        print(json_.dumps({"scans": len(rows), "complete": complete, "reasons": ended}))
        return
    print_message(f"{complete} of {len(rows)} runs complete")
    for reason, count in ended.most_common():
        print_message(f"  {count:6d}  {reason}")
    print_message(
        f"written to {directory}: see report.md, and study.csv or study.parquet for the rows"
    )
