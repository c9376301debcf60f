"""Lines and planes in Plücker coordinates, and the hand-eye pose in closed form, eq. (17)-(25)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tjscan.calibration.targets.line import LineBundle
from tjscan.core.frames import Array, array_dataclass, pose, readonly_copy, skew_matrix


@array_dataclass
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
    """Both conditions of eq. (17), shape (..., 4); all zero if a line is in the plane.

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


SIGN_RESIDUAL_RATIO: Final = 0.3
"""One sign's residual below this share of the other's decides between them."""


@dataclass(frozen=True, slots=True, eq=False)
class ClosedFormSolution:
    """Solution of the closed form: the sensor's pose on the flange, and how well it is conditioned.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange.
    singular_values : ndarray, shape (6,)
        Of A in eq. (21); the last belongs to the solution, the others must be far from zero.
    residual : float
        RMS residual of eq. (22), in metres.
    """

    T_f_s: Array
    singular_values: Array
    residual: float


def rotation_equations(lines: LineBundle, u_b: Array) -> Array:
    """Matrix A of the equations for the rotation, eq. (21), shape (..., n, 6).

    Parameters
    ----------
    lines : LineBundle
        Lines on a plane.
    u_b : ndarray, shape (..., 3)
        Normals that the plane may have, frame b.
    """
    u_f = np.einsum("nji,...j->...ni", lines.R_b_f, u_b)  # u^T R_b_f, as a row per line
    a = lines.directions_s
    return np.concatenate((u_f * a[:, 0:1], u_f * a[:, 2:3]), axis=-1)


def rotation_candidates(A: Array) -> tuple[Array, Array]:
    """Both rotations R_f_s that the null vector of A allows, and A's singular values.

    Parameters
    ----------
    A : ndarray, shape (..., n, 6)
        Of eq. (21), n ≥ 5.

    Returns
    -------
    R_f_s : ndarray, shape (..., 2, 3, 3)
        The null vector is known up to its sign, which turns r1 and r3 round but not r2.
    singular_values : ndarray, shape (..., 6)
        The last is zero for five lines.
    """
    _, singular, Vt = np.linalg.svd(A, full_matrices=True)
    if singular.shape[-1] < 6:
        singular = np.concatenate((singular, np.zeros((*singular.shape[:-1], 1))), axis=-1)
    x = Vt[..., 5, :]
    r1 = x[..., :3] / np.linalg.norm(x[..., :3], axis=-1, keepdims=True)
    r3 = x[..., 3:] / np.linalg.norm(x[..., 3:], axis=-1, keepdims=True)
    r2 = np.cross(r3, r1)
    both = np.stack((np.stack((r1, r2, r3), axis=-1), np.stack((-r1, r2, -r3), axis=-1)), axis=-3)
    # The nearest member of SO(3); r2 = r3 × r1 is right-handed already.
    U, _, Wt = np.linalg.svd(both)
    return U @ Wt, singular


def sensor_position(lines: LineBundle, plane: PluckerPlane, R_f_s: Array) -> tuple[Array, float]:
    """Position of the sensor on the flange by eq. (22)-(25).

    Parameters
    ----------
    lines : LineBundle
        Lines on the plane.
    plane : PluckerPlane
        Frame b.
    R_f_s : ndarray, shape (3, 3)
        Rotation of the sensor on the flange.

    Returns
    -------
    p_f_s : ndarray, shape (3,)
        Metres.
    residual : float
        RMS residual of eq. (22), per line, metres.
    """
    line_s = line_through_point(lines.points_s, lines.directions_s)
    line_f = transform_line(pose(R_f_s), line_s)  # (18), as if p_f_s were zero
    T_b_f = np.tile(np.eye(4), (len(lines.p_b_f), 1, 1))
    T_b_f[:, :3, :3], T_b_f[:, :3, 3] = lines.R_b_f, lines.p_b_f
    line_b = transform_line(T_b_f, line_f)  # (18)
    A_p = (skew_matrix(plane.u) @ lines.R_b_f @ skew_matrix(line_f.a)).reshape(-1, 3)  # (24)
    b = incidence_residuals(line_b, plane)[:, 1:].ravel()  # (25): (17) without p_f_s
    p = np.asarray(np.linalg.lstsq(A_p, b, rcond=None)[0], dtype=float)
    # Three rows per line have rank one: the RMS is per line.
    return p, float(np.linalg.norm(A_p @ p - b) / np.sqrt(len(line_f.a)))


def solve_closed_form(lines: LineBundle, plane: PluckerPlane) -> ClosedFormSolution:
    """Hand-eye transform from at least five lines on a known plane, eq. (20)-(25).

    Parameters
    ----------
    lines : LineBundle
        In general position; see `tjscan.calibration.checks.rotation_condition`.
    plane : PluckerPlane
        Frame b.

    Notes
    -----
    Cibicik et al. 2022, appendix. Of the two signs of the null vector in eq. (21) the one is
    taken that leaves the smaller residual in eq. (22). If the central ray always meets the board
    at the same distance and point, both residuals are alike: the wrong sensor then looks at the
    board from behind, and the sensor on the flange's side is taken.
    """
    if len(lines.points_s) < 5:
        raise ValueError("the closed form needs at least five lines")
    both, singular = rotation_candidates(rotation_equations(lines, plane.u))
    found = []
    for R in both:
        p, residual = sensor_position(lines, plane, R)
        found.append(ClosedFormSolution(pose(R, p), singular, residual))
    best, other = sorted(found, key=lambda solution: solution.residual)
    if best.residual > SIGN_RESIDUAL_RATIO * other.residual:
        best = max(
            found, key=lambda one: sensor_on_flange_side_share(lines, plane, one.T_f_s[:3, 3])
        )
    return best


def sensor_on_flange_side_share(lines: LineBundle, plane: PluckerPlane, p_f_s: Array) -> float:
    """Share of the lines for which sensor and flange are on the same side of the plane.

    Parameters
    ----------
    lines : LineBundle
        Lines, and the poses of the flange.
    plane : PluckerPlane
        Frame b.
    p_f_s : ndarray, shape (3,)
        Position of the sensor on the flange, metres.
    """
    flange = plane.signed_distances(lines.p_b_f)
    sensor = plane.signed_distances(lines.p_b_f + np.einsum("nij,j->ni", lines.R_b_f, p_f_s))
    return float(np.mean(np.sign(flange) == np.sign(sensor)))
