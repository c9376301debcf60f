"""Rows of a study on disk: written as they come, read in the order of the plan, and as tables."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from itertools import islice
from pathlib import Path
from typing import Any, Final, overload

import numpy as np
from numpy.typing import NDArray

from tjscan.core import files
from tjscan.core.errors import RecordingError
from tjscan.study.plan import StudyPlan
from tjscan.study.trial import RunOutcome, StudyRow, Value

STUDY_ROWS_FILE: Final = "rows.jsonl"
CSV_FILE: Final = "study.csv"
PARQUET_FILE: Final = "study.parquet"

MOST_ROWS_BYTES: Final = 20_000_000_000
"""A larger file holds no rows of a study."""

ROWS_IN_MEMORY: Final = 10_000
"""How many rows a table takes at once."""

NO_ROW_OFFSET: Final = -1


class StudyRows(Sequence[StudyRow[Any]]):
    """Finished rows of a plan, in its order; in memory is only where each begins.

    Parameters
    ----------
    directory : Path
        The study's.
    plan : StudyPlan
        What was planned; rows of other trials are passed over.
    outcome : type
        Of what came out of a run.

    Raises
    ------
    ConfigurationError
        If the file is no file, or too large.
    RecordingError
        If it can't be read.
    """

    def __init__(self, directory: Path, plan: StudyPlan, outcome: type[RunOutcome]) -> None:
        self._file, self._outcome = directory / STUDY_ROWS_FILE, outcome
        self._offsets = np.full(len(plan), NO_ROW_OFFSET, dtype=np.int64)
        if not self._file.exists():
            return
        files.check_file_size(self._file, MOST_ROWS_BYTES, "the rows of a study")
        with self._reading() as stream:
            while line := stream.readline():
                row = self._row_of_line(line)
                if (
                    row is not None
                    and 0 <= row.index < len(plan)
                    and plan[row.index].hash_key == row.key
                ):
                    self._offsets[row.index] = stream.tell() - len(line)

    def __len__(self) -> int:
        return int(np.count_nonzero(self._offsets != NO_ROW_OFFSET))

    @property
    def missing(self) -> Iterator[int]:
        """Indices of the trials that have no row yet."""
        return (
            index for index in range(len(self._offsets)) if self._offsets[index] == NO_ROW_OFFSET
        )

    def __iter__(self) -> Iterator[StudyRow[Any]]:
        return self._rows_at(self._done)

    @overload
    def __getitem__(self, place: int) -> StudyRow[Any]: ...
    @overload
    def __getitem__(self, place: slice) -> list[StudyRow[Any]]: ...
    def __getitem__(self, place: int | slice) -> StudyRow[Any] | list[StudyRow[Any]]:
        if isinstance(place, slice):
            return list(self._rows_at(self._done[place]))
        return next(self._rows_at(self._done[[place]]))

    @property
    def _done(self) -> NDArray[np.int64]:
        done: NDArray[np.int64] = self._offsets[self._offsets != NO_ROW_OFFSET]
        return done

    def _rows_at(self, offsets: NDArray[np.int64]) -> Iterator[StudyRow[Any]]:
        if not len(offsets):
            return
        with self._reading() as stream:
            for offset in offsets:
                stream.seek(offset)
                row = self._row_of_line(stream.readline())
                if row is None:
                    raise RecordingError(f"{self._file}: was changed while it was read")
                yield row

    @contextmanager
    def open_to_append(self) -> Iterator[Callable[[StudyRow[Any]], None]]:
        """Open the file; gives the function that writes a row to disk.

        Raises
        ------
        RecordingError
            If the file can't be written.
        """
        try:
            with self._file.open("ab") as file:
                if file.tell():
                    file.write(b"\n")  # ends a line that was cut off; an empty one is no row

                def keep(row: StudyRow[Any]) -> None:
                    at = file.tell()
                    file.write(row.to_json_line().encode() + b"\n")
                    files.sync_stream_to_disk(file)
                    self._offsets[row.index] = at

                yield keep
        except OSError as error:
            reason = f"{self._file}: can't be written: {error.strerror}"
            raise RecordingError(reason) from error

    @contextmanager
    def _reading(self) -> Iterator[Any]:
        try:
            with self._file.open("rb") as stream:
                yield stream
        except OSError as error:
            raise RecordingError(f"{self._file}: can't be read: {error.strerror}") from error

    def _row_of_line(self, line: bytes) -> StudyRow[Any] | None:
        try:
            return StudyRow.from_json_line(line.decode(errors="replace"), self._outcome)
        except (ValueError, RecursionError):
            return None


def write_study_tables(folder: Path, rows: StudyRows) -> None:
    """Write ``study.csv`` and ``study.parquet``: each row's inputs, outcome, code and time.

    CSV holds numbers to the last digit, and nothing for what is not known; in Parquet a column
    whose values are of several types becomes text.

    Parameters
    ----------
    folder : Path
        Where to.
    rows : StudyRows
        One at least.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    types: dict[str, set[type]] = {}
    for row in rows:
        for name, value in _cells_of_row(row).items():
            types.setdefault(name, set()).update(() if value is None else (type(value),))
    last = {name: types.pop(name) for name in _last_columns(next(iter(rows)))}
    types |= last
    schema = pa.schema([(name, _arrow_type(kinds)) for name, kinds in types.items()])
    with (
        (folder / CSV_FILE).open("w", newline="", encoding="utf-8") as out,
        pq.ParquetWriter(folder / PARQUET_FILE, schema) as parquet,
    ):
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(types)
        left = map(_cells_of_row, rows)
        while some := list(islice(left, ROWS_IN_MEMORY)):
            writer.writerows([cells.get(name) for name in types] for cells in some)
            columns = {
                name: [_as_one_type(cells.get(name), kinds) for cells in some]
                for name, kinds in types.items()
            }
            parquet.write_table(pa.table(columns, schema=schema))


def _last_columns(row: StudyRow[Any]) -> list[str]:
    """What follows the inputs, of which a row may have more than another."""
    return [name for name in _cells_of_row(row) if name != "row" and name not in row.inputs]


def _cells_of_row(row: StudyRow[Any]) -> dict[str, Value | None]:
    shown = [f.name for f in fields(row.outcome) if f.metadata.get("column", True)]
    return {
        "row": row.index,
        **row.inputs,
        **{name: getattr(row.outcome, name) for name in shown},
        "code": row.code,
        "wall_s": round(row.wall_s, 3),
    }


def _arrow_type(kinds: set[type]) -> Any:
    import pyarrow as pa

    if len(kinds) > 1:
        return pa.float64() if kinds == {int, float} else pa.string()
    known = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}
    return known[next(iter(kinds))] if kinds else pa.null()


def _as_one_type(value: Value | None, kinds: set[type]) -> Value | None:
    if value is None or len(kinds) < 2:
        return value
    return float(value) if kinds == {int, float} else str(value)
