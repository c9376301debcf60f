"""How the joint is fitted up, unrolled: tack welds, root, and how far its tubes stand off."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove.section import TACK_WELD
from tjscan.report.charts import places_along_groove
from tjscan.report.data import ReportData
from tjscan.report.dimensions import (
    COVERAGE_SIGMAS,
    DEGREES_PER_HOUR,
    clock_text,
    section_dimensions,
    sections_by_the_clock,
)
from tjscan.report.picture import DOTTED_LINE, ReportPicture, inline_figure, new_figure
from tjscan.result.picture import BAND_SIGMAS, CORNER_COLOUR, LASER_COLOUR, PATH_COLOUR, ROOT_COLOUR
from tjscan.result.section import absent_corners, lengths_along_groove

ROOT_WIDTH: Final = 1
"""Place of the root's width among the measures of a section."""


def draw_fit_up(data: ReportData) -> ReportPicture:
    """Tacks, root and high-low over the clock position, or the groove's length without a joint."""
    x, label = places_along_groove(data)
    if data.unwrapped_azimuths is not None:
        x = x / DEGREES_PER_HOUR
        label = "clock position / h: 0 (12 o'clock) at the crown, 3 at azimuth 90°"
    order = np.argsort(x)
    x, sections = x[order], [data.sections[k] for k in order]
    tacked = np.array([TACK_WELD in section.conditions for section in sections])
    figure = new_figure(12, 3 if data.joint is None else 5.5)
    panels = figure.subplots(1 if data.joint is None else 2, 1, sharex=True, squeeze=False)[:, 0]
    for axes in panels:
        _shade_tack_welds(axes, x, tacked)
        axes.grid(alpha=0.3)
    opening = 1e3 * np.array([section.root_opening for section in sections])
    rootless = absent_corners(sections)[:, 1:].any(axis=1)
    width = 1e3 * np.array([section.measures[ROOT_WIDTH] for section in sections])
    width[~np.isnan(opening) | rootless] = np.nan
    widths = 1e3 * np.array([section.sigmas[ROOT_WIDTH] for section in sections])
    # An opening ends at p3, the edge of the bevel.
    edges = 1e3 * np.array([section.own_corner_sigmas[1] for section in sections])
    for name, y, sigma, colour in (
        ("root opening", opening, edges, ROOT_COLOUR),
        ("width of the root bead", width, widths, LASER_COLOUR),
    ):
        if not np.isnan(y).all():
            bars = BAND_SIGMAS * sigma
            panels[0].errorbar(x, y, bars, linewidth=1, color=colour, label=name, **DOTTED_LINE)
    panels[0].set_ylabel("root / mm")
    panels[0].set_ylim(bottom=0)
    high_low = ""
    if data.joint is not None:
        every = section_dimensions(sections, data.joint)
        rows = [{one.name: one.value for one in row} for row in every]
        for name, shown, colour in (
            ("high-low, brace", "brace's wall at p2", CORNER_COLOUR),
            ("high-low, leg", "leg at p4", PATH_COLOUR),
        ):
            panels[1].plot(x, [row[name] for row in rows], color=colour, label=shown, **DOTTED_LINE)
        panels[1].axhline(0, color="grey", linewidth=0.8)
        panels[1].set_ylabel("high-low / mm")
        high_low = (
            " High-low: how far the tubes stand out of where they are drawn, positive outwards."
        )
    for axes in panels:
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=8, ncols=3)
    panels[-1].set_xlabel(label)
    return inline_figure(
        figure,
        "Fit-up, unrolled",
        f"Shaded: tack welds, {int(tacked.sum())} of {len(sections)} sections lie on one. Bars are "
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


class FitUpCell(NamedTuple):
    """A cell: its text, what was drawn there, and its verdict as of `Dimension`."""

    text: str
    under: str = ""
    verdict: str = ""


def fit_up_table(data: ReportData) -> dict[str, Any]:
    """Make the head and rows of the table of the sections nearest to the full hours.

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
    names[1] = " or ".join(dict.fromkeys(row[1].name for row in every))
    head = [f"{name} / {one.unit}" for name, one in zip(names, every[0], strict=True)]
    rows = []
    for k, section, dimensions in zip(chosen, sections, every, strict=True):
        where = f"{lengths[k]:.0f} mm" if azimuths is None else clock_text(azimuths[k])
        cells = [FitUpCell(one.text, one.designed_text, one.verdict) for one in dimensions]
        rows.append([FitUpCell(where), FitUpCell(data.section_number(section)), *cells])
    has_tolerances = any(one.verdict for row in every for one in row)
    head = ["at", "section", *head]
    return {"head": head, "rows": rows, "sigmas": COVERAGE_SIGMAS, "has_tolerances": has_tolerances}
