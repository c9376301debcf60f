"""Which points of a profile lie on the brace and on the leg, and a few that stand for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tjscan.frames import Array, transform
from tjscan.scanning.scan import Scan
from tjscan.tubes.walls import WallPoints

NODES: Final = 4
"""Per side: enough for its place and its tilt, which is all that a view's side tells."""

FROM_CORNER: Final = 1e-3
"""Metres that a side's points keep from its corner, where edges are never quite sharp."""

OFF_SIDE: Final = 0.2e-3
"""Metres off the fitted side beyond which a point is a reflection or flies."""

FEWEST: Final = 5
"""Points that a node needs."""

ALIKE: Final = 8
"""Neighbouring points whose noise is alike: an assumption about speckle on ground steel."""


def wall_points(looks: Sequence[Scan]) -> WallPoints:
    """Nodes on the walls as all views of a station saw them, in its base frame."""
    points, on_brace, sigma, view = [], [], [], []
    for number, look in enumerate(looks):
        for is_brace, (nodes_s, spread) in zip((True, False), side_nodes(look), strict=True):
            points.append(transform(look.view.T_b_s, nodes_s))
            on_brace.append(np.full(len(spread), is_brace))
            sigma.append(spread)
            view.append(np.full(len(spread), number))
    return WallPoints(
        np.concatenate(points),
        np.concatenate(on_brace),
        np.concatenate(sigma),
        np.concatenate(view),
        np.array([look.view.T_b_f[:3, 3] for look in looks]),
    )


def side_nodes(look: Scan) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Nodes of the brace's and of the leg's side: points (n, 3) in frame s, and their sigmas."""
    groove = look.groove
    p1, p2, _, p4, p5 = groove.points_s[:, [0, 2]]
    points = look.view.profile.points_s[:, [0, 2]]
    return (
        _nodes(points, p2, -groove.wall_s[[0, 2]], p1),
        _nodes(points, p4, groove.leg_s[[0, 2]], p5),
    )


def _nodes(points: Array, corner: Array, tangent: Array, end: Array) -> tuple[Array, Array]:
    """Nodes along a side that leaves its corner along a tangent and bends to its end."""
    normal = np.array((-tangent[1], tangent[0]))
    length, off = (end - corner) @ tangent, (end - corner) @ normal
    bend = off / length**2
    s, d = (points - corner) @ tangent, (points - corner) @ normal
    d = d - bend * s * s
    on = (s > FROM_CORNER) & (s <= length) & (np.abs(d) < OFF_SIDE)
    s, d = s[on], d[on]
    share = np.minimum((NODES * (s - FROM_CORNER) / (length - FROM_CORNER)).astype(int), NODES - 1)
    count = np.bincount(share, minlength=NODES)
    filled = count >= FEWEST
    if not filled.any():
        return np.empty((0, 3)), np.empty(0)
    per = np.maximum(count, 1)
    at = np.bincount(share, s, NODES) / per
    # Bins are averaged along the bend, not across it: the mean of a curve lies beside it.
    height = bend * at * at + np.bincount(share, d, NODES) / per
    noise = max(float(np.std(d)), 1e-6)
    nodes = corner + at[:, None] * tangent + height[:, None] * normal
    in_s = np.column_stack((nodes[:, 0], np.zeros(NODES), nodes[:, 1]))
    return in_s[filled], noise * np.sqrt(np.minimum(ALIKE / per, 1.0))[filled]
