"""Sections of tubular joints cut by a laser plane, and the light that falls on them.

Everything here is made from two cylinders and straight lines, for the bench alone: it shares no
code and no construction with the joints and the laser that the program simulates. The groove is
taken as a prism along its own direction, which a laser plane may cut obliquely; so a section is
a set of lines in the x-z plane of the sensor, and the detector beside that plane is seen from
the section as a point in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

EMITTER_Z: Final = 0.02
DETECTOR: Final = np.array((0.0, 0.085, 0.02))
NEAR, FAR = 0.175, 0.310
EDGE: Final = 0.22
"""Largest tangent of the fan."""

COLUMNS: Final = 640
STANDOFF: Final = 0.240
FREE: Final = 20e-6
"""A point this much behind another one, seen from the detector, is still seen, in metres."""


@dataclass(frozen=True)
class Tubes:
    """Two tubes that meet: radii, the brace's wall and the angle of the axes, SI units."""

    leg: float
    brace: float
    wall: float
    angle: float


@dataclass(frozen=True)
class Pose:
    """A laser plane before a joint.

    Parameters
    ----------
    origin : ndarray, shape (3,)
        Of the sensor, in the joint's frame (z up the brace, origin where the axes cross).
    x, y, z : ndarray, shape (3,)
        The sensor's axes.
    along : ndarray, shape (3,)
        The groove's direction, in the sensor's frame.
    dihedral : float
        Angle between wall and leg, through the air.
    """

    tubes: Tubes
    origin: Array
    x: Array
    y: Array
    z: Array
    along: Array
    dihedral: float

    @property
    def second_eye(self) -> Array:
        """The detector, moved along the groove into the laser plane: x and z, shape (2,)."""
        return np.asarray((DETECTOR - DETECTOR[1] / self.along[1] * self.along)[[0, 2]])


def groove_angle(dihedral: float) -> float:
    """A groove angle that a shop might prepare, in radians."""
    degrees = np.interp(math.degrees(dihedral), (60, 90, 110, 150), (32, 50, 60, 68))
    return math.radians(float(degrees))


def pose_before(
    tubes: Tubes, phi: float, *, pull: float = 0.0, turn: Array | None = None, shift: Array | None
) -> Pose:
    """Look along the middle of the groove's opening, but for a turn and a shift.

    Parameters
    ----------
    phi : float
        Azimuth about the brace.
    pull : float
        Turn about the sensor's x, radians.
    turn, shift : ndarray, shape (3,), optional
        Errors about and along x, y and z of the sensor, in radians and metres.
    """
    turn = np.zeros(3) if turn is None else turn
    shift = np.zeros(3) if shift is None else shift
    axis = np.array((math.sin(tubes.angle), 0.0, math.cos(tubes.angle)))
    x, y = tubes.brace * math.cos(phi), tubes.brace * math.sin(phi)
    height = (math.sqrt(tubes.leg**2 - y**2) + x * math.cos(tubes.angle)) / math.sin(tubes.angle)
    crossing = np.array((x, y, height))
    off_brace = np.array((math.cos(phi), math.sin(phi), 0.0))
    off_leg = _unit(crossing - (crossing @ axis) * axis)
    along = _unit(np.cross(off_brace, off_leg))
    up = np.cross(along, off_brace)
    up = up if up @ off_leg > 0 or up[2] > 0 else -up
    up = up if up[2] > 0 else -up
    out = np.cross(along, off_leg)
    out = out if out @ off_brace > 0 else -out
    dihedral = math.acos(float(np.clip(up @ out, -1, 1)))
    # From the leg towards the wall, by half the groove angle.
    half = groove_angle(dihedral) / 2
    square = _unit(up - (up @ out) * out)
    z = -(math.cos(half) * out + math.sin(half) * square)
    y_axis = along if np.cross(along, z) @ up > 0 else -along
    R = np.column_stack((np.cross(y_axis, z), y_axis, z))
    R = R @ _turned(0, pull) @ _turned(0, turn[0]) @ _turned(1, turn[1]) @ _turned(2, turn[2])
    target = crossing + tubes.wall / 2 * (up - 0.3 * off_brace)
    origin = target - R @ (shift + np.array((0.0, 0.0, STANDOFF)))
    return Pose(tubes, origin, R[:, 0], R[:, 1], R[:, 2], along @ R, dihedral)


@dataclass(frozen=True)
class CylinderCut:
    """Where the laser plane cuts a cylinder: a curve beside its tangent at a point.

    Parameters
    ----------
    gram, linear, constant
        Of the quadratic function of x and z that is zero on the cylinder.
    start, forward : ndarray, shape (2,)
        The point and the unit tangent.
    """

    gram: Array
    linear: Array
    constant: float
    start: Array = field(default_factory=lambda: np.zeros(2))
    forward: Array = field(default_factory=lambda: np.array((1.0, 0.0)))

    @classmethod
    def of(cls, pose: Pose, axis: Array, radius: float) -> CylinderCut:
        """The cut of a cylinder whose axis passes through the origin of the joint."""
        square = np.eye(3) - np.outer(axis, axis)
        plane = np.column_stack((pose.x, pose.z))
        gram = plane.T @ square @ plane
        linear = plane.T @ square @ pose.origin
        return cls(gram, linear, float(pose.origin @ square @ pose.origin - radius**2))

    def value(self, p: Array) -> Array:
        """The function at points, shape (..., 2)."""
        inner = np.einsum("...i,ij,...j->...", p, self.gram, p)
        return np.asarray(inner + 2 * p @ self.linear + self.constant)

    def gradient(self, p: Array) -> Array:
        """Its derivatives, shape (..., 2)."""
        return 2 * (p @ self.gram + self.linear)

    def outward(self, p: Array) -> Array:
        """Unit normals in the plane, away from the cylinder."""
        g = self.gradient(p)
        return np.asarray(g / np.linalg.norm(g, axis=-1, keepdims=True))

    def going(self, start: Array, towards: Array) -> CylinderCut:
        """The same curve, counted from another point and in the sense nearer to a direction."""
        n = self.outward(start)
        t = np.array((-n[1], n[0]))
        t = t if t @ towards > 0 else -t
        return CylinderCut(self.gram, self.linear, self.constant, start, t)

    def at(self, s: Array) -> Array:
        """Points whose foot on the tangent lies `s` from the start, shape (n, 2)."""
        n = self.outward(self.start)
        foot = self.start + np.atleast_1d(s)[:, None] * self.forward
        # |foot + h n| on the cylinder: the root near h = 0 of a quadratic.
        a = n @ self.gram @ n
        b = 0.5 * self.gradient(foot) @ n
        c = self.value(foot)
        h = -c / (b + np.sqrt(np.maximum(b * b - a * c, 0.0)))
        return np.asarray(foot + h[:, None] * n)

    def meet(self, origin: Array, direction: Array) -> Array:
        """Where a ray first crosses the curve, shape (2,); NaN where it never does."""
        a = float(direction @ self.gram @ direction)
        b = 0.5 * float(self.gradient(origin) @ direction)
        c = float(self.value(origin))
        root = math.sqrt(b * b - a * c) if b * b > a * c else 0.0
        ahead = [s for s in ((-b - root) / a, (-b + root) / a) if s > 0]
        return np.asarray(origin + ahead[0] * direction) if ahead else np.full(2, np.nan)


def first_hits(lines: list[Array], eye: Array, tangents: Array) -> Array:
    """Distances in z from an eye to the first line that each ray meets, shape (n,).

    Parameters
    ----------
    lines : list of ndarray, shape (m, 2)
        Polylines in x and z.
    eye : ndarray, shape (2,)
    tangents : ndarray, shape (n,)
        x over z of the rays, which run towards growing z.

    Returns
    -------
    ndarray, shape (n,)
        Infinite where a ray meets nothing.
    """
    starts = np.concatenate([line[:-1] for line in lines]) - eye
    ends = np.concatenate([line[1:] for line in lines]) - eye
    before = starts[:, 0] - tangents[:, None] * starts[:, 1]
    after = ends[:, 0] - tangents[:, None] * ends[:, 1]
    crossed = (before <= 0) != (after <= 0)
    ray, segment = np.nonzero(crossed)
    b, a = before[ray, segment], after[ray, segment]
    z = starts[segment, 1] + b / (b - a) * (ends[segment, 1] - starts[segment, 1])
    nearest = np.full(len(tangents), np.inf)
    np.minimum.at(nearest, ray[z > 0], z[z > 0])
    return nearest


@dataclass(frozen=True)
class Seen:
    """What an ideal sensor sees of lines: one entry per column, NaN where it sees nothing.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        x and z.
    tangents : ndarray, shape (n,)
        x over z of the rays from the emitter.
    incidence : ndarray, shape (n,)
        Angle between ray and surface normal in the plane, radians.
    """

    points: Array
    tangents: Array
    incidence: Array


def look_at(lines: list[Array], second_eye: Array | None = None, columns: int = COLUMNS) -> Seen:
    """See lines from the emitter, where the detector sees them too.

    Parameters
    ----------
    lines : list of ndarray, shape (m, 2)
    second_eye : ndarray, shape (2,), optional
        The detector in the plane of the section; without it nothing is hidden.
    columns : int
        Of the sensor.
    """
    tangents = np.linspace(-EDGE, EDGE, columns)
    eye = np.array((0.0, EMITTER_Z))
    depth = first_hits(lines, eye, tangents)
    points = np.column_stack((tangents * depth, EMITTER_Z + depth))
    points[~((points[:, 1] >= NEAR) & (points[:, 1] <= FAR))] = np.nan
    if second_eye is not None:
        index = np.flatnonzero(np.isfinite(points[:, 0]))
        away = points[index] - second_eye
        free = first_hits(lines, second_eye, away[:, 0] / away[:, 1]) > away[:, 1] - FREE
        points[index[~free]] = np.nan
    return Seen(points, tangents, _incidence(points, tangents))


def _incidence(points: Array, tangents: Array) -> Array:
    """From the differences of neighbours, which is good enough to lose points by."""
    with np.errstate(invalid="ignore", divide="ignore"):
        step = np.gradient(points, axis=0)
        turned = np.arctan2(step[:, 1], step[:, 0]) - np.arctan2(-tangents, 1.0)
    return np.asarray(np.abs((turned + np.pi / 2) % np.pi - np.pi / 2))


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


def _turned(axis: int, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    R = np.eye(3)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    R[i, i] = R[j, j] = c
    R[j, i], R[i, j] = s, -s
    return R


COLUMNS_BESIDE, LEAST_SEEN_BESIDE = 12, 5
"""On each side of a corner that is seen, so many of so many columns show the surface."""


def hidden_corners(
    tangents: Array, corners: Array, surface: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which corners have too little of the surface beside them to be known to a tenth of a mm.

    Parameters
    ----------
    tangents : ndarray, shape (n,)
        Of the columns' rays.
    corners : ndarray, shape (k,)
        Of the rays to the corners.
    surface : ndarray of bool, shape (n,)
        Which columns show the surface, and no reflection.
    """
    pitch = float(np.abs(np.diff(tangents)).mean())
    away = (tangents - corners[:, None]) / pitch
    beside = surface & (np.abs(away) < COLUMNS_BESIDE)
    counts = (beside & (away < 0)).sum(axis=1), (beside & (away >= 0)).sum(axis=1)
    return np.asarray(np.minimum(*counts) < LEAST_SEEN_BESIDE)
