"""The deviation picture: a groove unwrapped, azimuth against the way along the section.

It is a map and no view of space: points drawn before an opaque mesh would hide those behind it,
which are the negative ones.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from tjscan.comparison.distance import DeviationDistances
from tjscan.comparison.shapes import Shape
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import write_files_atomically
from tjscan.core.frames import Array

MOST_MAP_CELLS: Final = (180, 110)
"""Most cells of the map, over the azimuths shown and along the section."""

SMALLEST_SCALE_MM: Final = 0.05
"""Smallest colour scale, mm: noise alone must not look like a deviation."""


class CornerCurves:
    """Curves of the corners p2, p3 and p4 over the azimuth.

    Parameters
    ----------
    points : ndarray, shape (n, 3, 3)
        p2, p3 and p4 of n sections in frame j, metres.
    closed : bool
        Whether the sections go all the way round the brace.
    """

    def __init__(self, points: Array, *, closed: bool) -> None:
        azimuth = np.arctan2(points[:, 1, 1], points[:, 1, 0])
        order = np.argsort(azimuth)
        rho = np.hypot(points[..., 0], points[..., 1])
        self._phi, self._closed = azimuth[order], closed
        # Distance from the brace's axis, and z, of each corner.
        self._rz = np.stack((rho, points[..., 2]), axis=-1)[order]

    def at_azimuths(self, phi: Array) -> Array:
        """Interpolate the three corners at other azimuths, shape (k, 3, 2)."""
        table = self._rz.reshape(len(self._phi), -1)
        period = 2 * np.pi if self._closed else None
        columns = [np.interp(phi, self._phi, column, period=period) for column in table.T]
        return np.column_stack(columns).reshape(-1, 3, 2)

    def positions_along_section(self, points: Array) -> Array:
        """Distance of points along their section from p3, metres, shape (k,).

        Positive over the bevel and up the brace, negative over the root and out along the leg.
        """
        p = np.column_stack((np.hypot(points[:, 0], points[:, 1]), points[:, 2]))
        p2, p3, p4 = np.moveaxis(self.at_azimuths(np.arctan2(points[:, 1], points[:, 0])), 1, 0)
        bevel, root = p2 - p3, p4 - p3
        length = np.linalg.norm(bevel, axis=1)
        width = np.linalg.norm(root, axis=1)
        up = (np.sum((p - p3) * bevel, axis=1)) / length
        out = (np.sum((p - p3) * root, axis=1)) / width
        # Nearest of the four parts: brace, bevel, root, leg.
        brace = np.maximum(p[:, 1] - p2[:, 1], 0)
        leg = np.linalg.norm(p - p4, axis=1)
        # The leg falls or rises off with the azimuth: half of the way out is allowed for.
        level = np.maximum(np.abs(p[:, 1] - p4[:, 1]) - 0.5 * np.abs(p[:, 0] - p4[:, 0]), 0)
        on_bevel, on_root = np.clip(up, 0, length), -np.clip(out, 0, width)
        s = np.stack((length + brace, on_bevel, on_root, -width - leg))
        apart = (
            np.hypot(p[:, 0] - p2[:, 0], np.minimum(p[:, 1] - p2[:, 1], 0)),
            np.linalg.norm(p - p3 - (on_bevel / length)[:, None] * bevel, axis=1),
            np.linalg.norm(p - p3 + (on_root / width)[:, None] * root, axis=1),
            np.where(p[:, 0] >= p4[:, 0], level, leg),
        )
        nearest = np.stack(apart).argmin(axis=0)
        return np.asarray(np.take_along_axis(s, nearest[None], axis=0)[0])


def groove_corner_curves(measured: Shape, reference: Shape) -> CornerCurves | None:
    """Curves of the groove's corners: as designed, else as measured; None if unknown."""
    edges, corners = reference.edges, measured.corners
    if edges is not None:
        points = np.stack([line.points_j for line in (edges.p2, edges.p3, edges.p4)], axis=1)
        return CornerCurves(points, closed=True)
    if corners is not None and len(corners) > 1:
        return CornerCurves(corners[:, 1:4], closed=False)
    return None


def deviation_map_figure(
    measured: Shape, reference: Shape, deviation: DeviationDistances, tolerance: float | None
) -> Figure:
    """Draw deviations as a map of azimuth and section, with a histogram of distances.

    Parameters
    ----------
    measured, reference : Shape
        What was compared.
    deviation : DeviationDistances
        Of the one from the other.
    tolerance : float or None
        Metres.

    Raises
    ------
    ConfigurationError
        If the comparison is not in frame j, where azimuths are.
    """
    frame = reference.stated.frame
    if frame != "j":
        raise ConfigurationError(
            f"the picture is over the azimuth, which frame {frame} does not know: compare with a "
            "reference in frame j",
            key="plot",
        )
    lines = groove_corner_curves(measured, reference)
    points = deviation.points
    azimuth = _azimuths_from_widest_gap(np.degrees(np.arctan2(points[:, 1], points[:, 0])))
    if lines is None:
        along = points[:, 2] - np.hypot(points[:, 0], points[:, 1])
        label = "$z_j - \\rho$ / mm, up the brace and in from the leg"
    else:
        along = lines.positions_along_section(points)
        label = "along the section from $p_3$ / mm:  leg  ←  →  brace"
    figure = Figure(figsize=(12, 6.5), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(4, 1))
    axes, side = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    corners = measured.corners
    sections = int(np.ptp(azimuth)) if corners is None else len(corners)
    columns = min(MOST_MAP_CELLS[0], max(10, sections))
    _draw_cells(axes, deviation, azimuth, 1e3 * along, columns)
    if lines is not None:
        _draw_corner_curves(axes, lines, azimuth)
    axes.set_xlabel("azimuth / °")
    in_hours = (lambda degrees: degrees / 30, lambda hours: 30 * hours)
    clock: Any = axes.secondary_xaxis("top", functions=in_hours)
    clock.set_xlabel("clock position, 12 at the crown")
    first, last = np.divide(axes.get_xlim(), 30)
    hours = np.arange(np.ceil(first), np.floor(last) + 1)  # of which there may be one, or none
    clock.set_xticks(hours, [f"{hour % 12 or 12:.0f}" for hour in hours])
    axes.set_ylabel(label)
    # Names of files are no formulas.
    axes.set_title(f"{deviation.kind}: {measured.name} and {reference.name}", parse_math=False)
    _draw_histogram(side, deviation, tolerance)
    return figure


def deviation_scale_mm(deviation: DeviationDistances) -> float:
    """Largest deviation in mm that colours distinguish: ghosts and flyers must not set it."""
    some_percent = float(np.percentile(np.abs(deviation.known), 90))
    return max(SMALLEST_SCALE_MM, 1.5e3 * some_percent)


def check_map_file(file: Path) -> None:
    """Refuse a file that no picture can be written to, before anything is computed for it.

    Raises
    ------
    ConfigurationError
        If it does not end in .png, or its folder does not exist or can't be written to.
    """
    if file.suffix.lower() != ".png" or file.is_dir():
        raise ConfigurationError("a picture ends in .png", file=file, key="plot")
    if not file.parent.is_dir():
        raise ConfigurationError("its folder does not exist", file=file, key="plot")
    if not os.access(file if file.exists() else file.parent, os.W_OK):
        raise ConfigurationError("can't be written: no permission", file=file, key="plot")


def write_deviation_map(file: Path, figure: Figure) -> None:
    """Write a map of deviations as PNG.

    Parameters
    ----------
    file : Path
        Ends in ``.png``; replaced if it exists.
    figure : Figure
        As `deviation_map_figure` draws it.

    Raises
    ------
    ConfigurationError
        As `check_map_file` does.
    RecordingError
        If it can't be written.
    """
    check_map_file(file)
    with write_files_atomically(file.parent) as draft:
        figure.savefig(draft / file.name, dpi=110, format="png")


def _azimuths_from_widest_gap(azimuth: Array) -> Array:
    """Azimuths in degrees counted from the widest gap, so that a scan is not cut in two."""
    taken = np.unique(np.floor(azimuth))
    gaps = np.diff(taken, append=taken[0] + 360)
    widest = int(gaps.argmax())
    start = -180.0 if gaps[widest] <= 2 else float(taken[(widest + 1) % len(taken)])
    return np.asarray((azimuth - start) % 360 + start)


def _draw_cells(
    axes: Any, deviation: DeviationDistances, azimuth: Array, along: Array, columns: int
) -> None:
    """Median of the distances in each cell; a cell without points stays grey."""
    from scipy.stats import binned_statistic_2d

    scale = deviation_scale_mm(deviation)
    name, sign, least, extend = "viridis", "unsigned", 0.0, "max"
    if deviation.signed:
        name, sign, least, extend = "RdBu_r", "positive outside", -scale, "both"
    low, high = np.percentile(along, (0.2, 99.8))
    x_edges = np.linspace(azimuth.min(), azimuth.max() + 1e-9, columns + 1)
    y_edges = np.linspace(low, high + 1e-9, MOST_MAP_CELLS[1] + 1)
    # The mean would let a single flyer paint its cell.
    mm, bins = 1e3 * deviation.distances, [x_edges, y_edges]
    medians, *_ = binned_statistic_2d(azimuth, along, mm, "median", bins=bins)
    cell_mm = np.ma.masked_invalid(medians.T)
    colours = colormaps[name].with_extremes(bad="#d0d0d0")
    cells = axes.pcolormesh(x_edges, y_edges, cell_mm, cmap=colours, vmin=least, vmax=scale)
    axes.set_facecolor("#d0d0d0")
    axes.figure.colorbar(cells, ax=axes, extend=extend, label=f"deviation / mm, {sign}")


def _draw_corner_curves(axes: Any, lines: CornerCurves, azimuth: Array) -> None:
    """The corners p2, p3 and p4 over the azimuths shown."""
    shown = np.linspace(azimuth.min(), azimuth.max(), 400)
    rz = 1e3 * lines.at_azimuths(np.radians((shown + 180) % 360 - 180))
    bevel = np.linalg.norm(rz[:, 0] - rz[:, 1], axis=1)
    root = np.linalg.norm(rz[:, 2] - rz[:, 1], axis=1)
    for name, s in (("$p_2$", bevel), ("$p_3$", np.zeros_like(bevel)), ("$p_4$", -root)):
        axes.plot(shown, s, color="black", linewidth=0.8)
        axes.annotate(name, (shown[-1], s[-1]), xytext=(3, -3), textcoords="offset points")


def _draw_histogram(axes: Any, deviation: DeviationDistances, tolerance: float | None) -> None:
    mm, scale = 1e3 * deviation.distances, deviation_scale_mm(deviation)
    low = -2 * scale if deviation.signed else 0.0
    inside = mm[(mm >= low) & (mm <= 2 * scale)]
    axes.hist(inside, bins=80, orientation="horizontal", color="#5b6b7b")
    for limit in () if tolerance is None else (-1e3 * tolerance, 1e3 * tolerance):
        axes.axhline(limit, color="#d62728", linewidth=1)
    axes.set_ylim(low, 2 * scale)
    axes.set_xlabel("points")
    axes.set_ylabel("deviation / mm")
    # Ghosts decide a cloud's rms and extremes, and neither its median nor what half of it does.
    middle = float(np.median(mm))
    half = float(np.median(np.abs(mm - middle)))
    share = "" if deviation.within is None else f"\nwithin tolerance {100 * deviation.within:.1f} %"
    axes.set_title(f"median {middle:+.3f}\nhalf within ± {half:.3f}{share}", fontsize=9)
