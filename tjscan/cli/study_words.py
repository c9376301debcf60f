"""What ``tjscan study`` says."""

from __future__ import annotations

import json as json_
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from tjscan.cli.console import say, stderr
from tjscan.study.row import Row


@contextmanager
def watching(total: int) -> Iterator[Callable[[Row], None]]:
    """Give what moves a progress bar on by a row while the block runs."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=stderr) as progress:
        bar = progress.add_task("scans", total=total)

        def watch(row: Row) -> None:
            progress.advance(bar)
            if not row.measured.complete:
                where = ", ".join(f"{key} {value}" for key, value in row.inputs.items())
                line = f"row {row.index} ({where}): {row.measured.reason}"
                progress.console.print(line, markup=False)

        yield watch


def report(rows: Sequence[Row], directory: Path, *, json: bool) -> None:
    """Print how the scans of a study ended: words for people, or JSON on stdout."""
    ended = Counter(row.measured.reason for row in rows)
    complete = sum(row.measured.complete for row in rows)
    if json:
        print(json_.dumps({"scans": len(rows), "complete": complete, "reasons": ended}))
        return
    say(f"{complete} of {len(rows)} scans complete")
    for reason, count in ended.most_common():
        say(f"  {count:6d}  {reason}")
    say(f"written to {directory}: report.md tells it, study.csv and study.parquet hold it")
