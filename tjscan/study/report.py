"""``report.md``: a study in words, tables and pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from tjscan.result.picture import write_png
from tjscan.study.backend import StudyBackend
from tjscan.study.overview import draw_overview, group_rows_by_value, keys_to_show
from tjscan.study.row import StudyRow

REPORT: Final = "report.md"
MOST_CAUSES: Final = 40
"""Runs that are not complete and listed one by one."""


def write_study_report(
    folder: Path, kind: StudyBackend[Any], rows: Sequence[StudyRow[Any]], *, planned: int
) -> None:
    """Write the report of a study and its pictures.

    Parameters
    ----------
    folder : Path
        Where to.
    kind : StudyBackend
        Says what is measured, and may have chapters of its own.
    rows : sequence of StudyRow
        What is done so far, one row at least.
    planned : int
        How many rows there will be.

    Raises
    ------
    RecordingError
        If a picture can't be written.
    """
    chapters = [*kind.special_report_lines(folder, rows)] or [
        *write_overview_lines(folder, kind, rows)
    ]
    lines = [*_ended(rows, planned), *chapters, *_causes(rows)]
    (folder / REPORT).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _ended(rows: Sequence[StudyRow[Any]], planned: int) -> Iterator[str]:
    complete = sum(row.outcome.complete for row in rows)
    yield "# Study"
    yield ""
    yield f"{complete} of {len(rows)} runs complete ({complete / len(rows):.2%})."
    if len(rows) < planned:
        yield f"{planned - len(rows)} runs are still to be made."
    yield ""
    yield "| ended because | runs |"
    yield "| --- | ---: |"
    for reason, count in Counter(row.outcome.reason for row in rows).most_common():
        yield f"| {reason} | {count} |"
    yield ""


def write_overview_lines(
    folder: Path, kind: StudyBackend[Any], rows: Sequence[StudyRow[Any]]
) -> Iterator[str]:
    """Yield a table of every key that was varied, and write a picture of them all.

    Parameters
    ----------
    folder : Path
        Where the picture goes.
    kind : StudyBackend
        Says what is measured.
    rows : sequence of StudyRow
        One at least.
    """
    keys = keys_to_show(rows, kind.seed)
    for key in keys:
        yield f"| {key} | runs | complete | {' | '.join(m.name for m in kind.measures)} |"
        yield f"| --- | ---: | ---: |{' ---: |' * len(kind.measures)}"
        for word, members in group_rows_by_value(rows, key).items():
            means = (f"{members.mean_of_complete(m.value):{m.form}}" for m in kind.measures)
            share = f"{members.complete_share:.1%}"
            yield f"| {word} | {len(members.rows)} | {share} | {' | '.join(means)} |"
        yield ""
    if keys:
        write_png(folder / "overview.png", draw_overview(rows, kind))
        yield "![overview](overview.png)"
        yield ""


def _causes(rows: Sequence[StudyRow[Any]]) -> Iterator[str]:
    failed = [row for row in rows if not row.outcome.complete]
    if not failed:
        return
    yield "Runs that are not complete:"
    yield ""
    for row in failed[:MOST_CAUSES]:
        where = ", ".join(f"{key} {value}" for key, value in row.inputs.items())
        yield f"- row {row.index} ({where}): {row.outcome.detail}"
    if len(failed) > MOST_CAUSES:
        yield f"- and {len(failed) - MOST_CAUSES} more, in `study.csv`"
    yield ""
