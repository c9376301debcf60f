"""What each bead lays down a metre of the way of the wire's tip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tjscan.core.frames import Array
from tjscan.planning.path import GrooveStations, aim_points, centroids
from tjscan.planning.template import BeadCells


@dataclass(frozen=True, slots=True, eq=False)
class BeadLines:
    """Lines of n beads through m stations.

    Parameters
    ----------
    aims : ndarray, shape (m, n, 3)
        Where the wire's tip goes, metres.
    along : ndarray, shape (m, n, 3)
        Derivative of that by the length along the groove.
    areas : ndarray, shape (m, n)
        Laid down a metre of the tip's way, m².
    """

    aims: Array
    along: Array
    areas: Array


def bead_lines(stations: GrooveStations, cells: BeadCells) -> BeadLines:
    """Follow the beads of sections.

    A bead of cross-section a, whose centre moves by dc along the groove, fills a (dc · t), t being
    the groove's direction (Pappus); the wire's tip goes another way by dp meanwhile. What is laid
    down a metre of the tip's way is the ratio of both.

    Parameters
    ----------
    stations : GrooveStations
        At m lengths, two or more.
    cells : BeadCells
        The beads there.
    """
    aims, centres = stations.to_space(aim_points(cells)), stations.to_space(centroids(cells))
    order: Literal[1, 2] = 2 if len(stations.s) > 2 else 1
    along = np.gradient(aims, stations.s, axis=0, edge_order=order)
    way = np.gradient(centres, stations.s, axis=0, edge_order=order)
    filled = np.sum(way * stations.tangent[:, None], axis=2)
    return BeadLines(aims, along, cells.areas * filled / np.linalg.norm(along, axis=2))
