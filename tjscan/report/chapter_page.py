"""A page that shows the chapter of one task: for runs that are no scan."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from tjscan.core.provenance import Provenance
from tjscan.report.picture import ReportPicture, inline_figure, new_figure
from tjscan.report.tables import MOST_EVENTS
from tjscan.report.template import load_template
from tjscan.result.chapter import ReportChapter, ReportChart
from tjscan.result.directory import job_label_of_run


def render_chapter_page(chapter: ReportChapter, title: str, directory: Path) -> str:
    """Render a page with all that a chapter holds, its charts inlined as pictures.

    Parameters
    ----------
    chapter : ReportChapter
    title : str
        What kind of run it was.
    directory : Path
        The run directory.
    """
    head = Provenance.for_file_written_now(job_label_of_run(directory), "w")
    return load_template("chapter.html.jinja").render(
        title=title,
        name=directory.resolve().name,
        findings=chapter.findings,
        facts=[(key, value) for key, value in chapter.facts if value.strip(" ,")],
        moving=chapter.animation,
        animation=None if chapter.animation is None else chapter.animation.as_json(),
        pictures=list(draw_chapter_charts(chapter.charts)),
        events=[
            (f"{event.time:%H:%M:%S}", event.name, event.detail)
            for event in chapter.events[:MOST_EVENTS]
        ],
        provenance=head.header_entries,
    )


def draw_chapter_charts(charts: tuple[ReportChart, ...]) -> Iterator[ReportPicture]:
    """Draw charts, the lines of one title together."""
    for title in dict.fromkeys(chart.title for chart in charts):
        lines = [chart for chart in charts if chart.title == title]
        figure = new_figure(12, 5.5 if lines[0].plane else 3.6)
        axes = figure.add_subplot()
        for chart in lines:
            (line,) = axes.plot(chart.x, chart.y, linewidth=1, label=chart.line or None)
            if chart.nominal is not None:
                axes.axhline(chart.nominal, color=line.get_color(), linestyle="--", linewidth=1)
        if lines[0].plane:
            axes.set_aspect("equal")
        axes.set_xlabel(lines[0].x_label)
        axes.set_ylabel(lines[0].y_label)
        axes.grid(alpha=0.3)
        if any(chart.line for chart in lines):
            axes.legend(fontsize=8, ncols=4)
        yield inline_figure(figure, title[:1].upper() + title[1:], lines[0].caption)
