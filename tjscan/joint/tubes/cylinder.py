"""A tube's outer wall as a cylinder, and how far points lie outside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tjscan.core.frames import Array, frozen_arrays, readonly_copy, transform_points, unit_vector


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class Cylinder:
    """A cylinder of unlimited length.

    Parameters
    ----------
    point : ndarray, shape (3,)
        A point on its axis, amid the points that it was fitted to, metres.
    axis : ndarray, shape (3,)
        Unit vector along the axis.
    radius : float
        Metres.
    """

    point: Array
    axis: Array
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "axis", readonly_copy(unit_vector(np.asarray(self.axis, dtype=float)))
        )

    def signed_distances(self, points: Array) -> Array:
        """Distances of points, shape (..., 3), outside the cylinder, in metres."""
        return np.asarray(np.linalg.norm(self._across(points), axis=-1) - self.radius)

    def normals(self, points: Array) -> Array:
        """Outward unit normals, shape (..., 3), at or beside points off the axis."""
        across = self._across(points)
        return np.asarray(across / np.linalg.norm(across, axis=-1, keepdims=True))

    def transformed(self, T: Array) -> Cylinder:
        """The same cylinder in the outer frame of `T`, shape (4, 4)."""
        return Cylinder(transform_points(T, self.point), T[:3, :3] @ self.axis, self.radius)

    def recentred_beside(self, points: Array) -> Cylinder:
        """The same cylinder with its `point` beside the middle of points, shape (n, 3)."""
        along = (points.mean(axis=0) - self.point) @ self.axis
        return Cylinder(self.point + along * self.axis, self.axis, self.radius)

    def boxplus(self, step: Array) -> Cylinder:
        """A cylinder near this one, a small step away.

        Parameters
        ----------
        step : ndarray, shape (5,)
            Shift along two directions square to the axis (metres), tilt of the axis towards
            these (radians), growth of the radius (metres).
        """
        across = perpendicular_pair(self.axis)
        return Cylinder(
            self.point + step[:2] @ across, self.axis + step[2:4] @ across, self.radius + step[4]
        )

    def jacobian(self, points: Array) -> Array:
        """Derivatives of `distance` by `boxplus`'s numbers, shape (n, 5)."""
        sideways = self.normals(points) @ perpendicular_pair(self.axis).T
        along = (points - self.point) @ self.axis
        return -np.column_stack((sideways, along[:, None] * sideways, np.ones(len(points))))

    def _across(self, points: Array) -> Array:
        q = points - self.point
        return np.asarray(q - (q @ self.axis)[..., None] * self.axis)


def perpendicular_pair(axis: Array) -> Array:
    """Two unit vectors, rows of shape (2, 3), square to each other and to a unit vector."""
    first = unit_vector(np.cross(axis, np.eye(3)[np.abs(axis).argmin()]))
    return np.array((first, np.cross(axis, first)))
