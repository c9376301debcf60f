"""The page's panel beside the picture: state, plots and events of one run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import viser
from jinja2 import Environment, PackageLoader
from viser import uplot

from tjscan.core.frames import Array
from tjscan.live.colours import ColourScale, round_scale_ends
from tjscan.live.step import (
    BUTTONS_FACT_NAME,
    STATE_FACT,
    Measure,
    PlaneCurve,
    Sample,
    SceneSetup,
    StateDiagram,
    Step,
)

STATE_PANEL_ORDER: Final = -200.0
"""Of the state: below the buttons, above all else."""
MOST_SHOWN_EVENTS: Final = 200
MOST_PLOTTED_SAMPLES: Final = 600
"""Samples in the plot: of more, as many evenly chosen ones."""
MOST_PROFILE_POINTS: Final = 64
"""Of the newest profile in its plot."""
INITIAL_FACTS: Final = {STATE_FACT: "", BUTTONS_FACT_NAME: ""}
"""Before any is known; these two come first."""
CHART_HEIGHT: Final = 200
CHART_PADDING: Final = (8, 24, 0, 0)
"""Pixels above, to the right, below and to the left: half a number is above the axis."""
PROFILE_AXES: Final = ("x / mm", "z / mm")
LABEL_FONT: Final = "11px system-ui, sans-serif"
VALUE_COLOUR: Final = "#2a6fbb"
SIGMA_COLOUR: Final = "rgba(42,111,187,0.35)"
FIT_COLOUR: Final = "#d0452f"
LARGE_POINT_STYLE: Final[uplot.Series_Points] = {"show": True, "size": 6, "fill": VALUE_COLOUR}
SMALL_POINT_STYLE: Final[uplot.Series_Points] = {"show": True, "size": 3}

HTML_MACROS: Final = (
    Environment(loader=PackageLoader("tjscan.live", "."), autoescape=True, trim_blocks=True)
    .get_template("panel.html.jinja")
    .module
)
"""Names of joints and devices are text, whatever they hold: escaping is on for all of it."""


class Panel:
    """State, progress, plots and events of one run.

    Parameters
    ----------
    server : viser.ViserServer
        Inside whose present container everything is made.
    setting : Setting
        Of the run.
    """

    def __init__(self, server: viser.ViserServer, setting: SceneSetup) -> None:
        gui, self._setting = server.gui, setting
        self._facts = dict(INITIAL_FACTS)
        self.samples: list[Sample] = []
        self.events: list[tuple[str, str]] = []
        self.state = gui.add_html(_fill_macro("facts", {}), order=STATE_PANEL_ORDER)
        self._progress: Any = gui.add_progress_bar(0.0, visible=False)
        self._legend = gui.add_html("", visible=False)
        self._plot = _add_chart(
            gui,
            setting.plot_axis,
            "",
            uplot.Series(label="value", stroke=VALUE_COLOUR, width=0, points=LARGE_POINT_STYLE),
            uplot.Series(label="+ sigma", stroke=SIGMA_COLOUR, width=0, points=SMALL_POINT_STYLE),
            uplot.Series(label="- sigma", stroke=SIGMA_COLOUR, width=0, points=SMALL_POINT_STYLE),
        )
        self._profile = _add_chart(
            gui,
            *PROFILE_AXES,
            uplot.Series(label="profile", stroke=VALUE_COLOUR, width=0, points=SMALL_POINT_STYLE),
            uplot.Series(label="fitted", stroke=FIT_COLOUR, width=2, points={"show": False}),
        )
        self._table = gui.add_html("", visible=False)
        self.diagram = gui.add_html("", visible=False)
        self._drawn_diagram: StateDiagram | None = None
        with gui.add_folder("Events", expand_by_default=True):
            self._log = gui.add_html(_fill_macro("events", ()))

    def show_step(self, step: Step, measure: Measure | None, scale: ColourScale | None) -> None:
        """Show what a step changes.

        Parameters
        ----------
        step : Step
        measure : Measure or None
            Which one is plotted.
        scale : ColourScale or None
            Of that measure; None if nothing in the picture is coloured by it.
        """
        if step.facts:
            self._facts.update(step.facts)
            self.state.content = _fill_macro("facts", self._facts)
        if step.progress is not None:
            self._progress.visible, self._progress.value = True, 100 * step.progress
        if step.events:
            self.events.extend(step.events)
            self._log.content = _fill_macro("events", self.events[-MOST_SHOWN_EVENTS:])
        if step.table is not None:
            self._table.visible, self._table.content = True, _fill_macro("table", step.table)
        if step.diagram is not None and step.diagram != self._drawn_diagram:
            self._drawn_diagram, self.diagram.visible = step.diagram, True
            self.diagram.content = _fill_macro("diagram", step.diagram)
        if step.profile is not None:
            x, *others = columns = profile_columns(step.profile)
            ends = round_scale_ends(np.concatenate(others))
            _redraw_chart(self._profile, columns, x_ends=round_scale_ends(x), y={"range": ends})
        if step.samples and measure is not None:
            self.samples.extend(step.samples)
            self.plot_measure(measure, scale)

    def forget_steps(self) -> None:
        """Forget all that was shown: other steps come next."""
        self.samples, self.events = [], []
        self._facts = dict(INITIAL_FACTS)
        self._progress.value = 0.0
        self._table.visible = self.diagram.visible = False
        self._drawn_diagram = None
        self._log.content = _fill_macro("events", ())

    def plot_measure(self, measure: Measure, scale: ColourScale | None) -> None:
        """Plot a measure of all samples, and show its colours."""
        columns = plot_columns(self.samples, measure.name)
        x_ends = self._setting.plot_range or round_scale_ends(columns[0])
        ends = plot_range(*columns[1:3])
        scale_of_y: uplot.Scale = {"distr": 3} if measure.logarithmic else {"range": ends}
        _redraw_chart(self._plot, columns, x_ends=x_ends, y=scale_of_y)
        self._plot.visible = bool(self.samples)
        axes = _plot_axes(self._setting.plot_axis, measure.title)
        if self._plot.axes != axes:
            self._plot.axes = axes
        self._legend.visible = scale is not None
        self._legend.content = "" if scale is None else _fill_macro("legend", measure.title, scale)


def _fill_macro(macro: str, *values: object) -> str:
    return str(getattr(HTML_MACROS, macro)(*values))


def _add_chart(gui: viser.GuiApi, x: str, y: str, *series: uplot.Series) -> Any:
    return gui.add_uplot(
        data=(np.zeros(0),) * (1 + len(series)),
        series=(uplot.Series(label=x), *series),
        scales={"x": {"time": False}},
        axes=_plot_axes(x, y),
        legend={"show": False},
        height=CHART_HEIGHT,
        padding=CHART_PADDING,
        visible=False,
    )


def _redraw_chart(
    chart: Any, columns: Sequence[Array], *, x_ends: tuple[float, float], y: uplot.Scale
) -> None:
    """Show other data in a chart; a scale that changes makes the browser build it again.

    The ends of x are stated: otherwise the browser takes the ends of the data that it had
    as it built the chart, which at first were none.
    """
    chart.visible, chart.data = True, columns
    scales = {"x": {"time": False, "auto": False, "range": x_ends}, "y": y}
    if chart.scales != scales:
        chart.scales = scales


def _plot_axes(x: str, y: str) -> tuple[uplot.Axis, uplot.Axis]:
    return (
        uplot.Axis(label=x, labelFont=LABEL_FONT, labelSize=20, size=34),
        uplot.Axis(label=y, labelFont=LABEL_FONT, labelSize=20, size=56),
    )


def plot_columns(samples: Sequence[Sample], name: str) -> tuple[Array, Array, Array, Array]:
    """Columns of the plot of a measure: x, value, and one sigma above and below, in order of x.

    Parameters
    ----------
    samples : sequence of Sample
    name : str
        Of the measure.
    """
    known = sorted((one for one in samples if name in one.values), key=lambda one: one.x)
    chosen = known[:: -(-len(known) // MOST_PLOTTED_SAMPLES) or 1]
    rows = np.array([(one.x, one.values[name], one.sigma(name)) for one in chosen]).reshape(-1, 3)
    x, y, sigma = rows.T
    return x, y, y + sigma, y - sigma


def plot_range(y: Array, above: Array | None = None) -> tuple[float, float]:
    """Ends of the plot's value axis: all values, and sigmas unless they are far out of line."""
    known = y[np.isfinite(y)]
    if not len(known):
        return 0.0, 1.0
    sigmas = np.zeros(1) if above is None else (above - y)[np.isfinite(above - y)]
    margin = max(2 * float(np.median(sigmas)) if len(sigmas) else 0.0, 0.08 * float(np.ptp(known)))
    margin = margin or 0.05 * abs(float(known[0])) or 1.0
    return float(known.min()) - margin, float(known.max()) + margin


def profile_columns(curve: PlaneCurve) -> tuple[Array, ...]:
    """Columns of the newest profile's plot: x, its points, and the corners fitted to them."""
    known = np.flatnonzero(np.isfinite(curve.x) & np.isfinite(curve.z))
    thin = known[:: max(1, len(known) // MOST_PROFILE_POINTS)]
    corners = curve.fitted
    xs = np.concatenate((curve.x[thin], corners[:, 0]))
    points = np.concatenate((curve.z[thin], np.full(len(corners), np.nan)))
    fitted = np.concatenate((np.full(len(thin), np.nan), corners[:, 1]))
    order = np.argsort(xs, kind="stable")
    return xs[order], points[order], fitted[order]
