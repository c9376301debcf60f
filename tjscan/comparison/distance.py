"""Distances from what was measured to what was designed, and their statistics.

Signed distances to a mesh: Open3D finds the triangle, double precision finds the distance.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, Mask, array_dataclass
from tjscan.joint.edges import FeatureEdges


@dataclass(frozen=True, slots=True)
class DistanceStatistics:
    """Statistics of distances (mean, median, rms, percentile, largest), in millimetres.

    Parameters
    ----------
    mean, median : float
        With their signs, if the distances have one.
    rms : float
        Root of the mean square.
    p95, max : float
        95th percentile and largest, of absolute distances.
    """

    mean: float
    p95: float
    max: float
    rms: float
    median: float

    @classmethod
    def from_distances(cls, distances: Array) -> Self:
        """Statistics of raw distances in metres, any shape; NaN is none."""
        mm = 1e3 * distances[~np.isnan(distances)]
        size = np.abs(mm)
        rms = np.sqrt(np.mean(mm * mm))
        found = mm.mean(), np.percentile(size, 95), size.max(), rms, np.median(mm)
        return cls(*map(float, found))


@array_dataclass
class DeviationDistances:
    """Distances of one kind between what was measured and its reference.

    Parameters
    ----------
    kind : str
        ``cloud to mesh``, ``cloud to cloud``, ``corners to feature edges`` or ``corners to
        reference cloud``.
    meaning : str
        What the distances are.
    signed : bool
        Whether they are positive outside and negative inside; else they are never negative.
    points : ndarray, shape (n, 3)
        What was measured, in the reference's frame, metres.
    distances : ndarray, shape (n,)
        Metres.
    tolerance : float or None
        Metres.
    """

    kind: str
    meaning: str
    signed: bool
    points: Array
    distances: Array
    tolerance: float | None = None

    @property
    def known(self) -> Array:
        """Distances that are known, shape (k,), metres: a corner that is absent has none."""
        return self.distances[~np.isnan(self.distances)]

    @property
    def within(self) -> float | None:
        """Share of absolute distances within the tolerance; None if there is none."""
        if self.tolerance is None:
            return None
        return float(np.mean(np.abs(self.known) <= self.tolerance))

    @property
    def statistics(self) -> DistanceStatistics:
        """Their statistics, in millimetres."""
        return DistanceStatistics.from_distances(self.distances)


def corner_to_edge_distances(
    points_j: Array, edges: FeatureEdges, absent: Mask | None = None
) -> Array:
    """Distances of measured corners from the joint's feature edges.

    Parameters
    ----------
    points_j : ndarray, shape (n, 5, 3)
        The five points of each section in frame j, metres.
    edges : FeatureEdges
        The joint's edges.
    absent : ndarray of bool, shape (n, 3), optional
        Which of p2, p3 and p4 were not seen: they are compared with nothing.

    Returns
    -------
    ndarray, shape (n, 3)
        Distances of p2, p3 and p4, each from its own edge, metres; NaN for p3 and p4 where a
        tack weld buries them, and for corners that are absent.
    """
    lines = (edges.p2, edges.p3, edges.p4)
    errors = [line.distances(points_j[:, i]) for i, line in enumerate(lines, start=1)]
    for i in (1, 2):
        errors[i] = np.where(edges.on_tack(points_j[:, i + 1]), np.nan, errors[i])
    found = np.column_stack(errors)
    return found if absent is None else np.where(absent, np.nan, found)


def distances_to_cloud(points: Array, reference: Array) -> Array:
    """Unsigned distances of points from the nearest points of a cloud, shape (n,), metres.

    They never go below the noise and the spacing of the cloud.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Metres.
    reference : ndarray, shape (m, 3)
        The cloud, metres.
    """
    return np.asarray(KDTree(reference).query(points)[0])


def median_point_spacing(points: Array) -> float:
    """Median distance of a cloud's points, shape (n, 3), from their nearest neighbours."""
    if len(points) < 2:
        return float("nan")
    chosen = points[:: max(1, len(points) // 20_000)]
    return float(np.median(np.asarray(KDTree(points).query(chosen, k=[2])[0])))


IndexArray = NDArray[np.intp]

INSIDE_TRIANGLE_FEATURE: Final = -1
"""The feature of a foot that is inside its triangle."""


class MeshFacets:
    """Triangles of a mesh with their normals, edges and vertices.

    Equal vertices are made one, triangles without an area are left out.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In metres, in any frame.
    triangles : ndarray of int, shape (m, 3)
        Corners, counter-clockwise seen from outside.

    Raises
    ------
    ConfigurationError
        If no triangle has an area, or a vertex is not finite.

    Notes
    -----
    The normal of an edge is the sum of its triangles' normals, a vertex's is weighted with
    their angles: with these the sign of a distance is right at edges and vertices too
    (Bærentzen and Aanæs 2005, doi:10.1109/TVCG.2005.49).
    """

    def __init__(self, vertices: Array, triangles: IndexArray) -> None:
        if not np.isfinite(vertices).all():
            raise ConfigurationError("the mesh has vertices that are no finite points")
        vertices, place = np.unique(vertices, axis=0, return_inverse=True)
        triangles = place.reshape(-1)[triangles]
        corners = vertices[triangles]
        ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        across = np.cross(ab, ac)
        double_area = np.linalg.norm(across, axis=1)
        real = double_area > 0
        if not real.any():
            raise ConfigurationError("the mesh has no triangle with an area")
        triangles, corners, ab, ac = triangles[real], corners[real], ab[real], ac[real]
        normals = across[real] / double_area[real, None]
        # u and v of a point a + u ab + v ac are its products with these two.
        dual_u = np.cross(ac, normals) / double_area[real, None]
        dual_v = np.cross(normals, ab) / double_area[real, None]
        pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        # One number per pair: sorting numbers is faster than sorting rows.
        keys = pairs[:, 0] * len(vertices) + pairs[:, 1]
        _, edges, shared = np.unique(keys, return_inverse=True, return_counts=True)
        features = np.column_stack((triangles, len(vertices) + edges.reshape(-1, 3)))
        total = len(vertices) + len(shared)
        weights = np.column_stack((_corner_angles(corners), np.ones((len(corners), 3))))
        sums = np.zeros((total, 3))
        for axis in range(3):
            weighted = weights * normals[:, axis, None]
            sums[:, axis] = np.bincount(features.ravel(), weighted.ravel(), total)
        around = np.argsort(features.ravel(), kind="stable") // 6
        starts = np.concatenate(([0], np.bincount(features.ravel(), minlength=total).cumsum()))
        self.vertices, self.corners, self.normals = vertices, corners, normals
        self.feature_normals = sums
        self.watertight = bool((shared == 2).all())
        self._features, self._around, self._starts = features, around, starts
        self._dual = np.stack((dual_u, dual_v, normals), axis=2)

    def paired_signed_distances(self, points: Array, ids: IndexArray) -> tuple[Array, IndexArray]:
        """Signed distances of points from one triangle each.

        Parameters
        ----------
        points : ndarray, shape (k, 3)
            Metres.
        ids : ndarray of int, shape (k,)
            One triangle for each point.

        Returns
        -------
        distance : ndarray, shape (k,)
            Metres, positive on the side of the triangle's normal.
        feature : ndarray of int, shape (k,)
            The corner or edge that each nearest point lies on; `INSIDE_TRIANGLE_FEATURE` if none.
        """
        offset = points - self.corners[ids, 0]
        u, v, signed = np.einsum("ki,kij->jk", offset, self._dual[ids], optimize=False)
        feature = np.full(len(points), INSIDE_TRIANGLE_FEATURE, dtype=np.intp)
        out = np.flatnonzero((u < 0) | (v < 0) | (u + v > 1))
        if out.size:
            away, feature[out] = self._vectors_from_rims(points[out], ids[out])
            outward = np.sum(away * self.feature_normals[feature[out]], axis=1)
            signed[out] = np.where(outward < 0, -1, 1) * np.linalg.norm(away, axis=1)
        return signed, feature

    def nearest_points(self, points: Array, ids: IndexArray) -> Array:
        """Nearest points on one triangle each, shape (k, 3).

        Parameters
        ----------
        points : ndarray, shape (k, 3)
            Metres.
        ids : ndarray of int, shape (k,)
            One triangle for each point.
        """
        signed, feature = self.paired_signed_distances(points, ids)
        feet = points - signed[:, None] * self.normals[ids]
        out = np.flatnonzero(feature != INSIDE_TRIANGLE_FEATURE)
        if out.size:
            feet[out] = points[out] - self._vectors_from_rims(points[out], ids[out])[0]
        return np.asarray(feet)

    def triangles_around_features(self, features: IndexArray) -> tuple[IndexArray, IndexArray]:
        """Triangles around edges and vertices: row of `features` each belongs to, and its id."""
        first, count = self._starts[features], np.diff(self._starts)[features]
        rows = np.repeat(np.arange(len(features)), count)
        within = np.arange(len(rows)) - np.repeat(count.cumsum() - count, count)
        return rows, self._around[first[rows] + within]

    def _vectors_from_rims(self, points: Array, ids: IndexArray) -> tuple[Array, IndexArray]:
        """Vectors to points from the rims of triangles, and the features where they start."""
        corners = self.corners[ids]
        best = np.full(len(points), np.inf)
        away, feature = np.empty_like(points), np.empty(len(points), dtype=np.intp)
        for i in range(3):
            a = corners[:, i]
            along, offset = corners[:, (i + 1) % 3] - a, points - a
            share = np.sum(offset * along, axis=1) / np.sum(along * along, axis=1)
            vector = offset - np.clip(share, 0, 1)[:, None] * along
            squared = np.sum(vector * vector, axis=1)
            which = np.where(share <= 0, i, np.where(share >= 1, (i + 1) % 3, 3 + i))
            nearer = squared < best
            best[nearer], away[nearer] = squared[nearer], vector[nearer]
            feature[nearer] = self._features[ids[nearer], which[nearer]]
        return away, feature


def _corner_angles(corners: Array) -> Array:
    """Angles of triangles at their corners, radians, shape (m, 3)."""
    before, after = np.roll(corners, 1, axis=1) - corners, np.roll(corners, -1, axis=1) - corners
    sine = np.linalg.norm(np.cross(after, before), axis=2)
    return np.asarray(np.arctan2(sine, np.sum(before * after, axis=2)))


POINTS_PER_CHUNK: Final = 32_768
"""Points at once: what they need then fits a processor's cache."""

PIECES_PER_TRIANGLE: Final = 2
"""Long triangles are cut until there are about this many times as many, for the search alone."""

FEWEST_MESH_PIECES: Final = 20_000

MOST_WALK_STEPS: Final = 200
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
        pieces, self._whole = _cut_long_triangles(self.facets.corners)
        flat = np.ascontiguousarray(pieces.reshape(-1, 3) - self._centre, dtype=np.float32)
        self._scene: Any = o3d.t.geometry.RaycastingScene()
        index = np.arange(len(flat), dtype=np.uint32).reshape(-1, 3)
        self._scene.add_triangles(o3d.core.Tensor(flat), o3d.core.Tensor(index))

    def signed_distances(self, points: Array) -> Array:
        """Signed distances in metres of points, shape (k, 3), positive outside, shape (k,)."""
        return self._nearest_triangles(points)[0]

    def nearest_points_and_normals(self, points: Array) -> tuple[Array, Array]:
        """Nearest points on the mesh and the normals of their triangles, each (k, 3)."""
        _, ids = self._nearest_triangles(points)
        return self.facets.nearest_points(points, ids), self.facets.normals[ids]

    def _nearest_triangles(self, points: Array) -> tuple[Array, IndexArray]:
        o3d: Any = import_module("open3d")
        points = np.ascontiguousarray(points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise ConfigurationError("a distance needs finite points with three coordinates")
        if not len(points):
            return np.empty(0), np.empty(0, dtype=np.intp)
        order = _order_by_place(points)
        points = points[order]
        query = o3d.core.Tensor((points - self._centre).astype(np.float32))
        found = self._scene.compute_closest_points(query)["primitive_ids"].numpy()
        ids = self._whole[found]
        signed = np.empty(len(points))

        def refine(start: int) -> None:
            part = slice(start, start + POINTS_PER_CHUNK)
            signed[part], ids[part] = self._walk_downhill(points[part], ids[part])

        with ThreadPoolExecutor() as pool:
            list(pool.map(refine, range(0, len(points), POINTS_PER_CHUNK)))
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        return signed[back], ids[back]

    def _walk_downhill(self, points: Array, ids: IndexArray) -> tuple[Array, IndexArray]:
        """Go from triangle to triangle until no neighbour is nearer."""
        signed, feature = self.facets.paired_signed_distances(points, ids)
        open_ = np.flatnonzero(feature != INSIDE_TRIANGLE_FEATURE)
        for _ in range(MOST_WALK_STEPS):
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
            open_ = open_[feature[open_] != INSIDE_TRIANGLE_FEATURE]
        return signed, ids


def _order_by_place(points: Array) -> IndexArray:
    """An order in which points near each other in space come near each other: caches like it."""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    cell = (31 * (points - low) / np.where(size > 0, size, 1)).astype(np.uint16)
    return np.argsort(cell[:, 0] << 10 | cell[:, 1] << 5 | cell[:, 2], kind="stable")


def _cut_long_triangles(corners: Array) -> tuple[Array, IndexArray]:
    """Triangles, shape (k, 3, 3), cut at their longest edges, and the whole each is part of."""
    whole: IndexArray = np.arange(len(corners))
    most = max(PIECES_PER_TRIANGLE * len(corners), FEWEST_MESH_PIECES)
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
