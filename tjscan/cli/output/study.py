"""What ``tjscan study`` and ``tjscan chain`` print."""

from __future__ import annotations

import json as json_
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from json import dumps
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import TimeRemainingColumn

from tjscan.cli.output.console import print_figures_table, print_message, progress_bars
from tjscan.runs.chain import ChainOutcome, ErrorSourceRow, mount_error_in_words
from tjscan.study.report import how_runs_ended
from tjscan.study.rows import StudyRows
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


def print_study_outcome(rows: StudyRows, directory: Path, *, json: bool) -> None:
    """Print how the runs of a study ended, on stderr, or as JSON on stdout."""
    complete, ended = how_runs_ended(rows)
    if json:
        print(json_.dumps({"scans": len(rows), "complete": complete, "reasons": ended}))
        return
    print_message(f"{complete} of {len(rows)} runs complete")
    for reason, count in ended.most_common():
        print_message(f"  {count:6d}  {reason}")
    print_message(
        f"written to {directory}: see report.md, and study.csv or study.parquet for the rows"
    )


def print_error_sources(rows: Sequence[ErrorSourceRow], *, json: bool) -> None:
    """Print what each source of error leaves, on stderr, and as JSON on stdout if asked."""
    head = ("source alone", "corners mean mm", "p95 mm", "in own frame mm", "T_f_s off by")
    print_figures_table(head, [(row.source, *_chain_outcome_cells(row.outcome)) for row in rows])
    for row in rows:
        if row.outcome is None:
            print_message(f"{row.source}: {row.refusal}")
        elif row.outcome.held_out is not None and row is rows[0]:
            before, after = row.outcome.held_out
            print_message(
                f"the arm in postures that took no part: {1e3 * before:.3f} mm before, "
                f"{1e3 * after:.3f} mm calibrated"
            )
    if json:
        print(dumps([_chain_outcome_to_dict(row) for row in rows], indent=2))


def error_source_line(row: ErrorSourceRow) -> str:
    """What one source leaves, in a line, as soon as it is known."""
    if row.outcome is None:
        return "  refused"
    return (
        f"  corners {1e3 * row.outcome.mean_corner_error:.3f} mm off in the mean, "
        f"{1e3 * row.outcome.p95_corner_error:.3f} mm at the 95th percentile"
    )


def _chain_outcome_cells(outcome: ChainOutcome | None) -> tuple[str, ...]:
    if outcome is None:
        return ("refused", "", "", "")
    errors = (outcome.mean_corner_error, outcome.p95_corner_error, outcome.mean_own_frame_error)
    return (*(f"{1e3 * error:.3f}" for error in errors), mount_error_in_words(outcome))


def _chain_outcome_to_dict(row: ErrorSourceRow) -> dict[str, Any]:
    one = row.outcome
    if one is None:
        return {"source": row.source, "refused": row.refusal}
    return {
        "source": row.source,
        "corners_mean_mm": 1e3 * one.mean_corner_error,
        "corners_p95_mm": 1e3 * one.p95_corner_error,
        "corners_in_own_frame_mean_mm": 1e3 * one.mean_own_frame_error,
        "mount_error_mm_deg": [*1e3 * one.mount_error[:3], *np.degrees(one.mount_error[3:])],
        "mount_nees": one.mount_nees,
        "held_out_mm": None if one.held_out is None else [1e3 * v for v in one.held_out],
    }
