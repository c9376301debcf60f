"""``report.md``: a study in words, tables and pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from math import isnan
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from tjscan.result.picture import write_picture
from tjscan.study.figures import Chart, draw_effort, draw_paths, draw_steps
from tjscan.study.groups import Group
from tjscan.study.overview import by_value, draw_overview, told_by
from tjscan.study.paper import (
    CASE,
    LARGEST_STEP_ERROR_PERCENT,
    ROTATION_DEG,
    STEP,
    TRAVEL_MM,
    Bar,
)
from tjscan.study.row import Measured, Row
from tjscan.study.task import Value

REPORT: Final = "report.md"
MOST_CAUSES: Final = 40
"""Scans that are not complete and listed one by one."""

MEASURES: Final[dict[str, tuple[Callable[[Measured], float | None], str]]] = {
    "Mean step error, %": (lambda m: m.step_error_percent, "+.2f"),
    "Standard deviation of the step, mm": (lambda m: m.step_std_mm, ".2f"),
    "Profiles per section": (lambda m: m.scans_per_section, ".2f"),
    "Half steps": (lambda m: float(m.half_steps), ".1f"),
    "Flange travel, mm": (lambda m: m.travel_mm, ".0f"),
    "of which prediction, mm": (lambda m: m.travel_prediction_mm, ".0f"),
    "Flange rotation, °": (lambda m: m.rotation_deg, ".0f"),
    "of which prediction, °": (lambda m: m.rotation_prediction_deg, ".0f"),
    "Motion time, s": (lambda m: m.motion_time_s, ".1f"),
    "Mean corner error, mm": (lambda m: m.corner_mean_mm, ".3f"),
}


def write_report(folder: Path, rows: Sequence[Row], *, planned: int) -> None:
    """Write the report and its pictures.

    Parameters
    ----------
    folder : Path
        Where to.
    rows : sequence of Row
        What is done so far, one row at least.
    planned : int
        How many rows there will be.
    """
    lines = [*_ended(rows, planned)]
    as_paper = all(CASE in row.inputs and STEP in row.inputs for row in rows)
    if as_paper and any(row.measured.complete for row in rows):
        lines += [*_as_in_the_paper(folder, rows)]
    elif told_by(rows):
        lines += [*_by_keys(folder, rows)]
    lines += [*_causes(rows)]
    (folder / REPORT).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _ended(rows: Sequence[Row], planned: int) -> Iterator[str]:
    complete = sum(row.measured.complete for row in rows)
    yield "# Study"
    yield ""
    yield f"{complete} of {len(rows)} scans complete ({complete / len(rows):.2%})."
    if len(rows) < planned:
        yield f"{planned - len(rows)} scans are still to be made."
    yield ""
    yield "| ended because | scans |"
    yield "| --- | ---: |"
    for reason, count in Counter(row.measured.reason for row in rows).most_common():
        yield f"| {reason} | {count} |"
    yield ""


def _as_in_the_paper(folder: Path, rows: Sequence[Row]) -> Iterator[str]:
    chart = Chart(rows)
    yield "Means over the complete scans of each prediction at each step length:"
    yield ""
    for name, (value, form) in MEASURES.items():
        yield from _table(chart, name, value, form)
    yield from _beside_the_paper(chart)
    pictures: dict[str, Callable[[Sequence[Row]], Figure]] = {
        "steps": draw_steps,
        "effort": draw_effort,
        "paths": draw_paths,
    }
    for name, draw in pictures.items():
        write_picture(folder / f"{name}.png", draw(rows))
        yield f"![{name}]({name}.png)"
        yield ""


def _table(
    chart: Chart, name: str, value: Callable[[Measured], float | None], form: str
) -> Iterator[str]:
    yield f"| {name} | {' | '.join(f'{step:g} mm' for step in chart.steps)} |"
    yield f"| --- |{' ---: |' * len(chart.steps)}"
    for case in chart.cases:
        cells = [_cell(chart.at(case, step), value, form) for step in chart.steps]
        yield f"| {_case(case)} | {' | '.join(cells)} |"
    yield ""


def _cell(members: Group | None, value: Callable[[Measured], float | None], form: str) -> str:
    if members is None:
        return ""
    mean = members.mean(value)
    missing = "" if members.share == 1 else f" ({len(members.complete)} of {len(members.rows)})"
    return ("–" if isnan(mean) else f"{mean:{form}}") + missing


def _beside_the_paper(chart: Chart) -> Iterator[str]:
    yield "| beside the paper | paper | here |"
    yield "| --- | ---: | ---: |"
    for case, largest in LARGEST_STEP_ERROR_PERCENT.items():
        found = [chart.at(case, step) for step in chart.steps]
        errors = [abs(g.mean(lambda m: m.step_error_percent)) for g in found if g and g.complete]
        if errors:
            yield f"| largest mean step error, case {case} | {largest} % | {max(errors):.2f} % |"
    for bars, what, unit, value in _papers_bars():
        for bar in bars:
            members = chart.at(bar.case, bar.step_mm)
            if members is not None:
                cell = _cell(members, value, ".0f")
                where = f"case {bar.case}, {bar.step_mm:g} mm steps"
                yield f"| {what}, {where} | {bar.value:g} {unit} | {cell} {unit} |"
    yield ""


def _papers_bars() -> Iterator[
    tuple[tuple[Bar, ...], str, str, Callable[[Measured], float | None]]
]:
    yield TRAVEL_MM, "flange travel", "mm", lambda m: m.travel_mm
    yield ROTATION_DEG, "flange rotation", "°", lambda m: m.rotation_deg


def _case(case: Value | None) -> str:
    return f"case {case}" if isinstance(case, int) else str(case)


def _by_keys(folder: Path, rows: Sequence[Row]) -> Iterator[str]:
    for key in told_by(rows):
        yield f"| {key} | scans | complete | profiles per section | mean corner error |"
        yield "| --- | ---: | ---: | ---: | ---: |"
        for word, members in by_value(rows, key).items():
            seen = members.mean(lambda m: m.scans_per_section)
            corner = members.mean(lambda m: m.corner_mean_mm)
            yield (
                f"| {word} | {len(members.rows)} | {members.share:.1%} | {seen:.2f} | "
                f"{corner:.3f} mm |"
            )
        yield ""
    write_picture(folder / "overview.png", draw_overview(rows))
    yield "![overview](overview.png)"
    yield ""


def _causes(rows: Sequence[Row]) -> Iterator[str]:
    failed = [row for row in rows if not row.measured.complete]
    if not failed:
        return
    yield "Scans that are not complete:"
    yield ""
    for row in failed[:MOST_CAUSES]:
        where = ", ".join(f"{key} {value}" for key, value in row.inputs.items())
        yield f"- row {row.index} ({where}): {row.measured.detail}"
    if len(failed) > MOST_CAUSES:
        yield f"- and {len(failed) - MOST_CAUSES} more, in `study.csv`"
    yield ""
