"""Picture of a study whatever it varies: how many scans are complete, how they step and see."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tjscan.study.groups import SEED, Group, group, varied
from tjscan.study.row import Row
from tjscan.study.task import Value

MOST_VALUES: Final = 12
"""A key with more values is told in as many ranges."""

SHOWN: Final[dict[str, Callable[[Group], float]]] = {
    "complete / %": lambda g: 100 * g.share,
    "profiles per section": lambda g: g.mean(lambda m: m.scans_per_section),
    "mean step error / %": lambda g: g.mean(lambda m: m.step_error_percent),
    "mean corner error / mm": lambda g: g.mean(lambda m: m.corner_mean_mm),
}


def told_by(rows: Sequence[Row]) -> list[str]:
    """The keys that an overview tells of; of keys that always go together, the first."""
    keys, shown = varied(rows), []
    seen: set[frozenset[tuple[int, ...]]] = set()
    for key in keys:
        parts = frozenset(tuple(row.index for row in g.rows) for g in by_value(rows, key).values())
        if key != SEED and parts not in seen:
            seen.add(parts)
            shown.append(key)
    return shown


def by_value(rows: Sequence[Row], key: str) -> dict[str, Group]:
    """Rows by the value of a key, in words; by ranges of it where it has many values."""
    groups = group([row for row in rows if key in row.inputs], key)
    numbers = [value for (value,) in groups if isinstance(value, int | float)]
    if len(groups) <= MOST_VALUES or len(numbers) < len(groups):
        ordered = sorted(groups.items(), key=lambda item: _order(item[0][0]))
        return {_word(value): members for (value,), members in ordered}
    edges = np.linspace(min(numbers), max(numbers), MOST_VALUES + 1)
    values = np.array([float(row.inputs[key]) for row in rows if key in row.inputs])
    places = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, MOST_VALUES - 1)
    ranges: dict[str, list[Row]] = {f"{a:.0f} to {b:.0f}": [] for a, b in pairwise(edges)}
    words = list(ranges)
    for row, place in zip((row for row in rows if key in row.inputs), places, strict=True):
        ranges[words[place]].append(row)
    return {word: Group(tuple(members)) for word, members in ranges.items() if members}


def draw_overview(rows: Sequence[Row]) -> Figure:
    """Draw a row of panels for every key that was varied."""
    keys = told_by(rows)
    figure = Figure(figsize=(13, 2.1 * max(len(keys), 1)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(max(len(keys), 1), len(SHOWN), squeeze=False)
    for key, line in zip(keys, panels, strict=False):
        groups = by_value(rows, key)
        for (name, value), axes in zip(SHOWN.items(), line, strict=True):
            _draw_bars(axes, list(groups), [value(members) for members in groups.values()])
            if axes in panels[0]:
                axes.set_title(name, fontsize="small")
            if name == "complete / %":
                axes.set_ylim(min(90.0, *(100 * g.share for g in groups.values())), 100)
        line[0].set_ylabel(key.removeprefix("joint.").removeprefix("rule."), fontsize="x-small")
    return figure


def _draw_bars(axes: Any, names: list[str], values: list[float]) -> None:
    axes.bar(range(len(names)), values, color="#4c78a8", width=0.7)
    turned = max(map(len, names)) > 6
    look: dict[str, Any] = {"rotation": 35, "ha": "right"} if turned else {}
    axes.set_xticks(range(len(names)), names, fontsize="xx-small", **look)
    axes.tick_params(axis="y", labelsize="xx-small")
    axes.grid(axis="y", linewidth=0.3)


def _order(value: Value | None) -> tuple[int, float, str]:
    number = isinstance(value, int | float)
    return (0, float(value), "") if number and value is not None else (1, 0.0, str(value))


def _word(value: Value | None) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
