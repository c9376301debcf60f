"""Lines and planes in Plücker coordinates, and how they change frame, eq. (17)-(19)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tjscan.core.frames import Array, frozen_arrays, readonly_copy, skew_matrix


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class PluckerLine:
    """A line {a, m}, or many: every point p on it has ``p × a = m``.

    Parameters
    ----------
    a : ndarray, shape (..., 3)
        Direction. Scaling `a` and `m` together leaves the line the same.
    m : ndarray, shape (..., 3)
        Moment about the frame's origin, in metres when `a` is a unit vector.
    """

    a: Array
    m: Array

    @property
    def six_coordinates(self) -> Array:
        """The six Plücker coordinates, direction over moment, shape (..., 6)."""
        return np.concatenate((self.a, self.m), axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class PluckerPlane:
    """A plane {u, u0}: every point p on it has ``u · p + u0 = 0``.

    Parameters
    ----------
    u : ndarray, shape (3,)
        Unit normal.
    u0 : float
        Minus the plane's distance from the origin along `u`, in metres.

    Notes
    -----
    This is the sign with which the paper's eq. (17) holds; the sentence before it has the
    other one.
    """

    u: Array
    u0: float

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.u))
        if not length > 0:
            raise ValueError("a plane needs a normal that is not zero")
        object.__setattr__(self, "u", readonly_copy(np.asarray(self.u) / length))
        object.__setattr__(self, "u0", float(self.u0) / length)

    def signed_distances(self, points: ArrayLike) -> Array:
        """Signed distances of points, shape (..., 3), along the normal, in metres."""
        return np.asarray(np.asarray(points, dtype=float) @ self.u + self.u0)


def line_through_point(point: ArrayLike, direction: ArrayLike) -> PluckerLine:
    """Plücker line through a point along a direction.

    Parameters
    ----------
    point : array_like, shape (..., 3)
        Metres.
    direction : array_like, shape (..., 3)
        In the same frame.
    """
    a = np.asarray(direction, dtype=float)
    return PluckerLine(a, np.cross(np.asarray(point, dtype=float), a))


def plane_through_point(point: ArrayLike, normal: ArrayLike) -> PluckerPlane:
    """Plane through a point, perpendicular to a normal.

    Parameters
    ----------
    point : array_like, shape (3,)
        Metres.
    normal : array_like, shape (3,)
        In the same frame, of any length but zero.
    """
    u = np.asarray(normal, dtype=float)
    return PluckerPlane(u, -float(u @ np.asarray(point, dtype=float)))


def line_transform_matrix(T_b_s: Array) -> Array:
    """V of eq. (19), shape (..., 6, 6), of poses, shape (..., 4, 4): maps lines of s into b."""
    R, p = T_b_s[..., :3, :3], T_b_s[..., :3, 3]
    V = np.zeros((*R.shape[:-2], 6, 6))
    V[..., :3, :3] = V[..., 3:, 3:] = R
    V[..., 3:, :3] = skew_matrix(p) @ R
    return V


def transform_line(T_b_s: Array, line_s: PluckerLine) -> PluckerLine:
    """Transform lines of frame s into frame b, eq. (18).

    Parameters
    ----------
    T_b_s : ndarray, shape (..., 4, 4)
        Poses of s in b.
    line_s : PluckerLine
        One, or one for each pose.
    """
    screw = (line_transform_matrix(T_b_s) @ line_s.six_coordinates[..., None])[..., 0]
    return PluckerLine(screw[..., :3], screw[..., 3:])


def incidence_residuals(line: PluckerLine, plane: PluckerPlane) -> Array:
    """Both conditions of eq. (17), shape (..., 4); all zero if a line lies in the plane.

    Parameters
    ----------
    line : PluckerLine
        One or many, with unit directions.
    plane : PluckerPlane
        In the same frame.

    Returns
    -------
    ndarray, shape (..., 4)
        ``u · a``, the sine of the line's tilt out of the plane; then ``u × m - u0 a``, in metres:
        if the tilt is zero, that is ``-a`` times the line's distance from the plane.
    """
    tilt = line.a @ plane.u
    distance = line.m @ skew_matrix(plane.u).T - plane.u0 * line.a
    return np.concatenate((tilt[..., None], distance), axis=-1)
