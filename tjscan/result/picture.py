"""``scan.png``: the joint, the groove points, the five corners and the flange's path."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tjscan.errors import RecordingError
from tjscan.frames import Array, transform
from tjscan.laser.profile import Profile
from tjscan.result.frame import ResultFrame
from tjscan.scanning.scan import Scan
from tjscan.scanning.scanner import ScanResult

STEEL, LASER, ROOT, CORNER, PATH = "#9aa5b1", "#2f7ed8", "#d62728", "#1b1b1b", "#2ca02c"
POINTS_DRAWN = 6000
"""More would only make the picture slow."""


def draw_scan(
    result: ScanResult, frame: ResultFrame, points: Array, outline: Sequence[Array]
) -> Figure:
    """Draw a scan.

    Parameters
    ----------
    result : ScanResult
        What was found.
    frame : ResultFrame
        The frame to draw in.
    points : ndarray, shape (n, 3)
        The groove's points, metres, in that frame.
    outline : sequence of ndarray, shape (n, 3)
        Lines of the joint, metres, in the same frame; empty where no joint is known.
    """
    figure = Figure(figsize=(14, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1))
    space = figure.add_subplot(grid[:, 0], projection="3d", computed_zorder=False)
    _draw_space(space, result, frame, points, outline)
    middle = result.sections[len(result.sections) // 2]
    beside = figure.add_subplot(grid[0, 1])
    draw_profile(beside, middle.view.profile, middle.groove.points_s)
    beside.set_title(f"section {middle.view.index} in the laser plane")
    _draw_measures(figure.add_subplot(grid[1, 1]), result.sections)
    return figure


def write_picture(file: Path, figure: Figure) -> None:
    """Write a figure as PNG.

    Raises
    ------
    RecordingError
        If it can't be written.
    """
    try:
        figure.savefig(file, dpi=110, format="png")
    except OSError as error:
        raise RecordingError(f"{file}: can't be written: {error.strerror}") from error


def _draw_space(
    axes: Any, result: ScanResult, frame: ResultFrame, points: Array, outline: Sequence[Array]
) -> None:
    T = frame.T_from_b
    for line in outline:
        axes.plot(*(1e3 * line.T), color=STEEL, linewidth=0.7, alpha=0.6)
    points = points[:: max(1, len(points) // POINTS_DRAWN)]
    dots: dict[str, Any] = {"depthshade": False, "linewidths": 0}
    axes.scatter(*(1e3 * points.T), s=1.5, color=LASER, label="profile points", **dots)
    corners = np.array([transform(T, s.points_b) for s in result.sections])
    for indices, colour, label in (((0, 1, 4), CORNER, "p1 p2 p5"), ((2, 3), ROOT, "root corners")):
        chosen = corners[:, indices].reshape(-1, 3)
        axes.scatter(*(1e3 * chosen.T), s=14, color=colour, label=label, **dots)
    path = transform(T, [v.T_b_f[:3, 3] for v in result.views])
    axes.plot(*(1e3 * path.T), color=PATH, linewidth=1.2, marker=".", label="flange path")
    axes.set_xlabel(f"$x_{frame.name}$ / mm")
    axes.set_ylabel(f"$y_{frame.name}$ / mm")
    axes.set_zlabel(f"$z_{frame.name}$ / mm")
    middle = corners[len(corners) // 2, 1] if frame.T_b_j is not None else np.zeros(3)
    axes.view_init(elev=28, azim=float(np.degrees(np.arctan2(middle[1], middle[0]))) + 40)
    limits = (axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d())
    axes.set_box_aspect([high - low for low, high in limits], zoom=1.15)
    axes.legend(loc="upper right", markerscale=2)
    axes.set_title(f"{len(result.sections)} sections, {result.stop}")


def draw_profile(axes: Any, profile: Profile, points_s: Array) -> None:
    """Draw a profile in the laser plane with its corners, shape (k, 3), the sensor to the right."""
    corners = 1e3 * points_s
    axes.plot(1e3 * profile.z_s, 1e3 * profile.x_s, ".", color=LASER, markersize=2)
    axes.plot(corners[:, 2], corners[:, 0], "o", color=CORNER, markersize=4)
    for i, (x, _, z) in enumerate(corners, start=1):
        axes.annotate(f"$p_{i}$", (z, x), xytext=(8, -2), textcoords="offset points")
    axes.margins(0.08)
    axes.set_xlabel("$z_s$ / mm")
    axes.set_ylabel("$x_s$ / mm")
    axes.invert_xaxis()
    axes.set_aspect("equal", adjustable="datalim")


def _draw_measures(axes: Any, sections: Sequence[Scan]) -> None:
    origins = np.array([s.T_b_g[:3, 3] for s in sections])
    along = np.concatenate(([0.0], np.linalg.norm(np.diff(origins, axis=0), axis=1).cumsum()))
    angles = np.degrees([s.groove.opening_angle for s in sections])
    axes.plot(1e3 * along, angles, marker="o", markersize=3, color=CORNER)
    axes.set_xlabel("along the groove / mm")
    axes.set_ylabel("groove angle / °")
    twin = axes.twinx()
    widths = [1e3 * s.groove.root_width for s in sections]
    twin.plot(1e3 * along, widths, marker="o", markersize=3, color=ROOT)
    twin.set_ylabel("root width / mm", color=ROOT)
    axes.set_title("groove angle and root width")
