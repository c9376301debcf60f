"""Simulated profiles of joints with the truth about their corners, for the groove's bench."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import (
    Array,
    inverse_pose,
    pose,
    rot_x,
    rot_y,
    rot_z,
    transform_points,
    unit_vector,
)
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import FeatureEdges, feature_edges
from tjscan.joint.mesh import build_joint_mesh
from tjscan.laser.faults import FaultRandomStreams, LaserRayHits, apply_faults
from tjscan.laser.model import LaserModel
from tjscan.laser.optics import RaycastSurface, laser_ray_directions, trace_laser_rays
from tjscan.laser.profile import Profile

STANDOFF: Final = 0.240
STRAIGHT: Final = 2e-6
"""A section that bends less is straight, in metres: the mesh is no better."""


@dataclass(frozen=True)
class Stage:
    """A joint set up before a laser."""

    definition: JointDefinition
    edges: FeatureEdges
    surface: RaycastSurface

    @classmethod
    def of(cls, definition: JointDefinition) -> Stage:
        """Build a joint's solid and edges."""
        mesh = build_joint_mesh(definition)
        return cls(
            definition, feature_edges(definition), RaycastSurface(mesh.vertices, mesh.triangles)
        )


@dataclass(frozen=True)
class View:
    """A pose before a joint and the truth about the section seen from it.

    Parameters
    ----------
    T_j_s : ndarray, shape (4, 4)
    corners : ndarray, shape (3, 2)
        p2, p3, p4, x and z in frame s.
    wall, leg : ndarray, shape (2,)
        Tangents of the wall at p2 (down) and of the leg at p4 (out).
    """

    T_j_s: Array
    corners: Array
    wall: Array
    leg: Array

    @property
    def five(self) -> Array:
        """Five points, shape (5, 3), with ends one centimetre from p2 and p4."""
        p = np.zeros((5, 3))
        p[1:4, [0, 2]] = self.corners
        p[0, [0, 2]] = self.corners[0] - 0.01 * self.wall
        p[4, [0, 2]] = self.corners[2] + 0.01 * self.leg
        return p


def view(stage: Stage, phi: float, *, pull: float, turn: Array, shift: Array) -> View:
    """Look at the groove at an azimuth from the middle of its opening, but for an error.

    Parameters
    ----------
    pull : float
        Pull angle, radians.
    turn : ndarray, shape (3,)
        Error of the pose about x, y and z of s, radians.
    shift : ndarray, shape (3,)
        Error of the pose along x, y and z of s, metres.
    """
    edges = stage.edges
    i = int(np.argmin(np.abs((edges.phi - phi + np.pi) % (2 * np.pi) - np.pi)))
    p2, p3, p4 = (e.points_j[i] for e in (edges.p2, edges.p3, edges.p4))
    up = np.array([0.0, 0.0, 1.0])
    radial = np.array([np.cos(phi), np.sin(phi), 0.0])
    out = radial + up * stage.definition.leg_surface.slope(phi, np.hypot(*p4[:2]))
    middle = unit_vector(unit_vector(p2 - p3) + unit_vector(out))
    z = -middle
    y = unit_vector(np.cross(z, up))
    R = np.column_stack((np.cross(y, z), y, z)) @ rot_x(pull)
    R = R @ rot_x(turn[0]) @ rot_y(turn[1]) @ rot_z(turn[2])
    target = 0.5 * (p2 + p4)
    T_j_s = pose(R, target - R @ (shift + np.array([0, 0, STANDOFF])))
    T_s_j = inverse_pose(T_j_s)
    near = (np.arange(-150, 151) + i) % len(edges.phi)
    corners_j = [_cut(T_s_j, e.points_j[near]) for e in (edges.p2, edges.p3, edges.p4)]
    corners_s = transform_points(T_s_j, np.array(corners_j))
    y_j = R[:, 1]
    wall_j = _tangent(unit_vector(corners_j[0] * [1, 1, 0]), y_j, -up)
    leg_j = _tangent(stage.definition.leg_surface.normal(corners_j[2]), y_j, radial)
    return View(T_j_s, corners_s[:, [0, 2]], (wall_j @ R)[[0, 2]], (leg_j @ R)[[0, 2]])


def _cut(T_s_j: Array, points_j: Array) -> Array:
    """Where a polyline passes through the laser plane, in frame j."""
    y = transform_points(T_s_j, points_j)[:, 1]
    through = np.flatnonzero(np.diff(np.sign(y)) != 0)
    k = through[np.argmin(np.abs(through - len(y) // 2))]
    return np.asarray(points_j[k] + y[k] / (y[k] - y[k + 1]) * (points_j[k + 1] - points_j[k]))


def _tangent(normal: Array, y_j: Array, towards: Array) -> Array:
    t = unit_vector(np.cross(normal, y_j))
    return t if t @ towards > 0 else -t


def hits_of(stage: Stage, v: View, model: LaserModel) -> LaserRayHits:
    return trace_laser_rays(stage.surface, v.T_j_s, model, laser_ray_directions(model))


def profile_of(hits: LaserRayHits, model: LaserModel, seed: int) -> Profile:
    points = apply_faults(hits, model, FaultRandomStreams.spawn(np.random.default_rng(seed)))
    return Profile(points.x_s, points.z_s, points.intensity)


def sides_of(hits: LaserRayHits, v: View, model: LaserModel) -> NDArray[np.intp]:
    """Side that each column sees: 0 wall, 1 bevel, 2 root, 3 leg; -1 nothing."""
    z = model.emitter_z + hits.distance * hits.directions_s[:, 2]
    tangent = -hits.directions_s[:, 0] / hits.directions_s[:, 2]
    c = v.corners
    bounds = -c[:, 0] / (c[:, 1] - model.emitter_z)
    side = np.searchsorted(bounds, tangent)
    return np.where(hits.seen & np.isfinite(z), side, -1)


def bound(hits: LaserRayHits, v: View, model: LaserModel) -> Array:
    """Cramér–Rao bound of each corner's error: root of the covariance's trace, shape (3,).

    Points are known to belong to their true sides; each side is a line or, where it truly
    bends by more than `STRAIGHT`, a parabola. The noise is that of the model: along the rays,
    correlated over columns, rounded to steps.
    """
    side = sides_of(hits, v, model)
    found = []
    for k in range(4):
        index = np.flatnonzero(side == k)
        x = np.column_stack(
            (
                hits.distance[index] * hits.directions_s[index, 0],
                model.emitter_z + hits.distance[index] * hits.directions_s[index, 2],
            )
        )
        corner = v.corners[min(k, 2)]
        t = unit_vector(x[-1] - x[0])
        n = np.array([-t[1], t[0]])
        s = (x - corner) @ t
        line = np.polynomial.Polynomial.fit(s, (x - corner) @ n, 1)
        degree = 1 if np.ptp((x - corner) @ n - line(s)) < STRAIGHT else 2
        # A change of height across the side changes the range by 1 / cosine.
        basis = s ** np.arange(degree + 1)[:, None] / hits.incidence_cosine[index]
        lag = index[:, None] - index
        R = np.exp(-((lag / max(model.noise_correlation, 1e-9)) ** 2)) * model.noise**2
        # Noise this smooth could be told from its neighbours almost exactly: the bound would
        # not be one for anything real. A hundredth of it is taken as white.
        R += np.eye(len(index)) * ((0.01 * model.noise) ** 2 + model.step**2 / 12)
        found.append((corner, t, n, np.linalg.inv(basis @ np.linalg.solve(R, basis.T))))
    return np.array([_corner_bound(v.corners[k], found[k], found[k + 1]) for k in range(3)])


def _corner_bound(corner: Array, *sides: tuple[Array, Array, Array, Array]) -> float:
    """Root of the trace of the covariance of a corner that two sides share."""
    m, spread = np.empty((2, 2)), np.zeros((2, 2))
    for j, (origin, t, n, cov) in enumerate(sides):
        b = ((corner - origin) @ t) ** np.arange(len(cov))
        m[j], spread[j, j] = n, b @ cov @ b
    w = np.linalg.inv(m)
    return float(np.sqrt(np.trace(w @ spread @ w.T)))
