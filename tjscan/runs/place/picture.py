"""``JOB.png``: where the stations stand about a joint, and what of its groove each scans."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tjscan.core.frames import Array, transform_points
from tjscan.result.picture import STEEL_COLOUR
from tjscan.runs.place.job import PlacedJoint
from tjscan.runs.place.search import AZIMUTHS_TRIED
from tjscan.stitching.picture import STATION_COLOURS


def draw_placed_joint(placed: PlacedJoint) -> Figure:
    """Draw the joint from above and from the side, the bases, and the arcs that they scan."""
    figure = Figure(figsize=(13, 6.5), layout="constrained")
    groove = _groove_w(placed)
    for column, (first, second, title) in enumerate(
        ((0, 1, "from above"), (0, 2, "from the side"))
    ):
        axes = figure.add_subplot(1, 2, column + 1)
        for outline in _outlines_w(placed):
            axes.plot(*(1e3 * outline[:, [first, second]].T), color=STEEL_COLOUR, linewidth=1)
        for n, (arc, colour) in enumerate(zip(placed.stations, STATION_COLOURS, strict=False), 1):
            seen = groove[np.arange(arc.first, arc.last + 1) % AZIMUTHS_TRIED]
            shift = 1e3 * 0.012 * (n - 1)  # so that overlaps show
            x, y = 1e3 * seen[:, [first, second]].T
            axes.plot(x, y + shift, color=colour, linewidth=3, label=f"place-{n}")
            u, v = (1e3 * arc.T_w_b[[first, second], 3]).tolist()
            along, up = (200 * arc.T_w_b[[first, second], 0]).tolist()
            axes.plot(u, v, "s", color=colour, markersize=10)
            mount = (1e3 * (arc.T_w_b[:3, 3] - 0.3 * arc.T_w_b[:3, 2]))[[first, second]]
            axes.plot((u, mount[0]), (v, mount[1]), color=colour, linewidth=4, alpha=0.3)
            axes.arrow(u, v, along, up, color=colour, head_width=30)
        axes.margins(0.1)
        axes.set_aspect("equal")
        axes.set_xlabel(f"{'xyz'[first]} in frame w, mm")
        axes.set_ylabel(f"{'xyz'[second]} in frame w, mm")
        axes.set_title(title)
        axes.legend(loc="best", framealpha=0.8)
        axes.grid(visible=True, alpha=0.3)
    return figure


def _groove_w(placed: PlacedJoint) -> Array:
    phi = placed.azimuths
    points = placed.joint.leg_surface.points_j(phi, placed.joint.brace_radius)
    return transform_points(placed.T_w_j, points)


def _outlines_w(placed: PlacedJoint) -> list[Array]:
    """The tubes' ends and sides, each a line, shape (n, 3)."""
    joint, around = placed.joint, np.linspace(0, 2 * np.pi, 73)
    ring = np.column_stack((np.cos(around), np.sin(around)))
    along = joint.leg_surface.axis
    across = np.cross((0.0, 1.0, 0.0), along)
    lines = []
    for end in (-0.5, 0.5):
        leg = ring @ np.array((across, (0.0, 1.0, 0.0))) * joint.leg_radius
        lines.append(leg + end * joint.leg_length * along)
    brace = joint.brace_radius * np.column_stack((ring, 0 * around))
    lines.append(brace + np.array((0.0, 0.0, joint.brace_length)))
    lines += [np.array((lines[0][i], lines[1][i])) for i in (0, 18, 36, 54)]
    foot = placed.joint.leg_surface.points_j(around, joint.brace_radius)
    lines += [np.array((foot[i], lines[2][i])) for i in (0, 18, 36, 54)]
    return [transform_points(placed.T_w_j, line) for line in lines]
