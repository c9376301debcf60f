"""Tables and pictures of a study beside those that the papers print.

``python bench/paper_tables.py STUDY_DIR`` writes ``paper.md`` into the study's directory, and for
scans the pictures ``steps.png``, ``effort.png`` and ``paths.png``.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from math import isnan
from pathlib import Path
from typing import Any, Final

from _paper_figures import (
    CASE_KEY,
    LARGEST_STEP_ERROR_PERCENT,
    ROTATION_DEG,
    STEP_KEY,
    TRAVEL_MM,
    PaperBarValue,
    PredictionBarChart,
    draw_flange_paths,
    draw_step_lengths,
    draw_travel_and_rotation,
)
from matplotlib.figure import Figure

from tjscan.core.errors import ConfigurationError
from tjscan.result.picture import write_png
from tjscan.runs.scan.study import ScanOutcome
from tjscan.runs.tasks import study_backend_of_task
from tjscan.runs.tow.results import TowOutcome
from tjscan.runs.tow.study import TOW_STUDY
from tjscan.study.report import RowGroup, keys_to_show
from tjscan.study.run import read_study
from tjscan.study.trial import ReportedQuantity, StudyRow, Value

PAPER_TABLES: Final = "paper.md"

SUZUKI: Final = {
    "objective f, mean of 100": "3.5 (V-C), 4.2 (V-D)",
    "plans a second": "22",
    "estimate, mean a joint / °": "< 6",
    "touches": "0, by eye",
}
"""What Suzuki et al. (2022) print of quantities that a study of tows measures."""


SCAN_QUANTITIES: Final[dict[str, tuple[Callable[[ScanOutcome], float | None], str]]] = {
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
    for name, (value, form) in SCAN_QUANTITIES.items():
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


def towing_table(rows: Sequence[StudyRow[TowOutcome]]) -> Iterator[str]:
    """Yield one table of all tows, what the paper prints of the same quantities first."""
    usual = {
        key: Counter(row.inputs.get(key) for row in rows).most_common(1)[0][0]
        for key in keys_to_show(rows, TOW_STUDY.seed)
    }
    quantities = [measure.name for measure in TOW_STUDY.measures]
    yield f"| run | ended | {' | '.join(quantities)} |"
    yield f"| --- | --- |{' ---: |' * len(quantities)}"
    printed = [SUZUKI.get(name, "–") for name in quantities]
    yield f"| Suzuki et al. (2022) | | {' | '.join(printed)} |"
    for row in rows:
        name = ", ".join(
            f"{key} {row.inputs.get(key)}"
            for key, value in usual.items()
            if row.inputs.get(key) != value
        )
        cells = [_tow_cell(measure, row.outcome) for measure in TOW_STUDY.measures]
        yield f"| {name or 'as the job is'} | {row.outcome.reason} | {' | '.join(cells)} |"
    yield ""


def _tow_cell(measure: ReportedQuantity[TowOutcome], outcome: TowOutcome) -> str:
    value = measure.value(outcome)
    return "–" if value is None else f"{value:{measure.form}}"


def paper_lines(folder: Path) -> list[str]:
    """Lines of a study's tables beside the papers'; for scans, write the pictures too.

    Raises
    ------
    ConfigurationError
        If the folder holds no study that the papers print figures of.
    """
    plan, done = read_study(folder, study_backend_of_task)
    rows: list[StudyRow[Any]] = list(done)
    if rows and plan.file.task == "tow":
        return list(towing_table(rows))
    as_paper = all(CASE_KEY in row.inputs and STEP_KEY in row.inputs for row in rows)
    if as_paper and any(row.outcome.complete for row in rows) and plan.file.task == "scan":
        return list(write_paper_comparison(folder, rows))
    raise ConfigurationError(
        f"the papers print tows, and scans over {CASE_KEY} and {STEP_KEY}", file=folder
    )


if __name__ == "__main__":
    study = Path(sys.argv[1])
    (study / PAPER_TABLES).write_text("\n".join(paper_lines(study)) + "\n", encoding="utf-8")
    print(f"written to {study / PAPER_TABLES}")
