"""Where cylinders about the brace's axis meet the leg: closed forms in frame j.

Azimuth ``phi`` runs counter-clockwise about the brace's axis, seen from above, from the heel
(the crown of a right-angled joint). ``rho`` and z are the coordinates of a point in the radial
half-plane of its azimuth; pairs of them, shape (n, 2), are called ``rz``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # its parts are loaded at first use
from numpy.typing import ArrayLike

from tjscan.core.frames import Array


def cylindrical_to_j(phi: ArrayLike, rho: ArrayLike, z: ArrayLike) -> Array:
    """Convert cylinder coordinates to points in frame j, shape (..., 3)."""
    x, y = np.multiply(rho, np.cos(phi)), np.multiply(rho, np.sin(phi))
    return np.stack(np.broadcast_arrays(x, y, np.asarray(z, dtype=float)), axis=-1)


def radial_direction(phi: ArrayLike) -> Array:
    """Unit vectors in frame j, shape (..., 3), square to the brace's axis, at an azimuth.

    They are the outward normals of the brace's wall.
    """
    return cylindrical_to_j(phi, 1.0, 0.0)


def tangential_direction(phi: ArrayLike) -> Array:
    """Unit vectors in frame j, shape (..., 3), along growing azimuth."""
    return radial_direction(np.add(phi, np.pi / 2))


@dataclass(frozen=True, slots=True)
class LegSurface:
    """Upper surface of a cylindrical leg, as the brace meets it.

    Parameters
    ----------
    radius : float
        Metres.
    angle : float
        Between the brace's and the leg's axis, in radians.

    Notes
    -----
    Arguments named ``rho`` must stay at or below `radius`. Wherever an azimuth is asked for,
    arrays broadcast.
    """

    radius: float
    angle: float

    @property
    def axis(self) -> Array:
        """The leg's axis in frame j, shape (3,), towards the heel."""
        return np.array((np.sin(self.angle), 0.0, np.cos(self.angle)))

    def offset_surface(self, distance: ArrayLike) -> LegSurface:
        """Surface at a distance outside this one, which may differ from azimuth to azimuth."""
        radius: Any = np.add(self.radius, distance)
        return LegSurface(radius, self.angle)

    def height(self, phi: ArrayLike, rho: ArrayLike) -> Array:
        """Z of the surface at an azimuth and a distance from the brace's axis."""
        x, y = np.multiply(rho, np.cos(phi)), np.multiply(rho, np.sin(phi))
        upward = np.sqrt(self.radius**2 - y**2)
        return np.asarray((x * np.cos(self.angle) + upward) / np.sin(self.angle))

    def points_j(self, phi: ArrayLike, rho: ArrayLike) -> Array:
        """Points of the surface in frame j, shape (..., 3), at azimuths and radii."""
        return cylindrical_to_j(phi, rho, self.height(phi, rho))

    def slope(self, phi: ArrayLike, rho: ArrayLike) -> Array:
        """Rise of the surface per distance from the brace's axis, in the radial half-plane."""
        y = np.multiply(rho, np.sin(phi))
        upward = np.sqrt(self.radius**2 - y**2)
        falling = y * np.sin(phi) / upward
        return np.asarray((np.cos(phi) * np.cos(self.angle) - falling) / np.sin(self.angle))

    def azimuth_derivative(self, phi: ArrayLike, rho: ArrayLike) -> Array:
        """Derivative of `points_j` by the azimuth, in frame j, shape (..., 3)."""
        x, y = np.multiply(rho, np.cos(phi)), np.multiply(rho, np.sin(phi))
        upward = np.sqrt(self.radius**2 - y**2)
        climb = -(y * np.cos(self.angle) + x * y / upward) / np.sin(self.angle)
        return np.stack(np.broadcast_arrays(-y, x, climb), axis=-1)

    def tangent(self, phi: ArrayLike, rho: ArrayLike) -> Array:
        """Unit tangents in frame j, shape (..., 3), of the curve at constant ``rho``."""
        v = self.azimuth_derivative(phi, rho)
        return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))

    def normal(self, points_j: Array) -> Array:
        """Outward unit normals in frame j, shape (..., 3), at or below points off the axis."""
        across = points_j - (points_j @ self.axis)[..., None] * self.axis
        return np.asarray(across / np.linalg.norm(across, axis=-1, keepdims=True))

    def signed_distances(self, points_j: Array) -> Array:
        """Distances of points, shape (..., 3), outside the surface, in metres."""
        across = points_j - (points_j @ self.axis)[..., None] * self.axis
        return np.asarray(np.linalg.norm(across, axis=-1) - self.radius)

    def dihedral_angle(self, phi: ArrayLike, rho: ArrayLike) -> Array:
        """Local dihedral angle psi between brace and leg, in radians.

        It is the angle, through the air outside, between the surface and the cylinder of
        radius ``rho`` about the brace's axis.
        """
        k = np.divide(rho, self.radius)
        s2 = np.sin(phi) ** 2
        # cos(psi) = cos(phi) cos(theta) sqrt(1 - k² sin²(phi)) - k sin²(phi)
        cosine = np.cos(phi) * np.cos(self.angle) * np.sqrt(1 - k**2 * s2) - k * s2
        return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))

    def ray_intersections(self, phi: ArrayLike, start_rz: Array, direction_rz: Array) -> Array:
        """First points where rays in the radial half-planes meet the surface from outside.

        Parameters
        ----------
        phi : array_like, shape (n,)
            Azimuths of the half-planes.
        start_rz, direction_rz : ndarray, shape (n, 2)
            Rays, as distance from the brace's axis and z.

        Returns
        -------
        ndarray, shape (n, 2)
            The points, NaN if a ray passes by.
        """
        # A point's two coordinates square to the leg's axis, y and up, are linear in rho and z.
        across = np.stack((np.sin(phi), -np.cos(phi) * np.cos(self.angle)), axis=-1)
        up = np.array((0.0, np.sin(self.angle)))
        p = across * start_rz[..., :1] + up * start_rz[..., 1:]
        d = across * direction_rz[..., :1] + up * direction_rz[..., 1:]
        a, b = np.sum(d * d, axis=-1), np.sum(p * d, axis=-1)
        c = np.sum(p * p, axis=-1) - self.radius**2
        discriminant = b * b - a * c
        root = np.sqrt(np.where(discriminant < 0, np.nan, discriminant))
        return np.asarray(start_rz + ((-b - root) / a)[..., None] * direction_rz)

    def arc_length(self, rho: float, start: float, stop: float) -> float:
        """Length in metres of the curve at constant ``rho`` between two azimuths."""
        length, _ = scipy.integrate.quad(
            lambda phi: np.linalg.norm(self.azimuth_derivative(phi, rho)), start, stop
        )
        return float(length)
