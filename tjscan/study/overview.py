"""Picture of a study whatever it varies: how many runs are complete, and what they measure."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tjscan.study.backend import StudyBackend
from tjscan.study.groups import RowGroup, group_rows_by_keys, varied_values_by_key
from tjscan.study.row import StudyRow
from tjscan.study.trial import Value

MOST_VALUES: Final = 12
"""A key with more values is shown in as many ranges."""

COMPLETE: Final = "complete / %"


def keys_to_show(rows: Sequence[StudyRow[Any]], seed: str) -> list[str]:
    """Keys that a study's overview shows; of keys that always vary together, the first.

    Parameters
    ----------
    rows : sequence of StudyRow
        Those to show.
    seed : str
        The key of the random numbers, which is not shown.
    """
    shown: list[str] = []
    seen: set[frozenset[tuple[int, ...]]] = set()
    for key in varied_values_by_key(rows):
        parts = frozenset(
            tuple(row.index for row in g.rows) for g in group_rows_by_value(rows, key).values()
        )
        if key != seed and parts not in seen:
            seen.add(parts)
            shown.append(key)
    return shown


def group_rows_by_value(rows: Sequence[StudyRow[Any]], key: str) -> dict[str, RowGroup[Any]]:
    """Group rows by a key's value as text; by ranges of it where it has many values.

    Parameters
    ----------
    rows : sequence of StudyRow
        Those without the key are left out.
    key : str
        Dotted.
    """
    rows = [row for row in rows if key in row.inputs]
    groups = group_rows_by_keys(rows, key)
    numbers = [value for (value,) in groups if isinstance(value, int | float)]
    if len(groups) <= MOST_VALUES or len(numbers) < len(groups):
        ordered = sorted(groups.items(), key=lambda item: _order(item[0][0]))
        return {_word(value): members for (value,), members in ordered}
    edges = np.linspace(min(numbers), max(numbers), MOST_VALUES + 1)
    values = np.array([float(row.inputs[key]) for row in rows])
    places = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, MOST_VALUES - 1)
    ranges: dict[str, list[StudyRow[Any]]] = {f"{a:.0f} to {b:.0f}": [] for a, b in pairwise(edges)}
    words = list(ranges)
    for row, place in zip(rows, places, strict=True):
        ranges[words[place]].append(row)
    return {word: RowGroup(tuple(members)) for word, members in ranges.items() if members}


def draw_overview(rows: Sequence[StudyRow[Any]], kind: StudyBackend[Any]) -> Figure:
    """Draw the overview of a study: a row of panels for every key that was varied.

    Parameters
    ----------
    rows : sequence of StudyRow
        One at least.
    kind : StudyBackend
        Says what is measured.
    """
    keys = keys_to_show(rows, kind.seed)
    figure = Figure(figsize=(13, 2.1 * max(len(keys), 1)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(max(len(keys), 1), 1 + len(kind.measures), squeeze=False)
    for key, line in zip(keys, panels, strict=False):
        groups = group_rows_by_value(rows, key)
        shares = [100 * members.complete_share for members in groups.values()]
        _draw_bars(line[0], list(groups), shares)
        line[0].set_ylim(90.0 if min(shares) > 90.0 else 0.0, 100)
        line[0].set_ylabel(key.removeprefix("joint.").removeprefix("rule."), fontsize="x-small")
        for measure, axes in zip(kind.measures, line[1:], strict=True):
            means = [members.mean_of_complete(measure.value) for members in groups.values()]
            _draw_bars(axes, list(groups), means)
    for name, axes in zip((COMPLETE, *(m.name for m in kind.measures)), panels[0], strict=True):
        axes.set_title(name, fontsize="small")
    return figure


def _draw_bars(axes: Any, names: list[str], values: list[float]) -> None:
    axes.bar(range(len(names)), values, color="#4c78a8", width=0.7)
    turned = max(map(len, names)) > 6
    style: dict[str, Any] = {"rotation": 35, "ha": "right"} if turned else {}
    axes.set_xticks(range(len(names)), names, fontsize="xx-small", **style)
    axes.tick_params(axis="y", labelsize="xx-small")
    axes.grid(axis="y", linewidth=0.3)


def _order(value: Value | None) -> tuple[int, float, str]:
    number = isinstance(value, int | float)
    return (0, float(value), "") if number and value is not None else (1, 0.0, str(value))


def _word(value: Value | None) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
