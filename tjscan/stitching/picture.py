"""``stitch.png``: who saw what, where stations overlap, and what is left between them there."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from tjscan.stitching.registration import StationRegistration, StitchingDraft
from tjscan.stitching.stations import arc_of_azimuths

STATION_COLOURS: Final = ("#2f7ed8", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf")
OVERLAP_COLOUR: Final = "#9aa5b1"
CORNER_MARKS: Final = ("o", "s", "^")
"""Of p2, p3 and p4."""

RING_SPACING: Final = 0.12
"""Between the stations' rings."""


def draw_stitching(draft: StitchingDraft) -> Figure:
    """Draw stations and overlaps about the brace, and the residuals of each overlap."""
    figure = Figure(figsize=(13, 6.5), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(1, 1.3))
    _plot_station_arcs(figure.add_subplot(grid[0], projection="polar"), draft)
    if not draft.registrations:
        beside = figure.add_subplot(grid[1])
        lines = [draft.describe_overlap(overlap) for overlap in draft.overlaps]
        lines = lines or [draft.describe_coverage()]
        beside.text(0.0, 0.5, "\n".join(lines).replace(" overlap at", "\noverlap at"), wrap=True)
        beside.set_axis_off()
        return figure
    rows = grid[1].subgridspec(len(draft.registrations), 1)
    for k, edge in enumerate(draft.registrations):
        _draw_residuals(figure.add_subplot(rows[k]), draft, edge)
    return figure


def _station_colour(station: int) -> str:
    return STATION_COLOURS[station % len(STATION_COLOURS)]


def _plot_station_arcs(axes: Any, draft: StitchingDraft) -> None:
    for overlap in draft.overlaps:
        arc = overlap.arc
        middle, width = arc.start + 0.5 * arc.span_angle, arc.span_angle
        axes.bar(middle, 1.6, width, color=OVERLAP_COLOUR, alpha=0.35, linewidth=0)
    for k, (name, azimuths) in enumerate(zip(draft.names, draft.azimuths, strict=True)):
        arc, radius, colour = arc_of_azimuths(azimuths), 1 + RING_SPACING * k, _station_colour(k)
        turn = np.linspace(arc.start, arc.end, 200)
        axes.plot(turn, np.full(200, radius), color=colour, linewidth=1.5, label=name)
        on_ring = np.full(len(azimuths), radius)
        axes.plot(azimuths, on_ring, ".", color=colour, markersize=5)
    axes.set_rlim(0, 1.6)
    axes.set_yticks([])
    axes.legend(loc="center", frameon=False)
    axes.set_title("sections about the brace, overlaps shaded")


def _draw_residuals(axes: Any, draft: StitchingDraft, edge: StationRegistration) -> None:
    middle = edge.overlap.arc.middle_azimuth
    at = np.degrees(edge.azimuth + middle)
    for k, second in ((edge.overlap.first, False), (edge.overlap.second, True)):
        mine = edge.of_second == second
        for corner, mark in enumerate(CORNER_MARKS):
            for axis, fill in ((0, "full"), (1, "none")):
                off, colour = 1e3 * edge.residual[mine, 2 * corner + axis], _station_colour(k)
                axes.plot(at[mine], off, mark, color=colour, fillstyle=fill, markersize=4)
    axes.plot(at[~edge.counted], np.zeros(int((~edge.counted).sum())), "x", color="black")
    centre, half = np.degrees(middle), 0.5 * np.degrees(edge.overlap.arc.span_angle)
    axes.axvspan(centre - half, centre + half, color=OVERLAP_COLOUR, alpha=0.35)
    axes.axhline(0, color="black", linewidth=0.6)
    axes.set_ylabel("residual / mm")
    axes.set_xlabel("azimuth / °")
    names = f"{draft.names[edge.overlap.first]}, {draft.names[edge.overlap.second]}"
    axes.set_title(
        f"{names}: {1e3 * edge.residual_rms:.3f} mm rms, misfit {edge.reduced_chi2:.2f} "
        "(p2 ○ p3 □ p4 △, full outwards, open upwards)",
        fontsize=9,
    )
