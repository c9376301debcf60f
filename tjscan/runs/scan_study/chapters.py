"""The report of the paper's programme: means by prediction and step, beside the paper's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import isnan
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from tjscan.result.picture import write_png
from tjscan.runs.scan_study.figures import (
    PredictionBarChart,
    draw_flange_paths,
    draw_step_lengths,
    draw_travel_and_rotation,
)
from tjscan.runs.scan_study.outcome import ScanOutcome
from tjscan.runs.scan_study.paper import (
    LARGEST_STEP_ERROR_PERCENT,
    ROTATION_DEG,
    TRAVEL_MM,
    PaperBarValue,
)
from tjscan.study.groups import RowGroup
from tjscan.study.row import StudyRow
from tjscan.study.trial import Value

MEASURES: Final[dict[str, tuple[Callable[[ScanOutcome], float | None], str]]] = {
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


def write_paper_comparison(folder: Path, rows: Sequence[StudyRow[ScanOutcome]]) -> Iterator[str]:
    """Yield report lines that compare a study with the paper's programme, and write pictures.

    Parameters
    ----------
    folder : Path
        Where the pictures go.
    rows : sequence of StudyRow
        All with a prediction and a step length, one complete at least.

    Raises
    ------
    RecordingError
        If a picture can't be written.
    """
    chart = PredictionBarChart(rows)
    yield "Means over the complete scans of each prediction at each step length:"
    yield ""
    for name, (value, form) in MEASURES.items():
        yield from _table(chart, name, value, form)
    yield from _compared(chart)
    pictures: dict[str, Callable[[Sequence[StudyRow[ScanOutcome]]], Figure]] = {
        "steps": draw_step_lengths,
        "effort": draw_travel_and_rotation,
        "paths": draw_flange_paths,
    }
    for name, draw in pictures.items():
        write_png(folder / f"{name}.png", draw(rows))
        yield f"![{name}]({name}.png)"
        yield ""


def _table(
    chart: PredictionBarChart, name: str, value: Callable[[ScanOutcome], float | None], form: str
) -> Iterator[str]:
    yield f"| {name} | {' | '.join(f'{step:g} mm' for step in chart.steps)} |"
    yield f"| --- |{' ---: |' * len(chart.steps)}"
    for case in chart.cases:
        cells = [_cell(chart.rows_of_bar(case, step), value, form) for step in chart.steps]
        yield f"| {_case(case)} | {' | '.join(cells)} |"
    yield ""


def _cell(
    members: RowGroup[ScanOutcome] | None, value: Callable[[ScanOutcome], float | None], form: str
) -> str:
    if members is None:
        return ""
    mean = members.mean_of_complete(value)
    missing = (
        ""
        if members.complete_share == 1
        else f" ({len(members.complete_rows)} of {len(members.rows)})"
    )
    return ("–" if isnan(mean) else f"{mean:{form}}") + missing


def _compared(chart: PredictionBarChart) -> Iterator[str]:
    yield "| beside the paper | paper | here |"
    yield "| --- | ---: | ---: |"
    for case, largest in LARGEST_STEP_ERROR_PERCENT.items():
        found = [chart.rows_of_bar(case, step) for step in chart.steps]
        errors = [
            abs(g.mean_of_complete(lambda m: m.step_error_percent))
            for g in found
            if g and g.complete_rows
        ]
        if errors:
            yield f"| largest mean step error, case {case} | {largest} % | {max(errors):.2f} % |"
    for bars, what, unit, value in _papers_bars():
        for bar in bars:
            members = chart.rows_of_bar(bar.case, bar.step_mm)
            if members is not None:
                cell = _cell(members, value, ".0f")
                where = f"case {bar.case}, {bar.step_mm:g} mm steps"
                yield f"| {what}, {where} | {bar.value:g} {unit} | {cell} {unit} |"
    yield ""


def _papers_bars() -> Iterator[
    tuple[tuple[PaperBarValue, ...], str, str, Callable[[ScanOutcome], float | None]]
]:
    yield TRAVEL_MM, "flange travel", "mm", lambda m: m.travel_mm
    yield ROTATION_DEG, "flange rotation", "°", lambda m: m.rotation_deg


def _case(case: Value | None) -> str:
    return f"case {case}" if isinstance(case, int) else str(case)
