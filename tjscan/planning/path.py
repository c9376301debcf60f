"""Stations along the groove and the beads' lines through them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, cross, unit_vectors
from tjscan.planning.edges import EDGE_CORNER_NAMES, GrooveEdges
from tjscan.planning.template import BeadCells, SectionTemplate

LARGEST_CHORD_ERROR: Final = 0.1e-3
"""Metres between a bead's line and the chord of two stations, at most."""

LARGEST_KINK: Final = np.radians(2.0)
"""Angle between two chords that follow one another, at most."""

STEEL_CORNERS: Final = [EDGE_CORNER_NAMES.index(name) for name in ("p3", "p4", "p2")]

LONGEST_STATION_STEP: Final = 10e-3
"""Metres between two stations, at most."""


@dataclass(frozen=True, slots=True, eq=False)
class GrooveStations:
    """Sections of the smoothed groove at m lengths, square to it.

    The four corners are moved along the groove into one plane, so that an area there is what a bead
    lays down on its way.

    Parameters
    ----------
    s : ndarray, shape (m,)
        Lengths along the groove, metres.
    origin : ndarray, shape (m, 3)
        Middle of the corners.
    across, up : ndarray, shape (m, 3)
        Unit vectors in the plane: from bevel to leg, and out of the root.
    corners : ndarray, shape (m, 4, 2)
        p3, p4, g and p2 along these, from the origin.
    tangent : ndarray, shape (m, 3)
        Unit vector along the groove.
    """

    s: Array
    origin: Array
    across: Array
    up: Array
    corners: Array
    tangent: Array

    def at(self, rows: NDArray[np.intp], s: Array) -> GrooveStations:
        """Some of them, of a groove that closes a second time at other lengths s."""
        values = [getattr(self, f.name)[rows] for f in fields(self)]
        return GrooveStations(s, *values[1:])

    def part(self, first: int, last: int) -> GrooveStations:
        """Those from one to another, both included."""
        return GrooveStations(*(getattr(self, f.name)[first : last + 1] for f in fields(self)))

    def points_to_space(self, points: Array) -> Array:
        """Points of the planes, shape (m, ..., 2), in the frame of the sections, (m, ..., 3)."""
        extra = (slice(None), *(None,) * (points.ndim - 2))
        return np.asarray(self.origin[extra] + self.vectors_to_space(points))

    def vectors_to_space(self, vectors: Array) -> Array:
        """The same of vectors."""
        extra = (slice(None), *(None,) * (vectors.ndim - 2))
        return np.asarray(vectors[..., :1] * self.across[extra] + vectors[..., 1:] * self.up[extra])


def cut_groove_stations(edges: GrooveEdges, s: Array) -> GrooveStations:
    """Cut the smoothed groove at lengths, shape (m,), metres."""
    p = edges.corners(s)
    origin = p.mean(axis=1)
    # Of what is steel: g is moved until areas agree, and would turn the planes that they lie in.
    tangent = unit_vectors(edges.derivatives(s)[:, STEEL_CORNERS].mean(axis=1))
    up = p[:, 2] + p[:, 3] - p[:, 0] - p[:, 1]
    up = unit_vectors(up - np.sum(up * tangent, axis=1, keepdims=True) * tangent)
    across = cross(up, tangent)
    across = across * np.sign(np.sum(across * (p[:, 1] - p[:, 0]), axis=1, keepdims=True))
    away = p - origin[:, None]
    flat = np.stack([np.sum(away * axis[:, None], axis=2) for axis in (across, up)], axis=2)
    return GrooveStations(np.asarray(s), origin, across, up, flat, tangent)


def map_template_onto(
    stations: GrooveStations, cap_height: float, root_area: Array | float = 0.0
) -> SectionTemplate:
    """The template mapped onto stations.

    Parameters
    ----------
    stations : GrooveStations
        Of m lengths.
    cap_height, root_area : float, or ndarray of shape (m,)
        As of `SectionTemplate`.

    Raises
    ------
    ConfigurationError
        If the corners of one make no convex quadrilateral.
    """
    template = SectionTemplate(stations.corners, cap_height, root_area)
    if not template.sections_are_convex.all():
        at = 1e3 * float(stations.s[int(np.argmin(template.sections_are_convex))])
        raise ConfigurationError(
            f"at s = {at:.0f} mm p3, p4, g and p2 make no convex quadrilateral: layers can't be "
            "fanned between bevel and leg there",
            key="sections",
        )
    return template


def aim_points(cells: BeadCells) -> Array:
    """Where the wire aims for each bead: the middle of its lower side, shape (m, n, 2), metres."""
    quads = [cells.quadrilaterals(k) for k in range(len(cells.counts))]
    return np.concatenate([0.5 * (quad[:, :, 0] + quad[:, :, 1]) for quad in quads], axis=1)


def chord_error_and_kink(points: Array, middles: Array) -> tuple[float, float]:
    """Largest distance of lines from their chords, and largest angle between chords.

    Parameters
    ----------
    points : ndarray, shape (m, n, 3)
        Of n lines.
    middles : ndarray, shape (m - 1, n, 3)
        Halfway between them.

    Returns
    -------
    tuple of float
        Metres and radians.
    """
    chords = np.diff(points, axis=0)
    lengths = np.linalg.norm(chords, axis=2, keepdims=True)
    units = chords / lengths
    away = middles - points[:-1]
    off = away - np.sum(away * units, axis=2, keepdims=True) * units
    cosines = np.sum(units[1:] * units[:-1], axis=2)
    sines = np.linalg.norm(cross(units[1:], units[:-1]), axis=2)
    kinks = np.arctan2(sines, cosines)
    return float(np.linalg.norm(off, axis=2).max()), float(kinks.max(initial=0.0))


def bead_centroids(cells: BeadCells) -> Array:
    """Centre of area of each bead without its reinforcement, shape (m, n, 2), metres."""
    quads = np.concatenate([cells.quadrilaterals(k) for k in range(len(cells.counts))], axis=1)
    a, b, c, d = np.moveaxis(quads, 2, 0)
    halves = [
        0.5 * ((q - a)[..., 0] * (r - a)[..., 1] - (q - a)[..., 1] * (r - a)[..., 0])[..., None]
        for q, r in ((b, c), (c, d))
    ]
    middles = [(a + b + c) / 3, (a + c + d) / 3]
    return np.asarray((halves[0] * middles[0] + halves[1] * middles[1]) / (halves[0] + halves[1]))


class BeadLines:
    """Lines of n beads through m stations.

    A bead of cross-section a, whose centre moves by dc along the groove, fills a (dc · t), t being
    the groove's direction (Pappus); the wire's tip goes another way by dp meanwhile. What is laid
    down a metre of the tip's way is the ratio of both.

    Parameters
    ----------
    stations : GrooveStations
        At m lengths, two or more.
    cells : BeadCells
        The beads there.

    Attributes
    ----------
    aims : ndarray, shape (m, n, 3)
        Where the wire's tip goes, metres.
    along : ndarray, shape (m, n, 3)
        Derivative of that by the length along the groove.
    areas : ndarray, shape (m, n)
        Laid down a metre of the tip's way, m².
    """

    def __init__(self, stations: GrooveStations, cells: BeadCells) -> None:
        self.aims = stations.points_to_space(aim_points(cells))
        centres = stations.points_to_space(bead_centroids(cells))
        order: Literal[1, 2] = 2 if len(stations.s) > 2 else 1
        self.along = np.gradient(self.aims, stations.s, axis=0, edge_order=order)
        way = np.gradient(centres, stations.s, axis=0, edge_order=order)
        filled = np.sum(way * stations.tangent[:, None], axis=2)
        self.areas: Array = cells.areas * filled / np.linalg.norm(self.along, axis=2)
