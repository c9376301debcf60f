"""``plan.png``: three sections filled with beads, and speed and heat along them."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tjscan.core.units import MM
from tjscan.planning.lay import ArrangedGroove, laying_order
from tjscan.planning.path import bead_centroids
from tjscan.planning.plan import WeldPlan
from tjscan.planning.wps import KJ_PER_MM, MM_PER_MIN

DRAWN_SECTION_PLACES: Final = (0.1, 0.5, 0.9)
"""Where along the groove sections are drawn, as shares of its length."""

BEAD_KIND_COLOURS: Final = {"root": "#d62728", "fill": "#2f7ed8", "cap": "#2ca02c"}


def draw_plan(plan: WeldPlan, sides: str = "from bevel to leg") -> Figure:
    """Draw three sections with their beads, numbered in the order of welding, speed and heat.

    Parameters
    ----------
    plan : WeldPlan
        The plan.
    sides : str, optional
        What the sections lie between, from left to right.
    """
    figure = Figure(figsize=(14, 8), layout="constrained")
    grid = figure.add_gridspec(2, 6)
    for k, share in enumerate(DRAWN_SECTION_PLACES):
        axes = figure.add_subplot(grid[0, 2 * k : 2 * k + 2])
        axes.set_xlabel(f"{sides} / mm")
        _draw_section(axes, plan, share)
    arc = plan.wps.arc
    speed = "speed", MM_PER_MIN, "travel speed / mm/min", arc.travel_speed
    heat = "heat", KJ_PER_MM, "heat input / kJ/mm", arc.heat_input
    for k, (name, unit, label, window) in enumerate((speed, heat)):
        axes = figure.add_subplot(grid[1, 3 * k : 3 * k + 3])
        for bead in plan.beads:
            values = getattr(bead, name) / unit.factor
            axes.plot(bead.s / MM.factor, values, color=BEAD_KIND_COLOURS[bead.kind], lw=0.8)
        for limit in window:
            axes.axhline(limit / unit.factor, color="black", lw=0.8, ls="--")
        axes.set(xlabel="s / mm", ylabel=label)
        for kind in dict.fromkeys(bead.kind for bead in plan.beads):
            axes.plot([], [], color=BEAD_KIND_COLOURS[kind], label=kind)
        axes.plot([], [], color="black", ls="--", label="WPS")
        axes.legend(ncols=4, fontsize="small")
    return figure


def _draw_section(axes: Axes, plan: WeldPlan, share: float) -> None:
    s = share * plan.edges.length
    places = (s, s + plan.edges.length)  # of a groove that closes, a zone may pass its start
    zone = next(z for z in plan.zones if any(z.begin <= at <= z.end for at in places))
    _, cells = ArrangedGroove(plan.edges, zone.arrangement, plan.wps).cut(np.array([s]))
    order = [
        sum(cells.counts[:k]) + place
        for k, count in enumerate(cells.counts)
        for place in laying_order(count, k)
    ]
    colours = colormaps["viridis"]
    middles = bead_centroids(cells)[0] / MM.factor
    for j, outline in enumerate(cells.outlines(0)):
        turn = order.index(j)
        x, y = (outline / MM.factor).T
        axes.fill(x, y, facecolor=colours(turn / len(order)), alpha=0.6, edgecolor="black", lw=0.8)
        (at_x, at_y), number = middles[j].tolist(), str(plan.after_pass + turn + 1)
        axes.text(at_x, at_y, number, ha="center", va="center", fontsize="small")
    axes.set_aspect("equal")
    area = 1e6 * float(cells.areas.sum())
    axes.set_title(f"s = {s / MM.factor:.0f} mm, {len(order)} beads, {area:.0f} mm²", fontsize=10)
    axes.set_ylabel("out of the root / mm")
