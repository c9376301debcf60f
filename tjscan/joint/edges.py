"""The groove's sharp edges as dense closed polylines, and exact distances to them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy  # its parts are loaded at first use
from numpy.typing import ArrayLike, NDArray

from tjscan.core.frames import Array, frozen_arrays
from tjscan.joint.bevel import groove_sections
from tjscan.joint.definition import JointDefinition
from tjscan.joint.geometry import cylindrical_to_j

FEWEST_NEIGHBOURS = 4
"""Vertices that a first search looks at; it looks at more where these can't prove the result."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class ClosedPolyline:
    """A closed line through points.

    Parameters
    ----------
    points_j : ndarray, shape (n, 3)
        Its vertices in frame j, in metres; the last one is joined to the first.
    """

    points_j: Array
    _tree: scipy.spatial.KDTree = field(init=False, repr=False)
    _half: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        steps = np.roll(self.points_j, -1, axis=0) - self.points_j
        object.__setattr__(self, "_tree", scipy.spatial.KDTree(self.points_j))
        object.__setattr__(self, "_half", float(np.linalg.norm(steps, axis=1).max()) / 2)

    def nearest_points(self, points_j: Array) -> Array:
        """Nearest points of the line to points, shape (m, 3), in frame j, in metres."""
        points = np.asarray(points_j, dtype=float).reshape(-1, 3)
        feet = np.empty_like(points)
        open_ = np.arange(len(points))
        neighbours = FEWEST_NEIGHBOURS
        while open_.size:
            neighbours = min(neighbours, len(self.points_j))
            reach, vertices = self._tree.query(points[open_], k=np.arange(1, neighbours + 1))
            reach, vertices = np.asarray(reach), np.asarray(vertices)
            feet[open_], distance = self._on_segments_at(vertices, points[open_])
            # A closer foot on a segment away from these vertices would lie within half its
            # length of a vertex that is closer than the farthest of them.
            proven = reach[:, -1] ** 2 > distance**2 + self._half**2
            open_ = open_[~proven] if neighbours < len(self.points_j) else open_[:0]
            neighbours *= 8
        return feet

    def distances(self, points_j: Array) -> Array:
        """Distances of points, shape (m, 3), from the line in metres, shape (m,)."""
        points = np.asarray(points_j, dtype=float).reshape(-1, 3)
        return np.asarray(np.linalg.norm(points - self.nearest_points(points), axis=1))

    def _on_segments_at(self, vertices: NDArray[np.intp], points: Array) -> tuple[Array, Array]:
        """Nearest feet, and their distances, on the segments before and after vertices (m, k)."""
        starts = np.concatenate((vertices - 1, vertices), axis=1)
        a = self.points_j[starts]
        along = self.points_j[(starts + 1) % len(self.points_j)] - a
        offset = points[:, None] - a
        share = np.sum(offset * along, axis=2) / np.sum(along * along, axis=2)
        feet = a + np.clip(share, 0, 1)[..., None] * along
        distances = np.linalg.norm(points[:, None] - feet, axis=2)
        best = np.argmin(distances, axis=1)
        rows = np.arange(len(points))
        return feet[rows, best], distances[rows, best]


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class FeatureEdges:
    """The groove's three feature edges, along which the corners p2, p3 and p4 run (Fig. 3).

    Parameters
    ----------
    phi : ndarray, shape (n,)
        Azimuth of the vertices in radians, the same for the three.
    p2, p3, p4 : ClosedPolyline
        Top of the bevel, root corner on the bevel, root corner on the leg.
    tacks : ndarray, shape (k, 2)
        First and last azimuth of each tack weld, under which p3 and p4 lie buried, in radians.
    """

    phi: Array
    p2: ClosedPolyline
    p3: ClosedPolyline
    p4: ClosedPolyline
    tacks: Array = field(default_factory=lambda: np.empty((0, 2)))

    def on_tack(self, points_j: Array) -> NDArray[np.bool_]:
        """Whether points, shape (m, 3), lie at azimuths where a tack covers the root, (m,)."""
        return within_spans(self.tacks, np.arctan2(points_j[:, 1], points_j[:, 0]))

    def distances(self, points_j: Array) -> Array:
        """Distances of points, shape (m, 3), from p2, p3 and p4 in metres, shape (m, 3)."""
        edges = (self.p2, self.p3, self.p4)
        return np.column_stack([edge.distances(points_j) for edge in edges])

    def nearest_edge_distances(self, points_j: Array) -> Array:
        """Distances of points, shape (m, 3), from the nearest edge in metres, shape (m,)."""
        return np.asarray(self.distances(points_j).min(axis=1))


def feature_edges(definition: JointDefinition, n: int = 3600) -> FeatureEdges:
    """Compute the feature edges of a joint's groove, each with `n` vertices at even azimuths.

    At the default their chords leave the true edge by less than 0.001 mm.
    """
    phi = np.linspace(0, 2 * np.pi, n, endpoint=False)
    sections = groove_sections(definition, phi)
    corners = (sections.p2, sections.p3, sections.p4)
    p2, p3, p4 = (ClosedPolyline(cylindrical_to_j(phi, rz[:, 0], rz[:, 1])) for rz in corners)
    return FeatureEdges(phi, p2, p3, p4, tack_spans(definition))


def tack_spans(definition: JointDefinition) -> Array:
    """First and last azimuth of each tack in radians, shape (k, 2)."""
    spans = np.empty((len(definition.imperfections.tacks), 2))
    for i, tack in enumerate(definition.imperfections.tacks):
        at = np.array([tack.at])
        land = groove_sections(definition, at).land
        speed = float(np.linalg.norm(definition.leg_surface.azimuth_derivative(at, land[:, 0])))
        spans[i] = tack.at + 0.5 * tack.length / speed * np.array((-1, 1))
    return spans


def within_spans(spans: Array, phi: ArrayLike) -> NDArray[np.bool_]:
    """Whether azimuths lie in one of the spans that `tack_spans` gives, the shape of `phi`.

    Parameters
    ----------
    spans : ndarray, shape (k, 2)
        Radians.
    phi : array_like
        Radians; a turn more or less makes no difference.
    """
    phi = np.asarray(phi, dtype=float)
    covered = np.zeros(phi.shape, dtype=bool)
    for first, last in spans:
        covered |= np.mod(phi - first, 2 * np.pi) <= last - first
    return covered
