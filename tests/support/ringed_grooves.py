"""Corners of grooves that run along curves in space, for the planner's tests."""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array
from tjscan.planning.edges import GrooveEdges, fit_edges_to_corners


def corners_along_arc(
    section: Array,
    radius: float = 0.25,
    turn: float = 2 * np.pi,
    count: int = 40,
    growth: float = 0.0,
) -> Array:
    """p3, p4, g and p2, shape (count, 4, 3), of a groove around an upright tube, metres.

    Parameters
    ----------
    section : ndarray, shape (4, 2)
        From bevel to leg, and out of the root: away from the axis, and up.
    radius : float
        Of p3's line.
    turn : float
        How far round; a whole turn closes.
    count : int
        Of sections.
    growth : float
        Share by which the section is larger half way round than at the start.
    """
    phi = np.linspace(0, turn, count, endpoint=turn < 2 * np.pi - 1e-9)
    size = 1 + growth * 0.5 * (1 - np.cos(phi))
    out = radius + size[:, None] * section[:, 0]
    up = size[:, None] * section[:, 1]
    return np.stack((out * np.cos(phi)[:, None], out * np.sin(phi)[:, None], up), axis=2)


def edges_of(corners: Array, sigma: float = 0.0, longest_step: float = 0.2) -> GrooveEdges:
    """Edges through corners, each known to `sigma` metres."""
    n = len(corners)
    return fit_edges_to_corners(corners, np.full((n, 4), sigma), np.zeros(n), longest_step)
