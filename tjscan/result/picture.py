"""``scan.png``: the joint, the groove points, the five corners and the flange's path."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, sqrt
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.settings import GrooveSettings
from tjscan.result.readings import ProfileReading, fitted_side_polylines
from tjscan.result.section import MEASURES, lengths_along_groove

STEEL, LASER, ROOT, CORNER, PATH = "#9aa5b1", "#2f7ed8", "#d62728", "#1b1b1b", "#2ca02c"
POINTS_DRAWN = 6000
"""More would only make the picture slow."""

MOST_DRAWN: Final = 48
"""A picture of more profiles shows nothing any more."""

ANGLE_AND_WIDTH, DEPTH_AND_AREA = (0, 1), (2, 3)
"""Measures that are drawn together."""


def draw_groove_overview(
    sections: Sequence[MeasuredSection],
    points: Array,
    *,
    frame: str,
    title: str,
    outline: Sequence[Array] = (),
    paths: Sequence[Array] = (),
    example: ProfileReading | None = None,
) -> Figure:
    """Draw the groove in space, one profile with its corners, and the measures along the groove.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        One at least, in the order along the groove.
    points : ndarray, shape (n, 3)
        The groove's points, metres, in the frame of the sections.
    frame : str
        Letter of that frame.
    title : str
        What it shows.
    outline : sequence of ndarray, shape (n, 3)
        Lines of the joint, metres, in the same frame; empty where no joint is known.
    paths : sequence of ndarray, shape (n, 3)
        Paths of the flange, metres, in the same frame, one for each station.
    example : ProfileReading, optional
        A section to show in the laser plane; depth and area are shown where left out.
    """
    figure = Figure(figsize=(14, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1))
    space = figure.add_subplot(grid[:, 0], projection="3d", computed_zorder=False)
    draw_groove_3d(space, sections, points, frame, outline, paths)
    space.set_title(title)
    beside = figure.add_subplot(grid[0, 1])
    if example is None:
        _draw_measures(beside, sections, DEPTH_AND_AREA)
    else:
        draw_profile(beside, example)
        beside.set_title(f"{example.name} in the laser plane")
    _draw_measures(figure.add_subplot(grid[1, 1]), sections, ANGLE_AND_WIDTH)
    return figure


def write_png(file: Path, figure: Figure, provenance: Provenance | None = None) -> None:
    """Write a figure as PNG.

    Parameters
    ----------
    file : Path
        The file to write.
    figure : Figure
        What to write.
    provenance : Provenance, optional
        Stands in the picture's metadata.

    Raises
    ------
    RecordingError
        If it can't be written.
    """
    try:
        entries = {} if provenance is None else provenance.header_entries
        figure.savefig(file, dpi=110, format="png", metadata=entries)
    except OSError as error:
        raise RecordingError(f"{file}: can't be written: {error.strerror}") from error


def draw_groove_3d(
    axes: Any,
    sections: Sequence[MeasuredSection],
    points: Array,
    frame: str,
    outline: Sequence[Array],
    paths: Sequence[Array],
) -> None:
    """Draw the groove in space; parameters as of `draw_groove_overview`."""
    for line in outline:
        axes.plot(*(1e3 * line.T), color=STEEL, linewidth=0.7, alpha=0.6)
    points = points[:: max(1, len(points) // POINTS_DRAWN)]
    dots: dict[str, Any] = {"depthshade": False, "linewidths": 0}
    axes.scatter(*(1e3 * points.T), s=1.5, color=LASER, label="profile points", **dots)
    corners = np.array([section.points for section in sections])
    for indices, colour, label in (((0, 1, 4), CORNER, "p1 p2 p5"), ((2, 3), ROOT, "root corners")):
        chosen = corners[:, indices].reshape(-1, 3)
        axes.scatter(*(1e3 * chosen.T), s=14, color=colour, label=label, **dots)
    for i, path in enumerate(paths):
        # A name that begins with an underscore stays out of the legend.
        name = "_another" if i else "flange path"
        axes.plot(*(1e3 * path.T), color=PATH, linewidth=1.2, marker=".", label=name)
    axes.set_xlabel(f"$x_{frame}$ / mm")
    axes.set_ylabel(f"$y_{frame}$ / mm")
    axes.set_zlabel(f"$z_{frame}$ / mm")
    middle = sections[len(sections) // 2]
    towards = np.degrees(np.nan_to_num(middle.azimuth))
    axes.view_init(elev=28, azim=float(towards) + 40)
    limits = (axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d())
    axes.set_box_aspect([high - low for low, high in limits], zoom=1.15)
    axes.legend(loc="upper right", markerscale=2)


def draw_profile(axes: Any, reading: ProfileReading) -> None:
    """Draw a profile in the laser plane with the corners that are seen, the sensor to the right."""
    profile = reading.profile
    axes.plot(1e3 * profile.z_s, 1e3 * profile.x_s, ".", color=LASER, markersize=2)
    for i, (x, _, z) in enumerate(1e3 * reading.points_s, start=1):
        if not reading.is_seen[i - 1]:
            continue
        axes.plot(z, x, "o", color=CORNER, markersize=4)
        axes.annotate(f"$p_{i}$", (z, x), xytext=(8, -2), textcoords="offset points")
    axes.margins(0.08)
    axes.set_xlabel("$z_s$ / mm")
    axes.set_ylabel("$x_s$ / mm")
    axes.invert_xaxis()
    axes.set_aspect("equal", adjustable="datalim")


def _draw_measures(axes: Any, sections: Sequence[MeasuredSection], which: tuple[int, int]) -> None:
    """Draw two of the measures along the groove, each with its own scale."""
    along = 1e3 * lengths_along_groove(sections)
    fields = [MEASURES[i] for i in which]
    for field, part, colour in zip(fields, (axes, axes.twinx()), (CORNER, ROOT), strict=True):
        part.plot(along, field.values(sections), marker="o", markersize=3, color=colour)
        part.set_ylabel(field.chart_title, color=colour)
    axes.set_xlabel("along the groove / mm")
    axes.set_title(" and ".join(field.name_in_words for field in fields))


def draw_profiles_with_fits(readings: Sequence[ProfileReading], settings: GrooveSettings) -> Figure:
    """Draw profiles, at most `MOST_DRAWN`, with the fitted sides over their points.

    Parameters
    ----------
    readings : sequence of ProfileReading
    settings : GrooveSettings
        How they were read.
    """
    chosen = readings[:: max(1, ceil(len(readings) / MOST_DRAWN))]
    columns = ceil(sqrt(len(chosen)))
    rows = ceil(len(chosen) / columns)
    figure = Figure(figsize=(4.2 * columns, 3.6 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    for i, reading in enumerate(chosen, start=1):
        axes = figure.add_subplot(rows, columns, i)
        draw_profile(axes, reading)
        if reading.refusal is None:
            for side in fitted_side_polylines(reading.profile, settings):
                axes.plot(1e3 * side[:, 1], 1e3 * side[:, 0], color=CORNER, linewidth=1)
        found = f": {reading.found_in_words}" if reading.found_in_words else ""
        axes.set_title(f"{reading.name}{found}", fontsize=9)
    return figure
