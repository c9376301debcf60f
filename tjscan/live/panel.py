"""The page's panel beside the picture: state, plots and events of one run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import viser
from jinja2 import Environment, PackageLoader, StrictUndefined

from tjscan.core.frames import Array
from tjscan.live.colours import ColourScale, scale_ticks
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
CHART_SIZE: Final = (340, 150)
"""Of a chart's plane, without its axes, in units of its own."""
VALUE_COLOUR: Final = "#2a6fbb"
FIT_COLOUR: Final = "#d0452f"
LETTER_WIDTH: Final = 7.0
LINE_HEIGHT: Final = 14.0
"""Of a chart's numbers, in its units."""
CLOCK_HOURS: Final = 12.0

HTML_MACROS: Final = (
    Environment(
        loader=PackageLoader("tjscan.live", "."),
        autoescape=True,
        trim_blocks=True,
        undefined=StrictUndefined,
    )
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
        self._plot = gui.add_html("", visible=False)
        self._profile = gui.add_html("", visible=False)
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
            self._profile.visible = True
            self._profile.content = _fill_macro("chart", profile_chart(step.profile))
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
        self._plot.visible = bool(self.samples)
        self._plot.content = _fill_macro(
            "chart", measure_chart(self.samples, measure, self._setting)
        )
        self._legend.visible = scale is not None
        self._legend.content = "" if scale is None else _fill_macro("legend", measure.title, scale)


def _fill_macro(macro: str, *values: object) -> str:
    return str(getattr(HTML_MACROS, macro)(*values))


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


@dataclass(frozen=True, slots=True)
class DrawnChart:
    """A chart as SVG has it: its plane is `CHART_SIZE` large, x to the right and y down.

    Parameters
    ----------
    x_label, y_label : str
        Of the axes, with units.
    x_ticks, y_ticks : sequence of (float, str)
        Where their numbers are, and these.
    paths : sequence of (str, str, float)
        What is drawn, its colour, and its width: a path of points that are nowhere is dots.
    """

    x_label: str
    y_label: str
    x_ticks: Sequence[tuple[float, str]]
    y_ticks: Sequence[tuple[float, str]]
    paths: Sequence[tuple[str, str, float]]


def measure_chart(samples: Sequence[Sample], measure: Measure, setting: SceneSetup) -> DrawnChart:
    """Draw a measure over the plot's axis: values, and below and above them one sigma."""
    x, y, above, below = plot_columns(samples, measure.name)
    by_clock = setting.plot_by_clock
    x = hours_in_one_piece(x) if by_clock else x
    x_ticks = scale_ticks(x)
    if by_clock:
        x_ticks = np.arange(np.floor(min(x, default=0.0)), np.ceil(max(x, default=12.0)) + 1)
    x_names = [f"{(tick - 1) % CLOCK_HOURS + 1:g}" if by_clock else f"{tick:g}" for tick in x_ticks]
    if measure.logarithmic:
        y, above, below = (np.log10(np.maximum(one, 1e-12)) for one in (y, above, below))
        known = y[np.isfinite(y)]
        y_ticks = np.arange(np.floor(min(known, default=0.0)), np.ceil(max(known, default=0.0)) + 1)
        y_ticks = y_ticks if len(y_ticks) > 1 else np.array((y_ticks[0], y_ticks[0] + 1))
        y_names = [f"{10.0**tick:g}" for tick in y_ticks]
    else:
        y_ticks = scale_ticks(plot_range(y, above))
        y_names = [f"{tick:g}" for tick in y_ticks]
    to_plane = _PlaneScale(x_ticks, y_ticks)
    paths = [
        (to_plane.path(x, values, dots=True), VALUE_COLOUR, width)
        for values, width in ((above, 2.5), (below, 2.5), (y, 5.0))
    ]
    return to_plane.chart(setting.plot_axis, measure.title, x_names, y_names, paths)


def hours_in_one_piece(hours: Array) -> Array:
    """Hours of a clock, shape (n,), on either side of 12 where they go over it."""
    if not len(hours):
        return hours
    known = np.sort(hours % CLOCK_HOURS)
    gaps = np.diff(known, append=known[0] + CLOCK_HOURS)
    start = known[(int(gaps.argmax()) + 1) % len(known)]
    start -= CLOCK_HOURS * (start > CLOCK_HOURS / 2)
    return np.asarray((hours - start + 1e-9) % CLOCK_HOURS + start)


def profile_chart(curve: PlaneCurve) -> DrawnChart:
    """Draw the newest profile, both axes to the same scale, and what was fitted to it."""
    known = np.flatnonzero(np.isfinite(curve.across) & np.isfinite(curve.up))
    thin = known[:: max(1, len(known) // MOST_PROFILE_POINTS)]
    x, y = curve.across[thin], curve.up[thin]
    x_ticks, y_ticks = (
        scale_ticks((*x, *curve.fitted[:, 0])),
        scale_ticks((*y, *curve.fitted[:, 1])),
    )
    to_plane = _PlaneScale(x_ticks, y_ticks, equal=True)
    paths = [
        (to_plane.path(x, y, dots=True), VALUE_COLOUR, 3.0),
        (to_plane.path(*curve.fitted.T), FIT_COLOUR, 2.0),
    ]
    x_names, y_names = ([f"{tick:g}" for tick in ticks] for ticks in (x_ticks, y_ticks))
    return to_plane.chart(*curve.axes, x_names, y_names, paths)


class _PlaneScale:
    """From values to a chart's plane, whose ends are the first and the last ticks.

    Parameters
    ----------
    x_ticks, y_ticks : ndarray
        Of both axes, from the smallest.
    equal : bool
        Whether both axes have one scale: the other is in the middle then.
    """

    def __init__(self, x_ticks: Array, y_ticks: Array, *, equal: bool = False) -> None:
        self._ticks = x_ticks, y_ticks
        self._first = np.array((x_ticks[0], y_ticks[0]))
        span = np.array((x_ticks[-1], y_ticks[-1])) - self._first
        scale = np.array(CHART_SIZE) / span
        self._scale = np.full(2, scale.min()) if equal else scale
        self._shift = 0.5 * (np.array(CHART_SIZE) - self._scale * span)

    def _in_plane(self, x: Array, y: Array) -> Array:
        right = self._shift + self._scale * (np.column_stack((x, y)) - self._first)
        return np.asarray(right * (1, -1) + (0, CHART_SIZE[1]))

    def path(self, x: Array, y: Array, *, dots: bool = False) -> str:
        """Path through points, or dots at them; what is not known, or beyond the plane, is left."""
        points = self._in_plane(x, y)
        inside = ((points >= -1) & (points <= np.array(CHART_SIZE) + 1)).all(axis=1)
        texts = [f"{x:.1f} {y:.1f}" for x, y in points[inside]]
        return (
            "".join(f"M{text}h0" for text in texts) if dots else "M" * bool(texts) + "L".join(texts)
        )

    def chart(
        self,
        x_label: str,
        y_label: str,
        x_names: list[str],
        y_names: list[str],
        paths: Sequence[tuple[str, str, float]],
    ) -> DrawnChart:
        """Make the chart of paths, with the names of the ticks."""
        x_ticks, y_ticks = self._ticks
        across = self._in_plane(x_ticks, np.full(len(x_ticks), y_ticks[0]))[:, 0]
        down = self._in_plane(np.full(len(y_ticks), x_ticks[0]), y_ticks)[:, 1]
        widest = LETTER_WIDTH * (2 + max(map(len, x_names)))
        x_named, y_named = _spaced(across, x_names, widest), _spaced(down, y_names, LINE_HEIGHT)
        return DrawnChart(x_label, y_label, x_named, y_named, paths)


def _spaced(places: Array, names: list[str], least: float) -> list[tuple[float, str]]:
    """Places of ticks with their names; those too near each other to be read go without."""
    apart = float(np.abs(np.diff(places)).min())
    every = max(int(np.ceil(least / max(apart, 1e-9))), 1)
    return [
        (float(at), name if k % every == 0 else "")
        for k, (at, name) in enumerate(zip(places, names, strict=True))
    ]
