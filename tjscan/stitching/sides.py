"""Which points of a profile lie on the brace and on the leg, and a few that represent them."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.polynomial import Polynomial

from tjscan.core.frames import Array, transform_points
from tjscan.joint.tubes.fit import WallPoints
from tjscan.scanning.section import ScannedSection, Sections
from tjscan.uncertainty.causes import ViewCause

NODES_PER_SIDE: Final = 4
"""Per side: enough for its place and its tilt, which is all that a view's side shows."""

FROM_CORNER: Final = 1e-3
"""Metres that a side's points keep from its corner, where edges are never quite sharp."""

OFF_SIDE: Final = 0.2e-3
"""Metres off the fitted side beyond which a point is a reflection or flies."""

FAR_OFF_SIDE: Final = 1e-3
"""The same off a parabola from the corner to the side's end, which a side follows roughly."""

SIDE_DEGREE: Final = 4
"""Of the polynomial that a side is: a cut through a tube, a few centimetres long."""

BINS_PER_SIDE: Final = 8
FEWEST_POINTS: Final = 5
"""Points that a bin or a node needs."""

LEAST_NOISE: Final = 1e-6
"""Metres that no point is taken for more certain than."""

CORRELATED_POINTS: Final = 8
"""Neighbouring points whose noise is alike: an assumption about speckle on ground steel."""


def wall_points_of_views(sections: Sections) -> WallPoints:
    """Points on the walls of brace and leg as all views of a station saw them.

    Parameters
    ----------
    sections : sequence of ScannedSection
        One for each view of the station.

    Returns
    -------
    WallPoints
        In the station's base frame.
    """
    sides = []
    for number, section in enumerate(sections):
        for is_brace, (nodes_s, sigma) in zip((True, False), side_nodes(section), strict=True):
            nodes_b, n = transform_points(section.view.T_b_s, nodes_s), len(sigma)
            sides.append((nodes_b, np.full(n, is_brace), sigma, np.full(n, number)))
    pivots = np.array([section.view.T_b_f[:3, 3] for section in sections])
    points, on_brace, sigma, view = (np.concatenate(column) for column in zip(*sides, strict=True))
    return WallPoints(points, on_brace, sigma, view, pivots)


def moves_of_walls(walls: WallPoints, sections: Sections, cause: ViewCause) -> Array:
    """How wall points move with a cause of error, in the station's base frame.

    Parameters
    ----------
    walls : WallPoints
        As `wall_points_of_views` gives them.
    sections : sequence of ScannedSection
        That they were seen in.
    cause : ViewCause
        Of these views.

    Returns
    -------
    ndarray, shape (n, 3, m)
        Metres, by each draw of the cause.
    """
    T_b_s = np.array([section.view.T_b_s for section in sections])[walls.view]
    in_s = np.einsum("kji,kj->ki", T_b_s[:, :3, :3], walls.points - T_b_s[:, :3, 3])
    along = np.gradient(in_s.reshape(-1, NODES_PER_SIDE, 3), axis=1, edge_order=2).reshape(-1, 3)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return cause.moves_of_points(walls.view, T_b_s, in_s, along)


def side_nodes(section: ScannedSection) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Mean points (nodes) along the brace's and the leg's side of a profile.

    A node is the average of the points about it, taken along the curve that the side follows.

    Parameters
    ----------
    section : ScannedSection
        A view, and the groove that was read in it: its sides begin at p2 and p4 and end at p1
        and p5.

    Returns
    -------
    brace, leg : tuple of ndarray, shapes (n, 3) and (n,)
        Nodes in frame s (metres) and the standard deviation of each across its side (metres).
        Both are empty if a side has too few points; else n is `NODES_PER_SIDE`.
    """
    groove = section.groove
    p1, p2, _, p4, p5 = groove.points_s[:, [0, 2]]
    points = section.view.profile.points_s[:, [0, 2]]
    return (
        _nodes_of_side(points, p2, -groove.wall_s[[0, 2]], p1),
        _nodes_of_side(points, p4, groove.leg_s[[0, 2]], p5),
    )


def _nodes_of_side(points: Array, corner: Array, tangent: Array, end: Array) -> tuple[Array, Array]:
    """Nodes along a side that leaves its corner along a tangent and bends to its end."""
    normal = np.array((-tangent[1], tangent[0]))
    length, off = (end - corner) @ tangent, (end - corner) @ normal
    s, d = (points - corner) @ tangent, (points - corner) @ normal
    on = (s > FROM_CORNER) & (s <= length) & (np.abs(d - off * (s / length) ** 2) < FAR_OFF_SIDE)
    s, d = s[on], d[on]
    bins = (BINS_PER_SIDE * (s - FROM_CORNER) / (length - FROM_CORNER)).astype(int)
    share = np.minimum(bins, BINS_PER_SIDE - 1)
    filled = [chosen for k in range(BINS_PER_SIDE) if (chosen := share == k).sum() >= FEWEST_POINTS]
    if len(filled) <= SIDE_DEGREE + 1:
        return np.empty((0, 3)), np.empty(0)
    # Medians first: they take no notice of reflections. Then all points beside their curve.
    medians = np.array([(np.median(s[k]), np.median(d[k])) for k in filled])
    rough = _side_curve(medians[:, 0], medians[:, 1], float(length))
    on = np.abs(d - rough(s)) < OFF_SIDE
    s, d, share = s[on], d[on], share[on] * NODES_PER_SIDE // BINS_PER_SIDE
    count = np.bincount(share, minlength=NODES_PER_SIDE)
    if (count < FEWEST_POINTS).any():
        return np.empty((0, 3)), np.empty(0)
    curve = _side_curve(s, d, float(length))
    # Averaged along the curve, not across it: the mean of a bent line lies beside it.
    at = np.bincount(share, s, NODES_PER_SIDE) / count
    height = curve(at) + np.bincount(share, d - curve(s), NODES_PER_SIDE) / count
    noise = max(float(np.std(d - curve(s))), LEAST_NOISE)
    nodes = corner + at[:, None] * tangent + height[:, None] * normal
    in_s = np.column_stack((nodes[:, 0], np.zeros(NODES_PER_SIDE), nodes[:, 1]))
    return in_s, noise * np.sqrt(np.minimum(CORRELATED_POINTS / count, 1.0))


def _side_curve(s: Array, d: Array, length: float) -> Polynomial:
    """Least-squares polynomial of heights along a side."""
    return Polynomial.fit(s, d, SIDE_DEGREE, domain=(0.0, length))
