"""Paths of the tool: a line, an arc through a point, and the blend from one line into another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, radians
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from tjscan.core.frames import Array, pose, rotation_angle_between

POSE_SPACING: Final = 5e-3
"""Metres between the poses of a path."""

TURN_SPACING: Final = radians(2)
"""Radians that the tool turns between them."""

FEWEST_PIECES: Final = 4
"""Pieces of the shortest path, so that its spline has a cubic to it."""

SAME_POINT: Final = 1e-9
"""Metres: two points closer than this are one."""

COLLINEAR_SINE: Final = 1e-6
"""Sine of the angle below which three points lie on a line."""


@dataclass(frozen=True, slots=True, eq=False)
class ToolPath:
    """Poses along a path of the tool.

    Parameters
    ----------
    poses : ndarray, shape (m, 4, 4)
        Of the TCP in frame b.
    lengths : ndarray, shape (m,)
        Length of the path to each pose, metres; they grow.
    """

    poses: Array
    lengths: Array

    @property
    def length(self) -> float:
        """Length of the whole path, metres."""
        return float(self.lengths[-1])


def line_path(T_start: Array, T_end: Array) -> ToolPath:
    """Straight line, turning evenly about one axis."""
    points = np.array([T_start[:3, 3], T_end[:3, 3]])
    return _sampled(lambda u: points[0] + u[:, None] * (points[1] - points[0]), T_start, T_end)


def arc_path(T_start: Array, via: Array, T_end: Array) -> ToolPath:
    """Arc of a circle through a point, shape (3,); a line if the three points are on one."""
    a, b, c = T_start[:3, 3], np.asarray(via, dtype=float), T_end[:3, 3]
    normal = np.cross(b - a, c - a)
    scale = float(np.linalg.norm(b - a) * np.linalg.norm(c - a))
    if np.linalg.norm(normal) <= COLLINEAR_SINE * scale:
        return line_path(T_start, T_end)
    n = normal / np.linalg.norm(normal)
    # The centre is where the perpendicular bisectors of both chords meet.
    lhs = np.array([b - a, c - a, n])
    rhs = np.array([(b - a) @ (b + a) / 2, (c - a) @ (c + a) / 2, n @ a])
    centre = np.linalg.solve(lhs, rhs)
    e_1 = a - centre
    e_2 = np.cross(n, e_1)
    angle = float(np.arctan2((c - centre) @ e_2, (c - centre) @ e_1)) % (2 * np.pi)

    def points(u: Array) -> Array:
        turned = (u * angle)[:, None]
        return np.asarray(centre + np.cos(turned) * e_1 + np.sin(turned) * e_2)

    return _sampled(points, T_start, T_end)


def blended_path(T_start: Array, corner: Array, T_end: Array, radius: float) -> ToolPath:
    """Path out of one line into the next: a parabola about their corner, then on along the next.

    Parameters
    ----------
    T_start : ndarray, shape (4, 4)
        Where the blend begins, before the corner.
    corner : ndarray, shape (3,)
        Where the two lines meet, metres.
    T_end : ndarray, shape (4, 4)
        Where the next line ends.
    radius : float
        How far behind the corner the blend ends, metres; not beyond the line's end.
    """
    a, way = T_start[:3, 3], T_end[:3, 3] - corner
    rest = float(np.linalg.norm(way))
    if rest < SAME_POINT or np.linalg.norm(corner - a) < SAME_POINT:
        return line_path(T_start, T_end)
    share = min(radius / rest, 1.0)
    out = corner + share * way
    turned = _turn(T_start, T_end)(share / 2 if share < 1 else 1.0)
    T_out = pose(turned, out)

    def parabola(u: Array) -> Array:
        u = u[:, None]
        return np.asarray((1 - u) ** 2 * a + 2 * u * (1 - u) * corner + u**2 * out)

    return join_paths([_sampled(parabola, T_start, T_out), line_path(T_out, T_end)])


def join_paths(paths: Sequence[ToolPath]) -> ToolPath:
    """One path after the other."""
    paths = [path for path in paths if path.length > SAME_POINT] or paths[:1]
    poses, lengths = [paths[0].poses], [paths[0].lengths]
    for path in paths[1:]:
        poses.append(path.poses[1:])
        lengths.append(lengths[-1][-1] + path.lengths[1:])
    return ToolPath(np.concatenate(poses), np.concatenate(lengths))


def shortened_line(T_start: Array, T_end: Array, radius: float) -> Array:
    """Pose on the line to a target at a distance before it, or its beginning, shape (4, 4)."""
    rest = float(np.linalg.norm(T_end[:3, 3] - T_start[:3, 3]))
    if rest < SAME_POINT:
        return T_end
    share = max(1 - radius / rest, 0.0)
    return pose(
        _turn(T_start, T_end)(share), T_start[:3, 3] + share * (T_end[:3, 3] - T_start[:3, 3])
    )


def _turn(T_start: Array, T_end: Array) -> Callable[[float | Array], Array]:
    """Rotations on the shortest way from one pose to another, over the share of it."""
    slerp = Slerp([0, 1], Rotation.from_matrix(np.array([T_start[:3, :3], T_end[:3, :3]])))
    return lambda share: np.asarray(slerp(share).as_matrix())


def _sampled(points: Callable[[Array], Array], T_start: Array, T_end: Array) -> ToolPath:
    """Poses along a curve whose points are given over 0 to 1."""
    fine = np.linspace(0, 1, 201)
    length = float(np.linalg.norm(np.diff(points(fine), axis=0), axis=1).sum())
    angle = rotation_angle_between(T_start, T_end)
    pieces = max(FEWEST_PIECES, ceil(length / POSE_SPACING), ceil(angle / TURN_SPACING))
    u = np.linspace(0, 1, pieces + 1)
    poses = np.tile(np.eye(4), (len(u), 1, 1))
    poses[:, :3, 3], poses[:, :3, :3] = points(u), _turn(T_start, T_end)(u)
    dense = points(np.linspace(0, 1, 20 * pieces + 1))
    steps = np.linalg.norm(np.diff(dense, axis=0), axis=1)
    return ToolPath(poses, np.concatenate(([0.0], np.cumsum(steps)[19::20])))
