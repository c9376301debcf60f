"""``study.csv`` and ``study.parquet``: a row per scan."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Final

from tjscan.study.row import Measured, Row
from tjscan.study.task import Value

CSV: Final = "study.csv"
PARQUET: Final = "study.parquet"
MEASURED: Final = tuple(field.name for field in fields(Measured))
WALL: Final = "wall_s"

Cell = Value | None


def columns(rows: Sequence[Row]) -> dict[str, list[Cell]]:
    """The table by columns: row, what was varied, what came out, and the wall clock at last."""
    inputs = dict.fromkeys(key for row in rows for key in row.inputs)
    table: dict[str, list[Cell]] = {"row": [row.index for row in rows]}
    table |= {key: [row.inputs.get(key) for row in rows] for key in inputs}
    table |= {name: [getattr(row.measured, name) for row in rows] for name in MEASURED}
    return table | {WALL: [round(row.wall_s, 3) for row in rows]}


def write_csv(file: Path, rows: Sequence[Row]) -> None:
    """Write the table as CSV; numbers to the last digit, what is not known as nothing."""
    table = columns(rows)
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(table)
        writer.writerows(zip(*table.values(), strict=True))


def write_parquet(file: Path, rows: Sequence[Row]) -> None:
    """Write the table as Parquet; a column whose values are of several kinds becomes words."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({n: _one_kind(v) for n, v in columns(rows).items()}), file)


def _one_kind(values: list[Cell]) -> list[Cell]:
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float} and len(kinds) == 2:
        return [None if value is None else float(value) for value in values]
    return values if len(kinds) < 2 else [None if v is None else str(v) for v in values]
