"""``report.md``: a study in words, tables and pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isnan
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import numpy as np
from matplotlib.figure import Figure

from tjscan.result.picture import write_png
from tjscan.study.trial import ReportedQuantity, RunOutcome, StudyBackend, StudyRow, Value

O = TypeVar("O", bound=RunOutcome)  # noqa: E741

Rows = Sequence[StudyRow[Any]]

REPORT_FILE: Final = "report.md"

OVERVIEW_PICTURE: Final = "overview.png"

MOST_FAILED_RUNS_LISTED: Final = 40
"""Runs that are not complete and listed one by one."""

MOST_VALUES_LISTED: Final = 12
"""A key with more values is shown in as many ranges."""


@dataclass(frozen=True, slots=True)
class RowGroup(Generic[O]):
    """Rows of a study that share the value of a key, one at least.

    Parameters
    ----------
    rows : tuple of StudyRow
        The rows.
    """

    rows: tuple[StudyRow[O], ...]

    @property
    def complete_rows(self) -> tuple[StudyRow[O], ...]:
        """The rows whose run did what was asked."""
        return tuple(row for row in self.rows if row.outcome.complete)

    @property
    def complete_share(self) -> float:
        """Share of the rows that are complete, from 0 to 1."""
        return len(self.complete_rows) / len(self.rows)

    def mean_of_complete(self, value: Callable[[O], float | None]) -> float:
        """Mean of a quantity over the complete rows; NaN if no value is known."""
        values = [value(row.outcome) for row in self.complete_rows]
        known = [value for value in values if value is not None]
        return float(np.mean(known)) if known else float("nan")


MOST_ROWS_REPORTED: Final = 50_000
"""Of more rows, so many are read for the tables and pictures of the report."""


def write_study_report(folder: Path, kind: StudyBackend[Any], done: Rows, *, planned: int) -> None:
    """Write the report of a study, and its pictures beside it.

    Parameters
    ----------
    folder : Path
        Where to.
    kind : StudyBackend
        What was run.
    done : sequence of StudyRow
        What is done so far, one row at least.
    planned : int
        How many runs the whole study makes.

    Raises
    ------
    RecordingError
        If a picture can't be written.
    """
    rows = done[:: -(-len(done) // MOST_ROWS_REPORTED)]
    keys = keys_to_show(rows, kind.seed)
    lines = [*_lines_of_end_reasons(done, planned)]
    if len(rows) < len(done):
        lines += [f"Below are {len(rows)} of the {len(done)} rows, evenly spaced.", ""]
    if len({row.inputs.get(kind.compared_key) for row in rows}) > 1:
        for quantity in kind.measures:
            lines += _lines_side_by_side(rows, keys, kind.compared_key, quantity)
    for key in keys:
        lines += _table_of_key(rows, key, kind)
    if keys:
        write_png(folder / OVERVIEW_PICTURE, _draw_overview(rows, keys, kind))
        lines += [f"![overview]({OVERVIEW_PICTURE})", ""]
    lines += _lines_of_failures(rows)
    (folder / REPORT_FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")


def keys_to_show(rows: Rows, seed: str) -> list[str]:
    """Keys that a report shows: those with several values; of keys that vary together, the first.

    Parameters
    ----------
    rows : sequence of StudyRow
        Those to show.
    seed : str
        The key of the random numbers, which is not shown.
    """
    shown: dict[frozenset[tuple[int, ...]], str] = {}
    for key in dict.fromkeys(key for row in rows for key in row.inputs):
        groups = _groups_by_value(rows, key)
        if key != seed and len({row.inputs[key] for row in rows if key in row.inputs}) > 1:
            parts = (tuple(row.index for row in group.rows) for group in groups.values())
            shown.setdefault(frozenset(parts), key)
    return list(shown.values())


def _groups_by_value(rows: Rows, key: str) -> dict[str, RowGroup[Any]]:
    """Rows by a key's value as text, or by ranges of it if it has many; without rows lacking it."""
    rows = [row for row in rows if key in row.inputs]
    values = {row.inputs[key] for row in rows}
    numbers = [value for value in values if isinstance(value, int | float)]
    members: dict[str, list[StudyRow[Any]]]
    if len(values) <= MOST_VALUES_LISTED or len(numbers) < len(values):
        members = {_cell_text(value): [] for value in sorted(values, key=_sorting_key)}
        for row in rows:
            members[_cell_text(row.inputs[key])].append(row)
    else:
        edges = np.linspace(min(numbers), max(numbers), MOST_VALUES_LISTED + 1)
        names = [f"{a:.0f} to {b:.0f}" for a, b in pairwise(edges)]
        members = {name: [] for name in names}
        for row in rows:
            place = np.searchsorted(edges, float(row.inputs[key]), side="right") - 1
            members[names[np.clip(place, 0, MOST_VALUES_LISTED - 1)]].append(row)
    return {name: RowGroup(tuple(some)) for name, some in members.items() if some}


def _sorting_key(value: Value) -> tuple[int, float, str]:
    return (0, float(value), "") if isinstance(value, int | float) else (1, 0.0, str(value))


def _cell_text(value: Value) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _table_lines(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Lines of a table whose first column is text, and whose others are numbers."""
    yield f"| {' | '.join(head)} |"
    yield f"| --- |{' ---: |' * (len(head) - 1)}"
    yield from (f"| {' | '.join(row)} |" for row in rows)
    yield ""


def _lines_of_end_reasons(rows: Rows, planned: int) -> Iterator[str]:
    complete, reasons = how_runs_ended(rows)
    yield from ("# Study", "")
    yield f"{complete} of {len(rows)} runs complete ({complete / len(rows):.2%})."
    if len(rows) < planned:
        yield f"{planned - len(rows)} runs are still to be made."
    yield ""
    table = ((reason, f"{n}") for reason, n in reasons.most_common())
    yield from _table_lines(("ended because", "runs"), table)


def how_runs_ended(rows: Iterable[StudyRow[Any]]) -> tuple[int, Counter[str]]:
    """How many runs are complete, and how many ended for each reason."""
    ended = Counter((row.outcome.complete, row.outcome.reason) for row in rows)
    reasons = Counter[str]()
    for (_, reason), count in ended.items():
        reasons[reason] += count
    return sum(count for (complete, _), count in ended.items() if complete), reasons


def _lines_side_by_side(
    rows: Rows, keys: Sequence[str], compared: str, quantity: ReportedQuantity[Any]
) -> Iterator[str]:
    """A table of one quantity with a column for each value of the key that is compared."""
    has_key = [row for row in rows if compared in row.inputs]
    columns = dict.fromkeys(_cell_text(row.inputs[compared]) for row in has_key)
    groups = [("all", RowGroup(tuple(rows)))]
    for key in keys:
        if key != compared:
            groups += [(f"{key} {v}", group) for v, group in _groups_by_value(rows, key).items()]
    table = []
    for name, group in groups:
        found = _groups_by_value(group.rows, compared)
        table.append((name, *(_mean_cell(found.get(column), quantity) for column in columns)))
    yield from _table_lines((f"{quantity.name}: mean of complete runs", *columns), table)


def _mean_cell(group: RowGroup[Any] | None, quantity: ReportedQuantity[Any]) -> str:
    if group is None:
        return "–"
    mean = group.mean_of_complete(quantity.value)
    text = "–" if isnan(mean) else f"{mean:{quantity.form}}"
    return f"{text} ({len(group.complete_rows)} of {len(group.rows)})"


def _table_of_key(rows: Rows, key: str, kind: StudyBackend[Any]) -> Iterator[str]:
    """A table of one key: how many runs of each value are complete, and what they measure."""
    table = []
    for word, group in _groups_by_value(rows, key).items():
        means = (f"{group.mean_of_complete(m.value):{m.form}}" for m in kind.measures)
        table.append((word, f"{len(group.rows)}", f"{group.complete_share:.1%}", *means))
    yield from _table_lines((key, "runs", "complete", *(m.name for m in kind.measures)), table)


def _draw_overview(rows: Rows, keys: Sequence[str], kind: StudyBackend[Any]) -> Figure:
    """Bars of each key's values: how many runs are complete, and what they measure."""
    figure = Figure(figsize=(13, 2.1 * len(keys)), layout="constrained")
    panels = figure.subplots(len(keys), 1 + len(kind.measures), squeeze=False)
    for key, line in zip(keys, panels, strict=True):
        groups = _groups_by_value(rows, key)
        shares = [100 * group.complete_share for group in groups.values()]
        _draw_bars(line[0], list(groups), shares)
        line[0].set_ylim(90.0 if min(shares) > 90.0 else 0.0, 100)
        line[0].set_ylabel(key.removeprefix("joint.").removeprefix("rule."), fontsize="x-small")
        for measure, axes in zip(kind.measures, line[1:], strict=True):
            means = [group.mean_of_complete(measure.value) for group in groups.values()]
            _draw_bars(axes, list(groups), means)
    titles = ("complete / %", *(measure.name for measure in kind.measures))
    for name, axes in zip(titles, panels[0], strict=True):
        axes.set_title(name, fontsize="small")
    return figure


def _draw_bars(axes: Any, names: list[str], values: list[float]) -> None:
    axes.bar(range(len(names)), values, color="#4c78a8", width=0.7)
    turned = max(map(len, names)) > 6
    style: dict[str, Any] = {"rotation": 35, "ha": "right"} if turned else {}
    axes.set_xticks(range(len(names)), names, fontsize="xx-small", **style)
    axes.tick_params(axis="y", labelsize="xx-small")
    axes.grid(axis="y", linewidth=0.3)


def _lines_of_failures(rows: Rows) -> Iterator[str]:
    failed = [row for row in rows if not row.outcome.complete]
    if not failed:
        return
    yield from ("Runs that are not complete:", "")
    for row in failed[:MOST_FAILED_RUNS_LISTED]:
        where = ", ".join(f"{key} {value}" for key, value in row.inputs.items())
        yield f"- row {row.index} ({where}): {row.outcome.detail}"
    if len(failed) > MOST_FAILED_RUNS_LISTED:
        yield f"- and {len(failed) - MOST_FAILED_RUNS_LISTED} more, in `study.csv`"
    yield ""
