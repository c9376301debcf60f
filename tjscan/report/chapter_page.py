"""A page that shows the chapter of one task: for runs that are no scan."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from tjscan.core.provenance import Provenance
from tjscan.report import picture
from tjscan.report.clock import EventClock
from tjscan.result.chapter import ReportChapter, ReportChart
from tjscan.result.directory import job_label_of_run

MOST_COLOURS: Final = 10
"""Lines of one chart that have colours of their own; of more, the colours follow their order."""


def render_chapter_page(chapter: ReportChapter, title: str, directory: Path) -> str:
    """Render a page with all that a chapter holds, its charts inlined as pictures.

    Parameters
    ----------
    chapter : ReportChapter
    title : str
        What kind of run it was; a sheet states it itself.
    directory : Path
        The run directory.
    """
    frame = "w" if chapter.sheet is None else chapter.sheet.frame
    name = directory.resolve().name
    said = name.lower().startswith(title.lower())  # a run is mostly called by what it is
    head = Provenance.for_file_written_now(job_label_of_run(directory), frame)
    return picture.load_template("chapter.html.jinja").render(
        title=chapter.sheet.title if chapter.sheet else "Run" if said else title,
        sheet=chapter.sheet is not None,
        headline=chapter.headline,
        name=name,
        findings=chapter.findings,
        facts=[(key, value) for key, value in chapter.facts if value.strip(" ,")],
        moving=chapter.animation,
        animation=None if chapter.animation is None else chapter.animation.as_json(),
        pictures=list(draw_chapter_charts(chapter.charts)),
        clock=EventClock.of_run(directory, chapter.events),
        provenance=head.header_entries,
    )


def draw_chapter_charts(charts: tuple[ReportChart, ...]) -> Iterator[picture.ReportPicture]:
    """Draw charts, the lines of one title together."""
    for title, lines in _charts_by_title(charts).items():
        (figure,), (axes,) = picture.new_panels(1)
        _draw_charts_of_one_title(axes, lines)
        yield picture.inline_figure(figure, title[:1].upper() + title[1:], lines[0].caption)


def draw_sheet_picture(chapter: ReportChapter) -> Figure:
    """Draw all charts of a chapter beside each other, under its headline.

    Parameters
    ----------
    chapter : ReportChapter
        With a sheet.
    """
    charts = _charts_by_title(chapter.charts)
    wide = max(len(charts), 1)
    figure = picture.new_figure(picture.PANEL_SIZE[0] * wide, 1.3 * picture.PANEL_SIZE[1])
    if chapter.sheet is not None:
        texts = [f"{one.meaning}: {one.value}" for one in chapter.headline]
        rows = [", ".join(texts[k : k + wide]) for k in range(0, len(texts), wide)]
        figure.suptitle("\n".join((chapter.sheet.title, *rows)), fontsize=10, parse_math=False)
    panels = figure.subplots(1, wide, squeeze=False)[0]
    for axes, (title, lines) in zip(panels, charts.items(), strict=False):
        _draw_charts_of_one_title(axes, lines)
        axes.set_title(title, fontsize=10)
    return figure


def _charts_by_title(charts: tuple[ReportChart, ...]) -> dict[str, list[ReportChart]]:
    titles = dict.fromkeys(chart.title for chart in charts)
    return {title: [chart for chart in charts if chart.title == title] for title in titles}


def _draw_charts_of_one_title(axes: Any, lines: list[ReportChart]) -> None:
    """Draw the charts of one title, what was asked for as a dashed line."""
    if len(lines) > MOST_COLOURS:
        shades = matplotlib.colormaps["turbo"](np.linspace(0.05, 0.95, len(lines)))
        axes.set_prop_cycle(color=shades)
    for chart in lines:
        label = chart.line or None
        match chart.mark:
            case "bar":
                colour = axes.bar(chart.x, chart.y, label=label).patches[0].get_facecolor()
                axes.xaxis.set_major_locator(MaxNLocator(integer=True))
            case "dot":
                colour = axes.scatter(chart.x, chart.y, s=18, label=label).get_facecolor()[0]
            case _:
                (line,) = axes.plot(chart.x, chart.y, linewidth=1, label=label)
                colour = line.get_color()
        if chart.nominal is not None:
            axes.axhline(chart.nominal, color=colour, linestyle="--", linewidth=1)
    if lines[0].plane:
        axes.set_aspect("equal", adjustable="datalim")
    if lines[0].log_y:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set(xlabel=lines[0].x_label, ylabel=lines[0].y_label)
    axes.grid(alpha=0.3)
    picture.keep_outliers_off(axes, *(chart.y for chart in lines if not chart.plane))
    if any(chart.line for chart in lines):
        picture.add_legend_below(axes)
