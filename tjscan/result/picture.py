"""``scan.png``: the joint, the groove points, the five corners and the flange's path."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, sqrt
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.proj3d import proj_transform

from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.settings import GrooveSettings
from tjscan.result.readings import ProfileReading, fitted_side_polylines
from tjscan.result.section import MEASURE_FIELDS, lengths_along_groove, measure_columns

STEEL_COLOUR: Final = "#9aa5b1"
LASER_COLOUR: Final = "#2f7ed8"
ROOT_COLOUR: Final = "#d62728"
CORNER_COLOUR: Final = "#1b1b1b"
PATH_COLOUR: Final = "#2ca02c"


MOST_POINTS_DRAWN: Final = 6000
"""More would only make the picture slow."""

MOST_SECTION_NUMBERS_DRAWN: Final = 24
"""Numbers of sections that can be distinguished."""

PANEL_ASPECT: Final = 1.3
"""Width of the place that a picture has, by its height."""

AXIS_NAME_DISTANCE: Final = 130.0
"""Millimetres along an axis of its name."""

ANGLE_COLOURS: Final = "viridis"


def draw_groove_3d(
    axes: Any,
    sections: Sequence[MeasuredSection],
    points: Array,
    frame: str,
    outline: Sequence[Array],
    paths: Sequence[Array],
) -> None:
    """Draw the groove in space, to scale: sections coloured by groove angle, and their numbers.

    Parameters
    ----------
    axes : Axes3D
        To draw in, of an orthographic projection.
    sections : sequence of MeasuredSection
        One at least, in the order along the groove.
    points : ndarray, shape (n, 3)
        The groove's points, metres, in the frame of the sections.
    frame : str
        Letter of that frame.
    outline, paths : sequence of ndarray, shape (n, 3)
        Lines of the joint, and paths of the flange, metres, in the same frame.
    """
    for line in outline:
        axes.plot(*(1e3 * line.T), color=STEEL_COLOUR, linewidth=0.4, alpha=0.6)
    dots = 1e3 * points[:: max(1, ceil(len(points) / MOST_POINTS_DRAWN))]
    axes.scatter(*dots.T, s=0.6, color=LASER_COLOUR, alpha=0.5, depthshade=False, linewidths=0)
    corners = 1e3 * np.array([section.points for section in sections])
    for k in (1, 2, 3):
        axes.plot(*corners[:, k].T, color=CORNER_COLOUR, linewidth=0.6)
    angles = MEASURE_FIELDS[0].values_in_file_units(sections)
    scale = Normalize(angles.min(), max(angles.max(), angles.min() + 1e-3))
    for section, angle in zip(corners, angles, strict=True):
        axes.plot(*section.T, color=colormaps[ANGLE_COLOURS](scale(angle)), linewidth=1.6)
    for k in range(0, len(sections), ceil(len(sections) / MOST_SECTION_NUMBERS_DRAWN)):
        p4, p5 = corners[k, 3:]
        at = p5 + 14 * (p5 - p4) / max(float(np.linalg.norm(p5 - p4)), 1e-9)
        axes.text(*at, str(sections[k].index), fontsize="small", ha="center", va="center")
    for path in paths:
        axes.plot(*(1e3 * path.T), color=PATH_COLOUR, linewidth=0.8, marker=".", markersize=3)
    everything = np.concatenate((*corners, *(1e3 * line for line in (*outline, *paths))))
    middle = np.nan_to_num(sections[len(sections) // 2].azimuth)
    towards = float(np.degrees(middle)) + 10
    low, high = np.nanmin(everything, axis=0), np.nanmax(everything, axis=0)
    rightward = np.array((-np.sin(np.radians(towards)), np.cos(np.radians(towards)), 1.0))
    foot = np.where(rightward > 0, low, high)
    _draw_coordinate_axes(axes, frame, foot)
    axis_names = foot + AXIS_NAME_DISTANCE * np.eye(3)
    _look_from_outside(axes, towards, np.vstack((everything, axis_names)))
    colours = ScalarMappable(scale, ANGLE_COLOURS)
    place = {"location": "bottom", "shrink": 0.5, "pad": 0.02, "aspect": 30}
    bar = axes.figure.colorbar(colours, ax=axes, **place)
    bar.set_label(MEASURE_FIELDS[0].chart_title)
    bar.outline.set_visible(False)


def _look_from_outside(axes: Any, towards: float, everything: Array) -> None:
    """Look from outside, from an azimuth in degrees, as near as all that is drawn allows."""
    axes.set_proj_type("ortho")
    axes.view_init(elev=25, azim=towards)
    limits = (axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d())
    aspect = [high - low for low, high in limits]
    axes.set_box_aspect(aspect)
    x, y, _ = proj_transform(*everything.T, axes.get_proj())
    # Half widths in those of the axes, which are square and are in a wider place.
    half = np.ptp(axes.viewLim.get_points(), axis=0) / 2
    reach = max(np.nanmax(np.abs(x)) / half[0] / PANEL_ASPECT, np.nanmax(np.abs(y)) / half[1])
    axes.set_box_aspect(aspect, zoom=0.95 / reach)
    axes.set_axis_off()
    for artist in (*axes.lines, *axes.collections, *axes.texts):
        artist.set_clip_on(False)
        artist.set_in_layout(False)


def _draw_coordinate_axes(axes: Any, frame: str, low: Array) -> None:
    """Axes of 100 mm from the lower left corner: direction and scale at once."""
    for name, axis in zip("xyz", np.eye(3), strict=True):
        line = np.column_stack((low, low + 100 * axis))
        axes.plot(*line, color=CORNER_COLOUR, linewidth=0.9)
        at = low + AXIS_NAME_DISTANCE * axis
        axes.text(*at, f"${name}_{frame}$", ha="center", va="center")
    axes.text(*(low - (0, 0, 110)), "axes: 100 mm", fontsize="small", ha="center", va="center")


PRINTED_FIGURE_STYLE: Final[dict[Any, Any]] = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
}
"""As journals want it over two columns."""

PRINTED_DPI: Final = 300

BAND_SIGMAS: Final = 2.0
"""Half width of the bands, in standard deviations."""

MOST_PROFILES_DRAWN: Final = 48
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
        Lines of the joint, metres, in the same frame; empty if no joint is known.
    paths : sequence of ndarray, shape (n, 3)
        Paths of the flange, metres, in the same frame, one for each station.
    example : ProfileReading, optional
        A section to show in the laser plane; depth and area are shown if left out.
    """
    with rc_context(PRINTED_FIGURE_STYLE):
        figure = Figure(figsize=(9.6, 5.2), dpi=PRINTED_DPI, layout="constrained")
        grid = figure.add_gridspec(2, 2, width_ratios=(1.6, 1))
        space = figure.add_subplot(grid[:, 0], projection="3d", computed_zorder=False)
        draw_groove_3d(space, sections, points, frame, outline, paths)
        beside, below = (figure.add_subplot(grid[k, 1]) for k in (0, 1))
        if example is None:
            _draw_measures(beside, sections, DEPTH_AND_AREA)
        else:
            draw_profile(beside, example)
            beside.set_title(f"{example.name} in the laser plane")
        _draw_measures(below, sections, ANGLE_AND_WIDTH)
        space.set_title(f"(a)  {title}{'; green: path of the flange' if paths else ''}")
        for letter, axes in zip("bc", (beside, below), strict=True):
            axes.set_title(f"({letter})  {axes.get_title()}")
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
        Is in the picture's metadata.

    Raises
    ------
    RecordingError
        If it can't be written.
    """
    try:
        entries = {} if provenance is None else provenance.header_entries
        figure.savefig(file, dpi="figure", format="png", metadata=entries)
    except OSError as error:
        raise RecordingError(f"{file}: can't be written: {error.strerror}") from error


def draw_profile(axes: Any, reading: ProfileReading) -> None:
    """Draw a profile in the laser plane with the corners that are seen, the sensor to the right."""
    profile = reading.profile
    axes.plot(1e3 * profile.z_s, 1e3 * profile.x_s, ".", color=LASER_COLOUR, markersize=1.2)
    for i, (x, _, z) in enumerate(1e3 * reading.points_s, start=1):
        if not reading.corners_seen[i - 1]:
            continue
        axes.plot(z, x, "o", color=CORNER_COLOUR, markersize=3)
        axes.annotate(f"$p_{i}$", (z, x), xytext=(8, -2), textcoords="offset points")
    axes.margins(0.12)
    axes.set(xlabel="$z_s$ / mm", ylabel="$x_s$ / mm")
    axes.invert_xaxis()
    axes.set_aspect("equal", adjustable="datalim")


def _draw_measures(axes: Any, sections: Sequence[MeasuredSection], which: tuple[int, int]) -> None:
    """Draw two of the measures along the groove with their bands, each with its own scale."""
    along = 1e3 * lengths_along_groove(sections)
    measures = [measure_columns(sections)[i] for i in which]
    for (field, values, sigmas), part, colour in zip(
        measures, (axes, axes.twinx()), (CORNER_COLOUR, ROOT_COLOUR), strict=True
    ):
        low, high = values - BAND_SIGMAS * sigmas, values + BAND_SIGMAS * sigmas
        part.fill_between(along, low, high, color=colour, alpha=0.15, linewidth=0)
        part.plot(along, values, marker="o", markersize=2.5, color=colour)
        part.set_ylabel(field.chart_title, color=colour)
        part.tick_params(axis="y", colors=colour)
        part.spines["top"].set_visible(False)
    axes.set_xlabel("along the groove / mm")
    names = " and ".join(field.name_in_words for field, _, _ in measures)
    axes.set_title(f"{names}, ± {BAND_SIGMAS:g} σ")


def draw_profiles_with_fits(readings: Sequence[ProfileReading], settings: GrooveSettings) -> Figure:
    """Draw profiles, at most `MOST_PROFILES_DRAWN`, with the fitted sides over their points.

    Parameters
    ----------
    readings : sequence of ProfileReading
    settings : GrooveSettings
        How they were read.
    """
    chosen = readings[:: max(1, ceil(len(readings) / MOST_PROFILES_DRAWN))]
    columns = ceil(sqrt(len(chosen)))
    rows = ceil(len(chosen) / columns)
    figure = Figure(figsize=(4.2 * columns, 3.6 * rows), layout="constrained")
    for i, reading in enumerate(chosen, start=1):
        axes = figure.add_subplot(rows, columns, i)
        draw_profile(axes, reading)
        if reading.refusal is None:
            for side in fitted_side_polylines(reading.profile, settings):
                axes.plot(1e3 * side[:, 1], 1e3 * side[:, 0], color=CORNER_COLOUR, linewidth=1)
        found = f": {reading.found_in_words}" if reading.found_in_words else ""
        axes.set_title(f"{reading.name}{found}", fontsize=9)
    return figure
