"""Lines and planes in Plücker coordinates, and how they change frame, eq. (17)-(19)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tjscan.core.frames import Array, readonly, skew


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A line {a, m}: every point p on it has ``p × a = m``.

    Parameters
    ----------
    a : ndarray, shape (3,)
        Direction. Scaling `a` and `m` together leaves the line the same.
    m : ndarray, shape (3,)
        Moment about the frame's origin, in metres when `a` is a unit vector.
    """

    a: Array
    m: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "a", readonly(self.a))
        object.__setattr__(self, "m", readonly(self.m))

    @property
    def screw(self) -> Array:
        """Direction over moment, shape (6,)."""
        return np.concatenate((self.a, self.m))

    @property
    def nearest_point(self) -> Array:
        """The point next to the frame's origin, shape (3,)."""
        return np.asarray(np.cross(self.a, self.m) / (self.a @ self.a))


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
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
        object.__setattr__(self, "u", readonly(np.asarray(self.u) / length))
        object.__setattr__(self, "u0", float(self.u0) / length)

    def distance(self, points: ArrayLike) -> Array:
        """Signed distances of points, shape (..., 3), along the normal, in metres."""
        return np.asarray(np.asarray(points, dtype=float) @ self.u + self.u0)


def line_through(point: ArrayLike, direction: ArrayLike) -> Line:
    """Line through `point`, shape (3,), along `direction`, shape (3,)."""
    a = np.asarray(direction, dtype=float)
    return Line(a, np.cross(np.asarray(point, dtype=float), a))


def plane_through(point: ArrayLike, normal: ArrayLike) -> Plane:
    """Plane through `point`, shape (3,), square to `normal`, shape (3,)."""
    u = np.asarray(normal, dtype=float)
    return Plane(u, -float(u @ np.asarray(point, dtype=float)))


def screw_matrix(T_b_s: Array) -> Array:
    """V of eq. (19), shape (6, 6): maps lines of frame s into frame b."""
    R, p = T_b_s[:3, :3], T_b_s[:3, 3]
    V = np.zeros((6, 6))
    V[:3, :3] = V[3:, 3:] = R
    V[3:, :3] = skew(p) @ R
    return V


def transform_line(T_b_s: Array, line_s: Line) -> Line:
    """A line of frame s in frame b, eq. (18)."""
    screw = screw_matrix(T_b_s) @ line_s.screw
    return Line(screw[:3], screw[3:])


def transform_plane(T_b_s: Array, plane_s: Plane) -> Plane:
    """A plane of frame s in frame b."""
    u = T_b_s[:3, :3] @ plane_s.u
    return Plane(u, plane_s.u0 - float(u @ T_b_s[:3, 3]))


def incidence(line: Line, plane: Plane) -> Array:
    """Both conditions of eq. (17), shape (4,); all zero when the line lies in the plane.

    The first is the sine of the line's tilt out of the plane. When that is zero the other three
    are ``-a`` times the line's distance from the plane.
    """
    along = plane.u @ line.a
    moment = -plane.u0 * line.a + np.cross(plane.u, line.m)
    return np.concatenate(((along,), moment))
