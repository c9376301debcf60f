"""Pictures of a study whose scans differ in step length and prediction, as in the paper."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from tjscan.runs.scan.study import ScanOutcome
from tjscan.study.report import RowGroup
from tjscan.study.trial import StudyRow, Value

CASE_KEY: Final = "scan.prediction_case"
STEP_KEY: Final = "scan.step_mm"

LARGEST_STEP_ERROR_PERCENT: Final = {1: 2.9, 2: 0.6, 3: 0.4, 4: 13.5}
"""Largest mean step error of each case over all step lengths (Fig. 14); signs are not given."""


@dataclass(frozen=True, slots=True)
class PaperBarValue:
    """Number that the paper's text gives for one bar of its Fig. 15 or 16.

    Parameters
    ----------
    case : int
        Of the prediction.
    step_mm : float
        Step length.
    value : float
        Millimetres or degrees.
    """

    case: int
    step_mm: float
    value: float


TRAVEL_MM: Final = (
    PaperBarValue(3, 10, 1945),
    PaperBarValue(4, 10, 3344),
    PaperBarValue(2, 100, 1718),
    PaperBarValue(3, 100, 1619),
)
"""Travel of the end effector (Fig. 15)."""

ROTATION_DEG: Final = (
    PaperBarValue(3, 10, 182),
    PaperBarValue(4, 10, 402),
    PaperBarValue(1, 100, 133),
    PaperBarValue(2, 100, 195),
)
"""Rotation of the end effector (Fig. 16)."""

CASE_COLOURS: Final[dict[Value | None, str]] = {
    1: "#1f77b4",
    2: "#ff7f0e",
    3: "#2ca02c",
    4: "#9467bd",
    "smooth": "#111111",
}
"""The paper's blue, orange, green and purple, whatever else a study holds; and one more."""

OTHER_COLOUR: Final = "#8c564b"
"""Of what is none of these."""

PATH_STEP_MM: Final = 50.0
"""The step whose paths the paper shows (Fig. 12)."""

BAR_WIDTH: Final = 0.8
"""Of all bars at one step together."""


class PredictionBarChart:
    """Bar chart of a study: a bar for every prediction at every step length.

    Parameters
    ----------
    rows : sequence of StudyRow
        Those to show, of every prediction at every step length.
    """

    def __init__(self, rows: Sequence[StudyRow[ScanOutcome]]) -> None:
        members: dict[tuple[Value | None, ...], list[StudyRow[ScanOutcome]]] = {}
        for row in rows:
            key = row.inputs.get(CASE_KEY), row.inputs.get(STEP_KEY)
            members.setdefault(key, []).append(row)
        self.groups = {key: RowGroup(tuple(some)) for key, some in members.items()}
        self.cases = list(dict.fromkeys(case for case, _ in self.groups))
        self.steps = sorted({float(step) for _, step in self.groups if step is not None})

    def rows_of_bar(self, case: Value | None, step_mm: float) -> RowGroup[ScanOutcome] | None:
        """Rows of the study that one bar stands for.

        Parameters
        ----------
        case : int or str
            Of the prediction.
        step_mm : float
            Length of the step.
        """
        return self.groups.get((case, step_mm))

    def bar_position(self, case: Value | None, step_mm: float) -> float:
        """Position of a bar on the axis; for the parameters see `rows_of_bar`."""
        width = BAR_WIDTH / len(self.cases)
        return self.steps.index(step_mm) + (self.cases.index(case) + 0.5) * width - BAR_WIDTH / 2

    def draw_bars(
        self,
        axes: Any,
        value: Callable[[ScanOutcome], float | None],
        *,
        below: Callable[[ScanOutcome], float | None] | None = None,
        spread: Callable[[ScanOutcome], float | None] | None = None,
    ) -> None:
        """Draw a bar for each prediction and step; a cross where no scan is complete.

        Parameters
        ----------
        axes
            Where.
        value : callable
            The bar's height, of an outcome.
        below : callable, optional
            The bar is light up to here.
        spread : callable, optional
            Half the length of a line at its top.
        """
        for case in self.cases:
            for step in self.steps:
                found = self.rows_of_bar(case, step)
                if found is None:
                    continue
                x, colour = self.bar_position(case, step), CASE_COLOURS.get(case, OTHER_COLOUR)
                if not found.complete_rows:
                    axes.plot(x, 0.0, "x", color=colour, markersize=6, clip_on=False, zorder=3)
                    continue
                top = found.mean_of_complete(value)
                foot = 0.0 if below is None else found.mean_of_complete(below)
                common: dict[str, Any] = {"width": 0.95 * BAR_WIDTH / len(self.cases)}
                if below is not None:
                    axes.bar(x, foot, color=_light(colour), **common)
                axes.bar(x, top - foot, bottom=foot, color=colour, **common)
                if spread is not None:
                    axes.errorbar(
                        x, top, found.mean_of_complete(spread), color="black", linewidth=0.8
                    )
        axes.set_xticks(range(len(self.steps)), [f"{step:g}" for step in self.steps])
        axes.set_xlabel("step length / mm")

    def legend(self, axes: Any, *more: Any) -> None:
        """Add a legend that names the prediction of each colour.

        Parameters
        ----------
        axes
            Where.
        *more
            Other entries.
        """
        from matplotlib.lines import Line2D
        from matplotlib.patches import Patch

        known = [
            Patch(
                color=CASE_COLOURS.get(case, OTHER_COLOUR),
                label=f"case {case}" if isinstance(case, int) else str(case),
            )
            for case in self.cases
        ]
        if not all(members.complete_rows for members in self.groups.values()):
            style: dict[str, Any] = {"color": "grey", "marker": "x", "linestyle": ""}
            more = (*more, Line2D([], [], label="no complete scan", **style))
        axes.legend(handles=[*known, *more], fontsize="small")

    def draw_paper_bars(self, axes: Any, bars: Sequence[PaperBarValue]) -> None:
        """Mark the bars that the paper gives a number for.

        Parameters
        ----------
        axes
            Where.
        bars : sequence of PaperBarValue
            Of the paper.
        """
        shown = [bar for bar in bars if bar.case in self.cases and bar.step_mm in self.steps]
        for bar in shown:
            x = self.bar_position(bar.case, bar.step_mm)
            axes.plot(x, bar.value, "D", color="#d62728", markersize=5, zorder=3)


def draw_step_lengths(rows: Sequence[StudyRow[ScanOutcome]]) -> Figure:
    """Mean step with its standard deviation, and its error (the paper's Fig. 13 and 14)."""
    chart, figure = PredictionBarChart(rows), _figure(12, 4.5)
    length, error = figure.subplots(1, 2)
    chart.draw_bars(length, lambda m: m.step_mean_mm, spread=lambda m: m.step_std_mm)
    length.set_ylabel("mean step / mm (line: standard deviation)")
    chart.draw_bars(error, lambda m: m.step_error_percent)
    for case in chart.cases:
        if isinstance(case, int) and (largest := LARGEST_STEP_ERROR_PERCENT.get(case)):
            for sign in (-1, 1):
                line = {"color": CASE_COLOURS[case], "linestyle": ":", "linewidth": 1}
                error.axhline(sign * largest, **line)
    error.set_ylabel("mean step error / % (dotted: the paper's largest)")
    error.set_yscale("symlog", linthresh=1.0)
    ticks = (-20, -10, -5, -2, -1, -0.5, 0, 0.5, 1, 2, 5, 10, 20)
    error.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    error.set_ylim(min(-30.0, error.get_ylim()[0]), max(30.0, error.get_ylim()[1]))
    chart.legend(length)
    return figure


def draw_travel_and_rotation(rows: Sequence[StudyRow[ScanOutcome]]) -> Figure:
    """Travel and rotation of the flange, prediction light and correction dark (Fig. 15, 16)."""
    from matplotlib.lines import Line2D

    chart, figure = PredictionBarChart(rows), _figure(12, 4.5)
    travel, rotation = figure.subplots(1, 2)
    chart.draw_bars(travel, lambda m: m.travel_mm, below=lambda m: m.travel_prediction_mm)
    chart.draw_paper_bars(travel, TRAVEL_MM)
    travel.set_ylabel("flange travel / mm (light: prediction, dark: correction)")
    chart.draw_bars(rotation, lambda m: m.rotation_deg, below=lambda m: m.rotation_prediction_deg)
    chart.draw_paper_bars(rotation, ROTATION_DEG)
    rotation.set_ylabel("flange rotation / °")
    mark = Line2D([], [], color="#d62728", marker="D", linestyle="", label="the paper, on steel")
    chart.legend(travel, mark)
    return figure


def draw_flange_paths(rows: Sequence[StudyRow[ScanOutcome]]) -> Figure:
    """The flange's paths in cylinder coordinates of frame j (Fig. 12), the first of each case."""
    chart, figure = PredictionBarChart(rows), _figure(12, 4.5)
    step = min(chart.steps, key=lambda s: abs(s - PATH_STEP_MM))
    distance, height = figure.subplots(1, 2)
    for case in chart.cases:
        found = chart.rows_of_bar(case, step)
        if found is None or not found.complete_rows:
            continue
        azimuth, rho, z = np.array(found.complete_rows[0].outcome.path).T
        style: dict[str, Any] = {"color": CASE_COLOURS.get(case, OTHER_COLOUR), "linewidth": 1}
        style |= {"marker": ".", "markersize": 4}
        distance.plot(azimuth, rho, **style)
        height.plot(azimuth, z, **style)
    for axes, name in ((distance, "distance from the brace's axis"), (height, "height")):
        axes.set_xlabel("azimuth in frame j / °")
        axes.set_ylabel(f"{name} / mm")
        axes.set_title(f"flange path, {step:g} mm steps", fontsize="medium")
        axes.grid(linewidth=0.3)
    chart.legend(distance)
    return figure


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _light(colour: str) -> tuple[float, float, float]:
    red, green, blue = (0.5 + 0.5 * part for part in to_rgb(colour))
    return red, green, blue
