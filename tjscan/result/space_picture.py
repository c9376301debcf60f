"""The groove in space as a still picture: sections, corner lines, the joint, the flange's path."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from mpl_toolkits.mplot3d.proj3d import proj_transform

from tjscan.core.frames import Array
from tjscan.groove.measured import MeasuredSection
from tjscan.result.colours import CORNER, LASER, PATH, STEEL
from tjscan.result.section import MEASURES

POINTS_DRAWN: Final = 6000
"""More would only make the picture slow."""

MOST_NUMBERS: Final = 24
"""Numbers of sections that can be told apart."""

WIDE: Final = 1.3
"""Width of the place that a picture has, by its height."""

AXIS_NAMES: Final = 130.0
"""Millimetres along an axis at which its name stands."""

COLOURS: Final = "viridis"


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
        axes.plot(*(1e3 * line.T), color=STEEL, linewidth=0.4, alpha=0.6)
    dots = 1e3 * points[:: max(1, ceil(len(points) / POINTS_DRAWN))]
    axes.scatter(*dots.T, s=0.6, color=LASER, alpha=0.5, depthshade=False, linewidths=0)
    corners = 1e3 * np.array([section.points for section in sections])
    for k in (1, 2, 3):
        axes.plot(*corners[:, k].T, color=CORNER, linewidth=0.6)
    angles = MEASURES[0].values(sections)
    scale = Normalize(angles.min(), max(angles.max(), angles.min() + 1e-3))
    for section, angle in zip(corners, angles, strict=True):
        axes.plot(*section.T, color=colormaps[COLOURS](scale(angle)), linewidth=1.6)
    for section, one in list(zip(corners, sections, strict=True))[
        :: ceil(len(sections) / MOST_NUMBERS)
    ]:
        outward = section[4] - section[3]
        at = section[4] + 14 * outward / max(float(np.linalg.norm(outward)), 1e-9)
        axes.text(*at, str(one.index), fontsize="small", ha="center", va="center")
    for path in paths:
        axes.plot(*(1e3 * path.T), color=PATH, linewidth=0.8, marker=".", markersize=3)
    everything = np.concatenate((*corners, *(1e3 * line for line in (*outline, *paths))))
    middle = np.nan_to_num(sections[len(sections) // 2].azimuth)
    towards = float(np.degrees(middle)) + 10
    low, high = np.nanmin(everything, axis=0), np.nanmax(everything, axis=0)
    rightward = np.array((-np.sin(np.radians(towards)), np.cos(np.radians(towards)), 1.0))
    foot = np.where(rightward > 0, low, high)
    _draw_axes(axes, frame, foot)
    _look(axes, towards, np.vstack((everything, foot + AXIS_NAMES * np.eye(3))))
    bar = axes.figure.colorbar(
        ScalarMappable(scale, COLOURS), ax=axes, location="bottom", shrink=0.5, pad=0.02, aspect=30
    )
    bar.set_label(MEASURES[0].chart_title)
    bar.outline.set_visible(False)


def _look(axes: Any, towards: float, everything: Array) -> None:
    """Look from outside, from an azimuth in degrees, as near as all that is drawn allows."""
    axes.set_proj_type("ortho")
    axes.view_init(elev=25, azim=towards)
    limits = (axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d())
    aspect = [high - low for low, high in limits]
    axes.set_box_aspect(aspect)
    x, y, _ = proj_transform(*everything.T, axes.get_proj())
    # Half widths in those of the axes, which are square and stand in a wider place.
    half = np.ptp(axes.viewLim.get_points(), axis=0) / 2
    reach = max(np.nanmax(np.abs(x)) / half[0] / WIDE, np.nanmax(np.abs(y)) / half[1])
    axes.set_box_aspect(aspect, zoom=0.95 / reach)
    axes.set_axis_off()
    for artist in (*axes.lines, *axes.collections, *axes.texts):
        artist.set_clip_on(False)
        artist.set_in_layout(False)


def _draw_axes(axes: Any, frame: str, low: Array) -> None:
    """Axes of 100 mm from the lower left corner: direction and scale at once."""
    for k, name in enumerate("xyz"):
        tip = low + 100 * np.eye(3)[k]
        axes.plot(*np.column_stack((low, tip)), color=CORNER, linewidth=0.9)
        axes.text(*(low + AXIS_NAMES * np.eye(3)[k]), f"${name}_{frame}$", ha="center", va="center")
    axes.text(*(low - (0, 0, 110)), "axes: 100 mm", fontsize="small", ha="center", va="center")
