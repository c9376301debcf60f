"""Signed distances to a mesh: Open3D finds the triangle, double precision finds the distance."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from typing import Any, Final

import numpy as np

from tjscan.comparison.facets import INSIDE_TRIANGLE, IndexArray, MeshFacets
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array

POINTS_PER_CHUNK: Final = 32_768
"""Points at once: what they need then fits a processor's cache."""

PIECES_PER_TRIANGLE: Final = 2
"""Long triangles are cut until there are about this many times as many, for the search alone."""

FEWEST_PIECES: Final = 20_000

MOST_WALKS: Final = 200
"""Steps from triangle to triangle. A walk only ever goes downhill, so it ends by itself."""


class MeshDistance:
    """Computes signed distances of points to a mesh, and nearest points on it.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In metres, in any frame.
    triangles : ndarray of int, shape (m, 3)
        Corners, counter-clockwise seen from outside.

    Raises
    ------
    ConfigurationError
        If the mesh has no triangle with an area.

    Notes
    -----
    Open3D's scene computes in single precision. On triangles a thousand times longer than wide
    it was seen to err by 0.9 mm, and so to choose the wrong one. So coordinates are centred, long
    triangles are cut for the search, the distance from the chosen triangle is computed again in
    double precision, and from there the foot walks over edges and vertices until no neighbour
    is nearer.
    """

    def __init__(self, vertices: Array, triangles: IndexArray) -> None:
        o3d: Any = import_module("open3d")
        self.facets = MeshFacets(vertices, triangles)
        self._centre = (self.facets.vertices.min(axis=0) + self.facets.vertices.max(axis=0)) / 2
        pieces, self._whole = _cut(self.facets.corners)
        flat = np.ascontiguousarray(pieces.reshape(-1, 3) - self._centre, dtype=np.float32)
        self._scene: Any = o3d.t.geometry.RaycastingScene()
        index = np.arange(len(flat), dtype=np.uint32).reshape(-1, 3)
        self._scene.add_triangles(o3d.core.Tensor(flat), o3d.core.Tensor(index))

    @property
    def watertight(self) -> bool:
        """Whether the mesh is closed, so that the sign of every distance means something."""
        return self.facets.watertight

    def signed_distances(self, points: Array) -> Array:
        """Signed distances in metres of points, shape (k, 3), positive outside, shape (k,)."""
        return self._nearest(points)[0]

    def nearest_points_and_normals(self, points: Array) -> tuple[Array, Array]:
        """Nearest points on the mesh and the normals of their triangles, each (k, 3)."""
        _, ids = self._nearest(points)
        return self.facets.nearest_points(points, ids), self.facets.normals[ids]

    def _nearest(self, points: Array) -> tuple[Array, IndexArray]:
        o3d: Any = import_module("open3d")
        points = np.ascontiguousarray(points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise ConfigurationError("a distance needs finite points with three coordinates")
        if not len(points):
            return np.empty(0), np.empty(0, dtype=np.intp)
        order = _by_place(points)
        points = points[order]
        query = o3d.core.Tensor((points - self._centre).astype(np.float32))
        found = self._scene.compute_closest_points(query)["primitive_ids"].numpy()
        ids = self._whole[found]
        signed = np.empty(len(points))

        def refine(start: int) -> None:
            part = slice(start, start + POINTS_PER_CHUNK)
            signed[part], ids[part] = self._walk(points[part], ids[part])

        with ThreadPoolExecutor() as pool:
            list(pool.map(refine, range(0, len(points), POINTS_PER_CHUNK)))
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        return signed[back], ids[back]

    def _walk(self, points: Array, ids: IndexArray) -> tuple[Array, IndexArray]:
        """Go from triangle to triangle until no neighbour is nearer."""
        signed, feature = self.facets.paired_signed_distances(points, ids)
        open_ = np.flatnonzero(feature != INSIDE_TRIANGLE)
        for _ in range(MOST_WALKS):
            if not open_.size:
                break
            rows, near = self.facets.triangles_around_features(feature[open_])
            there, on = self.facets.paired_signed_distances(points[open_[rows]], near)
            # The nearest of each row comes first.
            order = np.lexsort((np.abs(there), rows))
            best = order[np.searchsorted(rows, np.arange(len(open_)))]
            better = np.abs(there[best]) < np.abs(signed[open_])
            open_, best = open_[better], best[better]
            signed[open_], feature[open_], ids[open_] = there[best], on[best], near[best]
            open_ = open_[feature[open_] != INSIDE_TRIANGLE]
        return signed, ids


def _by_place(points: Array) -> IndexArray:
    """An order in which points near each other in space come near each other: caches like it."""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    cell = (31 * (points - low) / np.where(size > 0, size, 1)).astype(np.uint16)
    return np.argsort(cell[:, 0] << 10 | cell[:, 1] << 5 | cell[:, 2], kind="stable")


def _cut(corners: Array) -> tuple[Array, IndexArray]:
    """Triangles, shape (k, 3, 3), cut at their longest edges, and the whole each is part of."""
    whole: IndexArray = np.arange(len(corners))
    most = max(PIECES_PER_TRIANGLE * len(corners), FEWEST_PIECES)
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    limit = float(longest.max())
    # A triangle of length L gives about (L / limit)² pieces if it is stout, L / limit if thin.
    while limit > 0 and np.maximum(1, 2 * longest / limit).sum() < most:
        limit /= 1.25
    while True:
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        k = edges.argmax(axis=1)
        long = np.flatnonzero(edges[np.arange(len(k)), k] > limit)
        if not long.size or len(corners) + len(long) > 2 * most:
            return corners, whole
        k = k[long]
        a, b, c = (corners[long, (k + i) % 3] for i in range(3))
        middle = (a + b) / 2
        halves = np.stack((np.stack((a, middle, c), 1), np.stack((middle, b, c), 1)))
        corners = np.concatenate((np.delete(corners, long, axis=0), *halves))
        whole = np.concatenate((np.delete(whole, long), whole[long], whole[long]))
