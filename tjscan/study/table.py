"""``study.csv`` and ``study.parquet``: a row per run."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

from tjscan.study.row import StudyRow
from tjscan.study.trial import Value

CSV: Final = "study.csv"
PARQUET: Final = "study.parquet"
WALL: Final = "wall_s"

Cell = Value | None


def table_columns(rows: Sequence[StudyRow[Any]]) -> dict[str, list[Cell]]:
    """Columns of a study's table: row, what was varied, what came out, and the wall-clock time.

    Parameters
    ----------
    rows : sequence of StudyRow
        One at least, all of one kind.
    """
    inputs = dict.fromkeys(key for row in rows for key in row.inputs)
    shown = [f.name for f in fields(rows[0].outcome) if f.metadata.get("column", True)]
    table: dict[str, list[Cell]] = {"row": [row.index for row in rows]}
    table |= {key: [row.inputs.get(key) for row in rows] for key in inputs}
    table |= {name: [getattr(row.outcome, name) for row in rows] for name in shown}
    return table | {WALL: [round(row.wall_s, 3) for row in rows]}


def write_study_csv(file: Path, rows: Sequence[StudyRow[Any]]) -> None:
    """Write the table as CSV; numbers to the last digit, what is not known as nothing.

    Parameters
    ----------
    file : Path
        Where to.
    rows : sequence of StudyRow
        As `table_columns` takes them.
    """
    table = table_columns(rows)
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(table)
        writer.writerows(zip(*table.values(), strict=True))


def write_study_parquet(file: Path, rows: Sequence[StudyRow[Any]]) -> None:
    """Write the table as Parquet; a column whose values are of several types becomes text.

    Parameters
    ----------
    file : Path
        Where to.
    rows : sequence of StudyRow
        As `table_columns` takes them.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({n: _one_type(v) for n, v in table_columns(rows).items()}), file)


def _one_type(values: list[Cell]) -> list[Cell]:
    types = {type(value) for value in values if value is not None}
    if types <= {int, float} and len(types) == 2:
        return [None if value is None else float(value) for value in values]
    return values if len(types) < 2 else [None if v is None else str(v) for v in values]
