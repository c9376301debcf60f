"""Where cylinders about the brace's axis meet the leg: closed forms in frame j.

Azimuth ``phi`` runs counter-clockwise about the brace's axis, seen from above, from the heel
(the crown of a right-angled joint). ``rho`` and z are the coordinates of a point in the radial
half-plane of its azimuth; pairs of them, shape (n, 2), are called ``rz``.

Legs out of round have an elliptic section of the round one's circumference.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import scipy  # its parts are loaded at first use
from numpy.typing import ArrayLike
from scipy.special import ellipe

from tjscan.core.frames import Array, unit_vectors


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
        upward = self._height_over_axis(y)
        return np.asarray((x * np.cos(self.angle) + upward) / np.sin(self.angle))

    def points_j(self, phi: ArrayLike, rho: ArrayLike) -> Array:
        """Points of the surface in frame j, shape (..., 3), at azimuths and radii."""
        return cylindrical_to_j(phi, rho, self.height(phi, rho))

    def slope(self, phi: ArrayLike, rho: ArrayLike) -> Array:
        """Rise of the surface per distance from the brace's axis, in the radial half-plane."""
        falling = self._fall_along(np.multiply(rho, np.sin(phi)), np.sin(phi))
        return np.asarray((np.cos(phi) * np.cos(self.angle) - falling) / np.sin(self.angle))

    def azimuth_derivative(self, phi: ArrayLike, rho: ArrayLike) -> Array:
        """Derivative of `points_j` by the azimuth, in frame j, shape (..., 3)."""
        x, y = np.multiply(rho, np.cos(phi)), np.multiply(rho, np.sin(phi))
        climb = -(y * np.cos(self.angle) + self._fall_along(y, x)) / np.sin(self.angle)
        return np.stack(np.broadcast_arrays(-y, x, climb), axis=-1)

    def _height_over_axis(self, y: Array) -> Array:
        """Height of the surface over the leg's axis at y."""
        return np.asarray(np.sqrt(self.radius**2 - y**2))

    def _fall_along(self, y: Array, way: Array) -> Array:
        """How far the surface falls, by its slope at y, over a way along y."""
        return np.asarray(y * way / self._height_over_axis(y))

    def tangent(self, phi: ArrayLike, rho: ArrayLike) -> Array:
        """Unit tangents in frame j, shape (..., 3), of the curve at constant ``rho``."""
        return unit_vectors(self.azimuth_derivative(phi, rho))

    def normal(self, points_j: Array) -> Array:
        """Outward unit normals in frame j, shape (..., 3), at or below points off the axis."""
        return unit_vectors(points_j - (points_j @ self.axis)[..., None] * self.axis)

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
        # A point's two coordinates square to the leg's axis, up and y, are linear in rho and z.
        across = np.stack((-np.cos(phi) * np.cos(self.angle), np.sin(phi)), axis=-1)
        up = np.array((np.sin(self.angle), 0.0))
        p = across * start_rz[..., :1] + up * start_rz[..., 1:]
        d = across * direction_rz[..., :1] + up * direction_rz[..., 1:]
        a, b, c = self._quadratic_along_ray(p, d)
        discriminant = b * b - a * c
        root = np.sqrt(np.where(discriminant < 0, np.nan, discriminant))
        return np.asarray(start_rz + ((-b - root) / a)[..., None] * direction_rz)

    def _quadratic_along_ray(self, p: Array, d: Array) -> tuple[Array, Array, Array]:
        """Coefficients of ``a t² + 2 b t + c``, zero where p + t d, up and y, is on the surface."""
        a, b = np.sum(d * d, axis=-1), np.sum(p * d, axis=-1)
        return a, b, np.sum(p * p, axis=-1) - self.radius**2

    def arc_length(self, rho: float, start: float, stop: float) -> float:
        """Length in metres of the curve at constant ``rho`` between two azimuths."""
        length, _ = scipy.integrate.quad(
            lambda phi: np.linalg.norm(self.azimuth_derivative(phi, rho)), start, stop
        )
        return float(length)


DIAMETER_CORRECTION_ROUNDS = 8
"""Corrections of the mean diameter; each is smaller by the ovality squared."""


def semi_axes_same_circumference(radius: float, ovality: float) -> tuple[float, float]:
    """Semi-axes of the ellipse with a circle's circumference, in metres.

    Parameters
    ----------
    radius : float
        Of the circle.
    ovality : float
        Largest minus smallest diameter, over the circle's diameter.
    """
    difference, total = ovality * radius, 2 * radius
    for _ in range(DIAMETER_CORRECTION_ROUNDS):
        long, short = (total + difference) / 2, (total - difference) / 2
        total *= 2 * np.pi * radius / (4 * long * ellipe(1 - (short / long) ** 2))
    return float((total + difference) / 2), float((total - difference) / 2)


@dataclass(frozen=True, slots=True)
class Ellipse:
    """An ellipse about the origin of a plane.

    Parameters
    ----------
    long, short : float
        Semi-axes, in metres; arrays broadcast.
    widest : float
        Angle of the long one from the first axis of the plane, in radians.
    """

    long: ArrayLike
    short: ArrayLike
    widest: float

    def quadratic_coefficients(self) -> tuple[Array, Array, Array]:
        """Coefficients A, B and C of ``A u² + 2 B u v + C v² = 1``, in 1/m²."""
        a, b = np.divide(1, np.square(self.long)), np.divide(1, np.square(self.short))
        c, s = np.cos(self.widest), np.sin(self.widest)
        return a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c

    def radius_in_direction(self, direction: ArrayLike, centre: Array | None = None) -> Array:
        """Distance from the origin to the ellipse in directions, in metres.

        Parameters
        ----------
        direction : array_like, shape (n,)
            Angles from the first axis, in radians.
        centre : ndarray, shape (n, 2), optional
            Of the ellipse; the origin is inside.
        """
        A, B, C = self.quadratic_coefficients()
        u, v = np.cos(direction), np.sin(direction)
        p = np.zeros((1, 2)) if centre is None else centre
        # (ρ d - p)ᵀ Q (ρ d - p) = 1
        square = A * u * u + 2 * B * u * v + C * v * v
        across = p[:, 0] * (A * u + B * v) + p[:, 1] * (B * u + C * v)
        rest = A * p[:, 0] ** 2 + 2 * B * p[:, 0] * p[:, 1] + C * p[:, 1] ** 2 - 1
        return np.asarray((across + np.sqrt(across**2 - square * rest)) / square)


@dataclass(frozen=True, slots=True)
class OvalLegSurface(LegSurface):
    """The upper side of an elliptic leg.

    Parameters
    ----------
    section : Ellipse
        In the plane square to the leg's axis: the first axis up, the second along y.

    Notes
    -----
    `radius` is the round tube's. The dihedral angle stays the round tube's: the brace's
    end is prepared by the drawing. A surface at a distance is taken as the ellipse with longer
    semi-axes, which differs from the parallel curve by the ovality squared of that distance.
    """

    section: Ellipse

    @classmethod
    def from_ovality(cls, radius: float, angle: float, ovality: float, widest: float) -> Self:
        """The surface of a leg with an ovality, its widest diameter at a clock angle."""
        return cls(radius, angle, Ellipse(*semi_axes_same_circumference(radius, ovality), widest))

    def offset_surface(self, distance: ArrayLike) -> Self:
        """Surface at a distance outside this one."""
        s = self.section
        wider = replace(s, long=np.add(s.long, distance), short=np.add(s.short, distance))
        radius: Any = np.add(self.radius, distance)
        return replace(self, radius=radius, section=wider)

    def _height_over_axis(self, y: Array) -> Array:
        A, B, C = self.section.quadratic_coefficients()
        return np.asarray((-B * y + np.sqrt(np.square(B * y) - A * (C * y * y - 1))) / A)

    def _fall_along(self, y: Array, way: Array) -> Array:
        A, B, C = self.section.quadratic_coefficients()
        up = self._height_over_axis(y)
        return np.asarray((B * up + C * y) / (A * up + B * y) * way)

    def _coordinates_up_and_y(self, points_j: Array) -> tuple[Array, Array, Array]:
        """Up and y of points, and the unit vector up, in frame j."""
        up = np.array((-np.cos(self.angle), 0.0, np.sin(self.angle)))
        return points_j @ up, points_j[..., 1], up

    def normal(self, points_j: Array) -> Array:
        """Outward unit normals in frame j, shape (..., 3), at points on the surface or near it."""
        A, B, C = self.section.quadratic_coefficients()
        u, v, up = self._coordinates_up_and_y(points_j)
        gradient = (A * u + B * v)[..., None] * up
        return unit_vectors(gradient + (B * u + C * v)[..., None] * (0.0, 1.0, 0.0))

    def signed_distances(self, points_j: Array) -> Array:
        """Distances of points, shape (..., 3), outside the surface, to first order, in metres."""
        A, B, C = self.section.quadratic_coefficients()
        u, v, _ = self._coordinates_up_and_y(points_j)
        scaled = np.sqrt(A * u * u + 2 * B * u * v + C * v * v)
        return np.asarray((scaled - 1) * scaled / np.hypot(A * u + B * v, B * u + C * v))

    def _quadratic_along_ray(self, p: Array, d: Array) -> tuple[Array, Array, Array]:
        A, B, C = self.section.quadratic_coefficients()

        def product(m: Array, n: Array) -> Array:
            (mu, mv), (nu, nv) = np.moveaxis(m, -1, 0), np.moveaxis(n, -1, 0)
            return np.asarray(A * mu * nu + B * (mu * nv + mv * nu) + C * mv * nv)

        return product(d, d), product(p, d), product(p, p) - 1
