"""Triangles in double precision: nearest points on them, and what they share with each other."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array

IndexArray = NDArray[np.intp]

INSIDE_TRIANGLE: Final = -1
"""The feature of a foot that lies inside its triangle."""


@dataclass(frozen=True, slots=True, eq=False)
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
    The normal of an edge is the sum of its triangles' normals, that of a vertex is weighted with
    their angles: with these the sign of a distance is right at edges and vertices too
    (Bærentzen and Aanæs 2005, doi:10.1109/TVCG.2005.49).
    """

    vertices: Array
    triangles: IndexArray
    corners: Array = field(init=False, repr=False)
    normals: Array = field(init=False, repr=False)
    features: IndexArray = field(init=False, repr=False)
    feature_normals: Array = field(init=False, repr=False)
    watertight: bool = field(init=False)
    _dual: Array = field(init=False, repr=False)
    _around: IndexArray = field(init=False, repr=False)
    _starts: IndexArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not np.isfinite(self.vertices).all():
            raise ConfigurationError("the mesh has vertices that are no finite points")
        vertices, place = np.unique(self.vertices, axis=0, return_inverse=True)
        triangles = place.reshape(-1)[self.triangles]
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
        weights = np.column_stack((_angles(corners), np.ones((len(corners), 3))))
        sums = np.zeros((total, 3))
        for axis in range(3):
            weighted = weights * normals[:, axis, None]
            sums[:, axis] = np.bincount(features.ravel(), weighted.ravel(), total)
        around = np.argsort(features.ravel(), kind="stable") // 6
        starts = np.concatenate(([0], np.bincount(features.ravel(), minlength=total).cumsum()))
        values = {
            "vertices": vertices,
            "triangles": triangles,
            "corners": corners,
            "normals": normals,
            "features": features,
            "feature_normals": sums,
            "watertight": bool((shared == 2).all()),
            "_dual": np.stack((dual_u, dual_v, normals), axis=2),
            "_around": around,
            "_starts": starts,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

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
            The corner or edge that each nearest point lies on; `INSIDE_TRIANGLE` inside a triangle.
        """
        offset = points - self.corners[ids, 0]
        u, v, signed = np.einsum("ki,kij->jk", offset, self._dual[ids], optimize=False)
        feature = np.full(len(points), INSIDE_TRIANGLE, dtype=np.intp)
        out = np.flatnonzero((u < 0) | (v < 0) | (u + v > 1))
        if out.size:
            away, feature[out] = self._to_edges(points[out], ids[out])
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
        out = np.flatnonzero(feature != INSIDE_TRIANGLE)
        if out.size:
            feet[out] = points[out] - self._to_edges(points[out], ids[out])[0]
        return np.asarray(feet)

    def triangles_around_features(self, features: IndexArray) -> tuple[IndexArray, IndexArray]:
        """Triangles around edges and vertices: row of `features` each belongs to, and its id."""
        first, count = self._starts[features], np.diff(self._starts)[features]
        rows = np.repeat(np.arange(len(features)), count)
        within = np.arange(len(rows)) - np.repeat(count.cumsum() - count, count)
        return rows, self._around[first[rows] + within]

    def _to_edges(self, points: Array, ids: IndexArray) -> tuple[Array, IndexArray]:
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
            feature[nearer] = self.features[ids[nearer], which[nearer]]
        return away, feature


def _angles(corners: Array) -> Array:
    """Angles of triangles at their corners, radians, shape (m, 3)."""
    before, after = np.roll(corners, 1, axis=1) - corners, np.roll(corners, -1, axis=1) - corners
    sine = np.linalg.norm(np.cross(after, before), axis=2)
    return np.asarray(np.arctan2(sine, np.sum(before * after, axis=2)))
