"""Run a study: from its plan to its tables, now or later."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from tjscan.core.files import atomic_directory, sole_writer
from tjscan.study.one import run_task
from tjscan.study.report import write_report
from tjscan.study.row import LOST_WORKER, Row
from tjscan.study.schedule import Done, Lost, Scheduler
from tjscan.study.store import keeping, read_plan, read_rows
from tjscan.study.table import CSV, PARQUET, write_csv, write_parquet
from tjscan.study.task import Task


def run_study(
    directory: Path, scheduler: Scheduler, watch: Callable[[Row], None]
) -> tuple[Row, ...]:
    """Run what a study's directory still lacks, and write its tables.

    A study that is interrupted leaves tables of what is done, and goes on from there.

    Parameters
    ----------
    directory : Path
        What `make_study` made.
    scheduler : Scheduler
        Where the scans run.
    watch : callable
        Is told of every row, those on disk first, after it is on disk.

    Returns
    -------
    tuple of Row
        In the order of the plan.

    Raises
    ------
    ConfigurationError
        If the directory holds no study, or the scheduler can't be had.
    RecordingError
        If the directory can't be written, or another process runs this study.
    """
    tasks = read_plan(directory)
    with sole_writer(directory):
        rows = read_rows(directory, tasks)
        for row in rows.values():
            watch(row)
        try:
            with keeping(directory) as keep:
                for ended in scheduler(run_task, [t for t in tasks if t.key not in rows]):
                    row = _row(ended)
                    keep(row)
                    rows[row.key] = row
                    watch(row)
        finally:
            done = tuple(rows[task.key] for task in tasks if task.key in rows)
            if done:
                write_tables(directory, done, tasks)
    return done


def write_tables(directory: Path, rows: Sequence[Row], tasks: Sequence[Task]) -> None:
    """Write tables, pictures and report of the rows there are, all or none."""
    with atomic_directory(directory) as draft:
        write_csv(draft / CSV, rows)
        write_parquet(draft / PARQUET, rows)
        write_report(draft, rows, planned=len(tasks))


def _row(ended: Done[Task, Row] | Lost[Task]) -> Row:
    if isinstance(ended, Lost):
        return Row.failed(ended.task, LOST_WORKER, ended.cause)
    return ended.result
