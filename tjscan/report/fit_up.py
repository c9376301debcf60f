"""How the joint is fitted up, unrolled: tack welds, root, and how far its tubes stand off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove.section import TACK_WELD
from tjscan.joint.imperfections import NO_IMPERFECTIONS
from tjscan.report.data import ReportData
from tjscan.report.dimensions import (
    COVERAGE_SIGMAS,
    DEGREES_PER_HOUR,
    clock_text,
    section_dimensions,
    sections_by_the_clock,
)
from tjscan.report.picture import ReportPicture, inline_figure, new_figure
from tjscan.result.picture import BAND_SIGMAS, CORNER_COLOUR, LASER_COLOUR, PATH_COLOUR, ROOT_COLOUR
from tjscan.result.section import absent_corners, lengths_along_groove

ROOT_WIDTH: Final = 1
"""Place of the root's width among the measures of a section."""


def draw_fit_up(data: ReportData) -> ReportPicture:
    """Tacks, root and high-low over the clock position, or the groove's length without a joint."""
    x, label = _unrolled(data)
    order = np.argsort(x)
    sections = [data.sections[k] for k in order]
    x, absent = x[order], absent_corners(sections)
    tacked = np.array([TACK_WELD in section.conditions for section in sections])
    high_low = _high_low(data, order)
    figure = new_figure(12, 3 if high_low is None else 5.5)
    panels = figure.subplots(1 if high_low is None else 2, 1, sharex=True, squeeze=False)[:, 0]
    for axes in panels:
        _shade(axes, x, tacked)
        axes.grid(alpha=0.3)
    opening = 1e3 * np.array([section.root_opening for section in sections])
    width = 1e3 * np.array([section.measures[ROOT_WIDTH] for section in sections])
    closed = np.isnan(opening) & ~absent[:, 1:].any(axis=1)
    # An opening ends at p3, the edge of the bevel.
    edges = 1e3 * np.array([section.own_corner_sigmas[1] for section in sections])
    widths = 1e3 * np.array([section.sigmas[ROOT_WIDTH] for section in sections])
    for name, y, sigma, colour in (
        ("root opening", opening, edges, ROOT_COLOUR),
        ("width of the root bead", np.where(closed, width, np.nan), widths, LASER_COLOUR),
    ):
        if not np.isnan(y).all():
            bars = BAND_SIGMAS * sigma
            panels[0].errorbar(
                x, y, bars, fmt="o-", markersize=3, linewidth=1, color=colour, label=name
            )
    panels[0].set_ylabel("root / mm")
    panels[0].set_ylim(bottom=0)
    if high_low is not None:
        for y, name, colour in zip(
            high_low.T,
            ("brace's wall at p2", "leg at p4"),
            (CORNER_COLOUR, PATH_COLOUR),
            strict=True,
        ):
            panels[1].plot(x, 1e3 * y, marker="o", markersize=3, color=colour, label=name)
        panels[1].axhline(0, color="grey", linewidth=0.8)
        panels[1].set_ylabel("high-low / mm")
    for axes in panels:
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=8, ncols=3)
    panels[-1].set_xlabel(label)
    off = (
        ""
        if high_low is None
        else (" High-low: how far the tubes stand out of where they are drawn, positive outwards.")
    )
    return inline_figure(
        figure,
        "Fit-up, unrolled",
        f"Shaded: tack welds, {int(tacked.sum())} of {len(sections)} sections lie on one. Bars are "
        f"± {BAND_SIGMAS:g} standard deviations.{off}",
        f"Charts along the groove of the root{'' if high_low is None else ' and of high-low'}, "
        f"{int(tacked.sum())} sections on tack welds.",
        vector=True,
    )


def _unrolled(data: ReportData) -> tuple[Array, str]:
    """Where the sections are, and what that is called."""
    if (azimuths := data.unwrapped_azimuths) is not None:
        return azimuths / DEGREES_PER_HOUR, (
            "clock position / h: 0 (12 o'clock) at the crown, 3 at azimuth 90°"
        )
    return 1e3 * lengths_along_groove(data.sections), "along the groove / mm"


def _high_low(data: ReportData, order: NDArray[np.intp]) -> Array | None:
    """Metres by which brace and leg stand out of their drawn cylinders, (n, 2), if these are known.

    NaN if the corner is not seen.
    """
    if data.joint is None:
        return None
    points = np.array([data.sections[k].points for k in order])
    absent = absent_corners([data.sections[k] for k in order])
    brace = np.hypot(points[:, 1, 0], points[:, 1, 1]) - data.joint.brace_radius
    nominal = replace(data.joint, imperfections=NO_IMPERFECTIONS)
    leg = nominal.leg_surface.signed_distances(points[:, 3])
    return np.where(absent[:, [0, 2]], np.nan, np.column_stack((brace, leg)))


def _shade(axes: Any, x: Array, tacked: NDArray[np.bool_]) -> None:
    """Bands about the sections on tacks, half way to their neighbours."""
    middles = (x[1:] + x[:-1]) / 2
    bounds = np.concatenate((x[:1], middles, x[-1:]))
    first = True
    for k in np.flatnonzero(tacked):
        label = "tack weld" if first else None
        axes.axvspan(bounds[k], bounds[k + 1], color="#f2c14e", alpha=0.5, linewidth=0, label=label)
        first = False


@dataclass(frozen=True, slots=True)
class FitUpCell:
    """A cell: its text, what was drawn there, and its verdict as of `Dimension`."""

    text: str
    under: str = ""
    verdict: str = ""


@dataclass(frozen=True, slots=True)
class FitUpTable:
    """Head, rows and note of the table."""

    head: tuple[str, ...]
    rows: tuple[tuple[FitUpCell, ...], ...]
    note: str


def fit_up_table(data: ReportData) -> FitUpTable:
    """Make the table of the sections nearest to the full hours.

    Parameters
    ----------
    data : ReportData
        The run.
    """
    chosen = sections_by_the_clock(data)
    azimuths = data.unwrapped_azimuths
    lengths = 1e3 * lengths_along_groove(data.sections)
    sections = [data.sections[k] for k in chosen]
    every = section_dimensions(sections, data.joint)
    names = [one.name for one in every[0]]
    roots = dict.fromkeys(row[1].name for row in every)
    names[1] = " or ".join(roots)
    head = [f"{name} / {one.unit}" for name, one in zip(names, every[0], strict=True)]
    rows = []
    for k, section, dimensions in zip(chosen, sections, every, strict=True):
        where = f"{lengths[k]:.0f} mm" if azimuths is None else clock_text(azimuths[k])
        cells = [FitUpCell(one.text, one.designed_text, one.verdict) for one in dimensions]
        rows.append((FitUpCell(where), FitUpCell(data.section_number(section)), *cells))
    stated = any(one.verdict for row in every for one in row)
    note = f"± is {COVERAGE_SIGMAS:g} standard deviations. "
    if data.joint is not None:
        note += "In brackets what is drawn, in the section's own plane"
        note += ", and its tolerance" if stated else ""
        note += "; the root face is what remains of the drawn wall. "
    if stated:
        note += (
            "Green keeps its tolerance with all of its uncertainty, red breaks it so, and what is "
            "amber may do either (ISO 14253-1)."
        )
    elif data.joint is not None:
        note += "The joint's file states no [tolerance] to hold it against."
    return FitUpTable(("at", "section", *head), tuple(rows), note)
