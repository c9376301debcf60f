"""Charts over the groove: what was measured, how far off the corners are, how the steps went."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import Any, Final

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.section import TACK_WELD
from tjscan.report import picture
from tjscan.report.data import ReportData
from tjscan.report.dimensions import DEGREES_PER_HOUR, designed_measures, section_dimensions
from tjscan.report.findings import describe_coverage
from tjscan.result import section as result_section
from tjscan.result.directory import STATIONS_PICTURE
from tjscan.result.picture import (
    BAND_SIGMAS,
    CORNER_COLOUR,
    LASER_COLOUR,
    PATH_COLOUR,
    ROOT_COLOUR,
    draw_groove_3d,
)
from tjscan.result.wireframe import joint_wireframe

DESIGN_LINE_STYLE: Final[dict[str, Any]] = {"color": "#d62728", "linestyle": "--", "linewidth": 1}
STATION_COLOURS: Final = tuple(f"C{k}" for k in range(10))
"""Of stations that are drawn together."""

CORNER_COLOURS: Final = (CORNER_COLOUR, ROOT_COLOUR, PATH_COLOUR)
"""Of p2, p3 and p4."""

MOST_PICTURE_BYTES: Final = 1_000_000
"""A larger picture of stations would make the report too large to send."""

ROOT_WIDTH_MEASURE_INDEX: Final = 1
"""Place of the root's width among the measures of a section."""

GROOVE_BOX_MARGIN: Final = 50e-3
"""Metres about the corners that the view in space shows."""


def draw_groove_in_space(data: ReportData) -> picture.ReportPicture:
    """Draw the groove in space, with its points and the joint as designed."""
    figure = picture.new_figure(10, 6.5)
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    low, high = _box_about_groove(data.sections)
    outline = () if data.joint is None else joint_wireframe(data.joint)
    # A ghost far off would make the groove small.
    points = data.cloud[indices_near_groove(data.sections, data.cloud)]
    lines = [_line_with_gaps_outside_box(line, low, high) for line in outline]
    draw_groove_3d(axes, data.sections, points, data.summary.frame, lines, ())
    return picture.inline_figure(
        figure,
        "The scanned groove in space",
        "Lines are the sections, through their corners p1 to p5, and numbers name them; colours "
        "are those of the scale"
        + ("." if data.joint is None else "; grey is the joint as designed."),
        f"The groove in space: {len(data.sections)} sections, {describe_coverage(data)}.",
    )


def indices_near_groove(sections: Sequence[MeasuredSection], points: Array) -> NDArray[np.intp]:
    """Places of the points, shape (n, 3), that lie in a box about the corners of sections."""
    low, high = _box_about_groove(sections)
    return np.flatnonzero(np.all((points > low) & (points < high), axis=1))


def _box_about_groove(sections: Sequence[MeasuredSection]) -> tuple[Array, Array]:
    corners = np.array([section.points for section in sections]).reshape(-1, 3)
    return corners.min(axis=0) - GROOVE_BOX_MARGIN, corners.max(axis=0) + GROOVE_BOX_MARGIN


def _line_with_gaps_outside_box(line: Array, low: Array, high: Array) -> Array:
    """A line with gaps where it leaves a box."""
    if len(line) == 2:
        line = line[0] + np.linspace(0, 1, 80)[:, None] * (line[1] - line[0])
    inside = np.all((line >= low) & (line <= high), axis=1, keepdims=True)
    return np.where(inside, line, np.nan)


def draw_measure_charts(data: ReportData) -> picture.ReportPicture:
    """Draw groove angle, root width, depth and area along the groove, with uncertainty."""
    x, label = places_along_groove(data)
    order = np.argsort(x)
    x, sections = x[order], [data.sections[k] for k in order]
    design = None if data.joint is None else designed_measures(sections, data.joint)
    columns = list(result_section.measure_columns(sections))
    figures, panels = picture.new_panels(len(columns))
    for k, (axes, (field, y, sigma)) in enumerate(zip(panels, columns, strict=True)):
        band = BAND_SIGMAS * sigma
        axes.fill_between(x, y - band, y + band, color=LASER_COLOUR, alpha=0.3, linewidth=0)
        picture.draw_line_with_dots(axes, x, y, LASER_COLOUR, "measured", linewidth=1)
        if design is not None:
            drawn = design[:, k] / field.unit.factor
            axes.plot(x, drawn, **DESIGN_LINE_STYLE, label="as designed")
        axes.set(xlabel=label, ylabel=field.chart_title)
        axes.grid(alpha=0.3)
        picture.keep_outliers_off(axes, y, y - band, y + band)
    picture.add_legend_below(panels[0])
    designed = "" if design is None else " Dashed: the joint as designed, cut by the same planes."
    every = (
        (field, field.values_in_file_units(sections)) for field in result_section.MEASURE_FIELDS
    )
    ranges = (f"{field.chart_title} {y.min():.1f} to {y.max():.1f}" for field, y in every)
    return picture.inline_figure(
        figures,
        "Groove angle, root width, depth and area",
        f"Measured in the laser's plane at each section; bands are ± {BAND_SIGMAS:g} standard "
        f"deviations. If the root is not seen, only the angle is known.{designed}",
        f"Four charts along the groove: {', '.join(ranges)}.",
        vector=True,
    )


def draw_scan_charts(data: ReportData) -> picture.ReportPicture | None:
    """Draw how the scan went: charts of all stations, a line for each; None without any.

    Parameters
    ----------
    data : ReportData
        The run.
    """
    charts = [(place.name, chart) for place in data.places for chart in place.charts]
    titles = list(dict.fromkeys(chart.title for _, chart in charts))
    if not titles:
        return None
    figures, panels = picture.new_panels(len(titles))
    for axes, title in zip(panels, titles, strict=True):
        lines = [(name, chart) for name, chart in charts if chart.title == title]
        for (name, chart), colour in zip(lines, cycle(STATION_COLOURS)):
            picture.draw_line_with_dots(axes, chart.x, chart.y, colour, name)
            if chart.nominal is not None:
                axes.axhline(chart.nominal, **DESIGN_LINE_STYLE)
                axes.set_ylim(0, 1.1 * axes.get_ylim()[1])
            axes.set(xlabel=chart.x_label, ylabel=chart.y_label)
        axes.set_title(title, fontsize=10)
        axes.grid(alpha=0.3)
        picture.keep_outliers_off(axes, *(chart.y for _, chart in lines))
    if len(data.places) > 1:
        picture.add_legend_below(panels[0])
    return picture.inline_figure(
        figures,
        "How the scan went",
        "Dashed: as asked; the first step is the taught one.",
        f"Charts of {', '.join(titles)} over the sections.",
        vector=True,
    )


def draw_corner_errors(data: ReportData) -> picture.ReportPicture | None:
    """Draw distances of the corners from designed edges; None if these are not known."""
    deviations = () if data.comparison is None else data.comparison.deviations
    found = [one.distances for one in deviations if one.kind == "corners to feature edges"]
    if data.comparison is None or not found:
        return None
    x, label = places_along_groove(data)
    order = np.argsort(x)
    distances = 1e3 * found[0].reshape(-1, 3)[order]
    figures, panels = picture.new_panels(3, picture.SMALL_PANEL_SIZE)
    for k, (axes, colour) in enumerate(zip(panels, CORNER_COLOURS, strict=True)):
        name, y = f"p{k + 2}", distances[:, k]
        picture.draw_line_with_dots(axes, x[order], y, colour, name, linewidth=1)
        if (tolerance := data.comparison.tolerance) is not None:
            axes.axhline(1e3 * tolerance, **DESIGN_LINE_STYLE)
        picture.keep_outliers_off(axes, y)
        axes.set_ylim(bottom=0)
        axes.set(xlabel=label, ylabel="distance / mm", title=name)
        axes.grid(alpha=0.3)
    return picture.inline_figure(
        figures,
        "Corners and the designed edges",
        "Distance of the top of the bevel (p2) and the two corners of the root (p3, p4) from where "
        "the design has them; it has no sign. Dashed: the tolerance, if there is one.",
        f"Chart of these distances: {np.nanmean(distances):.2f} mm in the mean, "
        f"{np.nanmax(distances):.2f} mm at most.",
        vector=True,
    )


def places_along_groove(data: ReportData) -> tuple[Array, str]:
    """Where the sections are on a chart, and what that is called."""
    if (azimuths := data.unwrapped_azimuths) is not None:
        return azimuths, "azimuth about the brace / °"
    return 1e3 * result_section.lengths_along_groove(data.sections), "along the groove / mm"


def draw_fit_up(data: ReportData) -> picture.ReportPicture:
    """Tacks, root and high-low over the clock position, or the groove's length without a joint."""
    x, label = places_along_groove(data)
    if data.unwrapped_azimuths is not None:
        x = x / DEGREES_PER_HOUR
        label = "clock position, 12 at the crown"
    order = np.argsort(x)
    x, sections = x[order], [data.sections[k] for k in order]
    tacked = np.array([TACK_WELD in section.conditions for section in sections])
    figures, panels = picture.new_panels(1 if data.joint is None else 2)
    for axes in panels:
        axes.set_xlabel(label)
        if data.unwrapped_azimuths is not None:
            axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=(1, 3, 6, 10)))
            axes.xaxis.set_major_formatter(lambda hour, _: f"{round(hour - 1) % 12 + 1}")
        _shade_tack_welds(axes, x, tacked)
        axes.grid(alpha=0.3)
    opening = 1e3 * np.array([section.root_opening for section in sections])
    rootless = result_section.absent_corners(sections)[:, 1:].any(axis=1)
    width = 1e3 * np.array([section.measures[ROOT_WIDTH_MEASURE_INDEX] for section in sections])
    width[~np.isnan(opening) | rootless] = np.nan
    widths = 1e3 * np.array([section.sigmas[ROOT_WIDTH_MEASURE_INDEX] for section in sections])
    # An opening ends at p3, the edge of the bevel.
    edges = 1e3 * np.array([section.own_corner_sigmas[1] for section in sections])
    for name, y, sigma, colour in (
        ("root opening", opening, edges, ROOT_COLOUR),
        ("width of the root bead", width, widths, LASER_COLOUR),
    ):
        if not np.isnan(y).all():
            bars = BAND_SIGMAS * sigma
            panels[0].errorbar(
                x, y, bars, linewidth=1, color=colour, label=name, **picture.LINE_WITH_DOTS_STYLE
            )
    panels[0].set_ylabel("root / mm")
    high_low = ""
    if data.joint is not None:
        every = section_dimensions(sections, data.joint)
        values = [{one.name: one.value for one in row} for row in every]
        for name, shown, colour in (
            ("high-low, brace", "brace's wall at p2", CORNER_COLOUR),
            ("high-low, leg", "leg at p4", PATH_COLOUR),
        ):
            off = [row[name] for row in values]
            picture.draw_line_with_dots(panels[1], x, off, colour, shown)
        panels[1].axhline(0, color="grey", linewidth=0.8)
        panels[1].set_ylabel("high-low / mm")
        picture.keep_outliers_off(panels[1], *(line.get_ydata() for line in panels[1].lines[:2]))
        high_low = " High-low: how far the tubes are off their drawn places, positive outwards."
    picture.keep_outliers_off(panels[0], opening, width)
    panels[0].set_ylim(bottom=0)
    for axes in panels:
        if axes.get_legend_handles_labels()[0]:
            picture.add_legend_below(axes)
    return picture.inline_figure(
        figures,
        "Fit-up, unrolled",
        f"Shaded: tack welds, {int(tacked.sum())} of {len(sections)} sections are on one. Bars are "
        f"± {BAND_SIGMAS:g} standard deviations.{high_low}",
        f"Charts along the groove of the root{high_low and ' and of high-low'}, "
        f"{int(tacked.sum())} sections on tack welds.",
        vector=True,
    )


def _shade_tack_welds(axes: Any, x: Array, tacked: NDArray[np.bool_]) -> None:
    """Bands about the sections on tacks, half way to their neighbours."""
    bounds = np.concatenate((x[:1], (x[1:] + x[:-1]) / 2, x[-1:]))
    label = "tack weld"
    for k in np.flatnonzero(tacked):
        axes.axvspan(bounds[k], bounds[k + 1], color="#f2c14e", alpha=0.5, linewidth=0, label=label)
        label = ""  # the legend names the first


def draw_deviation_map(data: ReportData) -> picture.ReportPicture | None:
    """Draw deviations unwrapped over the azimuth; None if nothing was compared in frame j."""
    comparison = data.comparison
    if comparison is None or comparison.reference.stated.frame != "j":
        return None
    kind = comparison.deviations[0]
    sign = "red is outside the reference, blue inside" if kind.signed else "it has no sign"
    return picture.inline_figure(
        comparison.plot().figure,
        "Deviation from the reference, unwrapped over the azimuth",
        f"Each column is a section, from the leg (below) over root and bevel to the brace (above); "
        f"{sign}; cells show medians, grey ones were not seen, and small saturated patches are "
        "ghosts of the laser.",
        f"Map of the deviation over clock position and height: median "
        f"{1e3 * float(np.median(kind.known)):.3f} mm.",
    )


def read_stations_picture(data: ReportData) -> picture.ReportPicture | None:
    """The picture that the stitching left; None if it is not there."""
    file = data.directory / STATIONS_PICTURE
    if not file.is_file() or file.stat().st_size > MOST_PICTURE_BYTES:
        return None
    return picture.picture_from_png(
        file.read_bytes(),
        "Stations and their overlaps",
        "Left, which station saw which part of the groove, overlaps shaded; right, what is left "
        "between the stations' corners in each overlap once all are placed.",
    )
