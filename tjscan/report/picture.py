"""Parts of a report's pages: pictures inlined as data, and the templates."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any, Final

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from matplotlib import rc_context
from matplotlib.figure import Figure

SCREEN_DPI: Final = 110
PANEL_SIZE: Final = (4.6, 2.8)
"""Inches of a chart that stands beside others where there is room, and below them on a phone."""
SMALL_PANEL_SIZE: Final = (3.4, 3.0)
"""Inches of a chart of which three stand beside each other."""
OUTLIER_PERCENT: Final = 2.0
"""Percent of a chart's values, at either end, that do not decide what it shows."""
OUTLIER_RATIO: Final = 4.0
"""A chart is flattened by outliers if they span so many times what the others do."""

LINE_WITH_DOTS_STYLE: Final[dict[str, Any]] = {"marker": "o", "markersize": 3}
"""How a quantity is drawn along the groove: a line, with a dot at each section."""


@dataclass(frozen=True, slots=True)
class ReportPicture:
    """A picture of the report: its data, title and caption.

    Parameters
    ----------
    title, caption : str
        What it shows, and in one sentence what to see in it.
    panels : tuple of str
        ``data:`` URIs that hold all of it: of several, as many as there is room for are beside
        each other.
    alt : str
        The same in words with its main numbers, for who can't see it; the title if left out.
    """

    title: str
    caption: str
    panels: tuple[str, ...]
    alt: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "alt", self.alt or f"{self.title}.")


def draw_line_with_dots(axes: Any, x: Any, y: Any, colour: str, label: str, **style: Any) -> None:
    """Draw a quantity along the groove: a line, with a dot at each section."""
    axes.plot(x, y, color=colour, label=label, **style, **LINE_WITH_DOTS_STYLE)


def picture_from_png(content: bytes, title: str, caption: str) -> ReportPicture:
    """Make a picture of the content of a PNG file."""
    return ReportPicture(title, caption, (_inline_data(content, "png"),))


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure.

    Parameters
    ----------
    width, height : float
        Inches.
    """
    return Figure(figsize=(width, height), dpi=SCREEN_DPI, layout="constrained")


def new_panels(
    count: int, size: tuple[float, float] = PANEL_SIZE
) -> tuple[list[Figure], list[Any]]:
    """Make figures that stand beside each other where there is room, and the axes in each."""
    figures = [new_figure(*size) for _ in range(count)]
    return figures, [figure.add_subplot() for figure in figures]


LEGEND_ROW_HEIGHT: Final = 0.16
"""Inches."""


def add_legend_below(axes: Any) -> None:
    """Name the lines of a panel below it, where they hide nothing; within it, if it has others."""
    alone = len(axes.figure.axes) == 1
    place = {"loc": "outside lower center", "ncols": 3} if alone else {}
    legend = axes.figure.legend if alone else axes.legend
    handles, labels = axes.get_legend_handles_labels()
    if alone:  # it takes no room from the lines
        more = LEGEND_ROW_HEIGHT * max(-(-len(labels) // 3) - 1, 0)
        axes.figure.set_figheight(axes.figure.get_figheight() + more)
    for text in legend(handles, labels, fontsize=7, **place).get_texts():
        text.set_parse_math(False)


def keep_outliers_off(axes: Any, *values: Any) -> None:
    """Let a chart show what most values of its lines do, if a few would flatten it.

    What is beyond is counted in the chart, with the farthest of it.
    """
    known = np.concatenate([np.zeros(0), *(one[np.isfinite(one)] for one in values)])
    if not len(known):
        return
    low, high = np.percentile(known, (OUTLIER_PERCENT, 100 - OUTLIER_PERCENT))
    if np.ptp(known) <= OUTLIER_RATIO * (high - low) or high == low:
        return
    low, high = low - (high - low), high + (high - low)
    beyond = known[(known < low) | (known > high)]
    farthest = beyond[np.abs(beyond - 0.5 * (low + high)).argmax()]
    axes.set_ylim(max(low, known.min()), min(high, known.max()))
    text = f"{len(beyond)} values beyond, to {farthest:.3g}"
    axes.text(0.98, 0.97, text, transform=axes.transAxes, ha="right", va="top", fontsize=7)


def inline_figure(
    figure: Figure | Sequence[Figure],
    title: str,
    caption: str,
    alt: str = "",
    *,
    vector: bool = False,
) -> ReportPicture:
    """Turn a figure into a picture inside the HTML page.

    Parameters
    ----------
    figure : Figure or sequence of Figure
        Any of matplotlib's; several are its panels.
    title, caption, alt : str
        As of `ReportPicture`.
    vector : bool
        Whether its lines stay lines, as sharp as a printer draws them. What holds thousands of
        points is lighter as pixels.
    """
    panels = []
    for one in [figure] if isinstance(figure, Figure) else figure:
        stream = BytesIO()
        if vector:
            with rc_context({"svg.hashsalt": title}):  # the same names in every run
                one.savefig(stream, format="svg", metadata={"Date": None})
        else:
            one.savefig(stream, format="png", dpi=SCREEN_DPI, metadata={"Software": None})
        panels.append(_inline_data(stream.getvalue(), "svg+xml" if vector else "png"))
    return ReportPicture(title, caption, tuple(panels), alt)


def _inline_data(content: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{b64encode(content).decode('ascii')}"


def load_template(name: str) -> Template:
    """Load a template of this package.

    Escaping is on for all of it: names of jobs and joints are text, whatever they hold.

    Parameters
    ----------
    name : str
        Of its file.
    """
    environment = Environment(
        loader=PackageLoader("tjscan.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    return environment.get_template(name)
