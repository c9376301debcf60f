"""A plane as calibration target, touched or unknown: offset and tilt of the lines seen on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc

from tjscan.calibration.closed_form import (
    PluckerPlane,
    plane_through_point,
    rotation_candidates,
    rotation_equations,
    sensor_on_flange_side_share,
    solve_closed_form,
)
from tjscan.calibration.noise import TYPICAL_FLANGE_LEVER, NoiseModel
from tjscan.calibration.targets.line import LineBundle, LineFit, stack_lines
from tjscan.calibration.targets.target import (
    LinearisedModel,
    SeenTarget,
    TargetModel,
    TargetStatement,
)
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, array_dataclass, cross, pose, transform_points, unit_vector

MAX_REFINED_STARTS: Final = 12
"""Starts refined for an unknown plane."""
PLANE_NORMALS_TRIED: Final = 300
"""Directions tried for an unknown normal: one in every 8°."""
MISFIT_OFFSET_SCALE: Final = 1e-3
MISFIT_TILT_SCALE: Final = float(np.radians(0.5))
"""Metres and radians: how misfits in distance and in tilt are compared among starts."""
MIN_TOUCHES: Final = 3
MIN_TOUCH_PATTERN_RATIO: Final = 0.1
"""Touched points whose pattern is narrower than this share of its length count as collinear."""
MAX_NORMAL_SIGMA: Final = float(np.radians(0.2))
"""Radians; a touched plane whose normal is less certain would spoil any calibration."""
MIN_TOUCH_PROBABILITY: Final = 1e-4
"""Touches less probable than this under the stated noise are refused."""
NOT_FLAT_REASON: Final = "touched points not on one plane"
"""The reason for which to touch again; none of the other reasons goes away by that."""
STATED_PLANE_SQUARE_SIDE: Final = 0.2
"""Metres; see `plane_of_statement`."""


@array_dataclass
class PlaneTarget:
    """A flat calibration board in frame b, and the knowledge of its place.

    A nearby plane is written as (tilt, tilt, height): its normal is ``u + tilts @ axes_b``,
    scaled to length one, and `centre_b` is at the signed distance `height` from it.

    Parameters
    ----------
    plane : PluckerPlane
        The board, frame b.
    centre_b : ndarray, shape (3,)
        The point on it that heights count from, in metres.
    axes_b : ndarray, shape (2, 3)
        Two unit vectors in the plane, the long side of the touched pattern first.
    information : ndarray, shape (3, 3)
        Inverse covariance of (tilt, tilt, height), radians and metres; zero if nothing is known.
    residuals : ndarray, shape (n,)
        Distances of the touched points from the plane, in metres; empty if none was touched.
    singular_values : ndarray, shape (3,)
        Of the touched points about their centroid, in metres: length, width and thickness of
        the pattern, times the root of the number of points.
    by_arm : ndarray, shape (3, m), or None
        How (tilt, tilt, height) move with draws of the arm's geometry, see
        `ArmGeometryDeviation.flange_motion`; `information` is then from the touches alone.
        None if it holds both.
    """

    plane: PluckerPlane
    centre_b: Array
    axes_b: Array
    information: Array
    residuals: Array
    singular_values: Array
    by_arm: Array | None = None

    @classmethod
    def from_unknown_plane(cls, plane: PluckerPlane, near_b: ArrayLike) -> Self:
        """Make a target whose plane is unknown beforehand, from a starting value.

        Parameters
        ----------
        plane : PluckerPlane
            A start for it, frame b.
        near_b : array_like, shape (3,)
            Heights count from the point of the plane next to this one; metres.
        """
        near = np.asarray(near_b, dtype=float)
        foot = near - float(plane.signed_distances(near)) * plane.u
        axes = np.linalg.svd(plane.u[None])[2][1:]
        return cls(plane, foot, axes, np.zeros((3, 3)), np.zeros(0), np.zeros(3))

    @property
    def is_place_known(self) -> bool:
        """Whether the board's place is known, from touches or as stated."""
        return bool(self.information.any())

    def boxplus(self, by: Array) -> PluckerPlane:
        """Plane a step (tilt, tilt, height), shape (3,), away from this one."""
        u = unit_vector(self.plane.u + by[:2] @ self.axes_b)
        return plane_through_point(self.centre_b - by[2] * u, u)


@dataclass(frozen=True, slots=True, eq=False)
class PlaneModel(TargetModel):
    """Residuals of lines on a plane: distance of each centroid, and sine of the tilt out of it.

    Eq. (17) asks no more of a line. `PlaneTarget.boxplus` states the target's parameters.

    Parameters
    ----------
    lines : LineBundle
        Poses and lines.
    target : PlaneTarget
        The board.
    noise : NoiseModel
        For the arm's errors.
    by_laser : ndarray, shape (n, 2, m), or None
        `LineFit.by_laser` of each line.
    by_arm : ndarray, shape (n, 6, m), or None
        `ArmGeometryDeviation.flange_motion` of each pose.
    """

    lines: LineBundle
    target: PlaneTarget
    noise: NoiseModel
    by_laser: Array | None = None
    by_arm: Array | None = None

    def at_other_poses(self, T_b_f: Array) -> Self:
        """Return the same lines, taken from other flange poses, shape (n, 4, 4)."""
        lines = replace(self.lines, R_b_f=T_b_f[:, :3, :3], p_b_f=T_b_f[:, :3, 3])
        return replace(self, lines=lines)

    def is_behind(self, T_f_s: Array, target: Array) -> bool:
        """Whether sensor and flange are on different sides of an unknown plane."""
        if self.target.is_place_known:
            return False
        plane = self.target.boxplus(target)
        return sensor_on_flange_side_share(self.lines, plane, T_f_s[:3, 3]) < 0.5

    def result_fields(self, target: Array, covariance: Array) -> dict[str, Any]:
        """The board."""
        return {"board": self.estimated_plane(target, covariance)}

    def estimated_plane(self, step: Array, covariance: Array) -> PlaneTarget:
        """The plane a step away, with the inverse of its covariance, shape (3, 3)."""
        information = np.asarray(np.linalg.inv(covariance))
        return replace(self.target, plane=self.target.boxplus(step), information=information)

    @property
    def prior_information(self) -> Array:
        """Inverse covariance of the plane's (tilt, tilt, height) known beforehand, shape (3, 3)."""
        return self.target.information

    def linearise(self, T_f_s: Array, target: Array) -> LinearisedModel:
        """Offsets in metres and tilts in radians, k = 2, with derivatives and covariance.

        Parameters
        ----------
        T_f_s : ndarray, shape (4, 4)
            The sensor on the flange.
        target : ndarray, shape (3,)
            Tilt, tilt (radians) and height (metres) of the plane from `PlaneTarget.plane`.
        """
        R_b_f, R, p = self.lines.R_b_f, T_f_s[:3, :3], T_f_s[:3, 3]
        lever_f, a_f = self.lines.points_s @ R.T, self.lines.directions_s @ R.T
        x_b = _rotate_rows(R_b_f, lever_f + p)  # from the flange to the line, in the axes of b
        a_b = _rotate_rows(R_b_f, a_f)
        tilted = self.target.plane.u + target[:2] @ self.target.axes_b
        length = np.linalg.norm(tilted)
        u = tilted / length
        by_tilt = (self.target.axes_b - np.outer(self.target.axes_b @ u, u)) / length
        arm_b = x_b + self.lines.p_b_f - self.target.centre_b
        residuals = np.stack((arm_b @ u + target[2], a_b @ u), axis=1)

        u_f = u @ R_b_f  # (n, 3): the normal as each flange sees it
        by_pose = np.zeros((len(x_b), 2, 6))
        by_pose[:, 0, :3] = u_f
        by_pose[:, 0, 3:] = cross(lever_f, u_f)
        by_pose[:, 1, 3:] = cross(a_f, u_f)
        by_target = np.zeros((len(x_b), 2, 3))
        by_target[:, 0, :2], by_target[:, 0, 2] = arm_b @ by_tilt.T, 1.0
        by_target[:, 1, :2] = a_b @ by_tilt.T
        # A small turn of the flange moves all points of the line together.
        by_arm = np.zeros((len(x_b), 2, 6))
        by_arm[:, 0, :3] = u
        by_arm[:, 0, 3:], by_arm[:, 1, 3:] = cross(x_b, u), cross(a_b, u)
        a = self.lines.directions_s
        across_f = np.stack((-a[:, 2], a[:, 1], a[:, 0]), axis=1) @ R.T
        # A line's errors are in the laser plane; this much of them points at the board.
        share = np.einsum("ni,ni->n", across_f, u_f)
        own = np.zeros((len(a), 2, 2))
        own[:, 0, 0] = (share * self.lines.sigma_offset) ** 2
        own[:, 1, 1] = (share * self.lines.sigma_angle) ** 2
        by_laser = None if self.by_laser is None else share[:, None, None] * self.by_laser
        by_geometry = None if self.by_arm is None else by_arm @ self.by_arm
        if by_geometry is not None and self.target.by_arm is not None:
            by_geometry = by_geometry + by_target @ self.target.by_arm
        return LinearisedModel(
            residuals, by_pose, by_target, by_arm, own, self.noise, by_laser, by_geometry
        )


def _rotate_rows(R: Array, v: Array) -> Array:
    """Rows of v, shape (n, 3), each turned by its own R, shape (n, 3, 3)."""
    return np.asarray(np.einsum("nij,nj->ni", R, v))


@dataclass(frozen=True, slots=True, eq=False)
class SeenBoard(SeenTarget[LineFit]):
    """Lines on a board, touched or unknown.

    Parameters
    ----------
    samples : sequence of PosedFit
        The lines.
    target : PlaneTarget or None
        The plane as touched; None if it is unknown.
    noise : NoiseModel
        Errors of profiles and poses.
    """

    target: PlaneTarget | None
    noise: NoiseModel

    @property
    def kind(self) -> str:
        """``plane touched`` or ``plane unknown``."""
        return "plane unknown" if self.target is None else "plane touched"

    def starts(self) -> list[Array]:
        """By the closed form; for an unknown plane, by the closed form for many normals."""
        lines = stack_lines(self.T_b_f, self.fits)
        if self.target is not None:
            return [solve_closed_form(lines, self.target.plane).T_f_s]
        return unknown_plane_starts(lines)

    def model_at_sensor_pose(self, T_f_s: Array) -> tuple[PlaneModel, Array]:
        """The plane as touched, or through all points."""
        target = self.target or plane_through_lines(self.T_b_f, self.fits, T_f_s)
        lines = stack_lines(self.T_b_f, self.fits)
        return PlaneModel(lines, target, self.noise, self.by_laser, self.by_arm), np.zeros(3)


def unknown_plane_starts(lines: LineBundle, count: int = MAX_REFINED_STARTS) -> list[Array]:
    """Starting values of T_f_s, shape (4, 4), for lines on an unknown plane, the best first.

    For each of many normals over a half sphere, eq. (21) gives the rotation; position and the
    plane's distance then follow linearly from the lines' centroids.

    Parameters
    ----------
    lines : LineBundle
        Lines on one plane.
    count : int
        How many starts to return.
    """
    u = half_sphere_directions(PLANE_NORMALS_TRIED)
    both, _ = rotation_candidates(rotation_equations(lines, u))  # (g, 2, 3, 3)
    u_f = np.einsum("nji,gj->gni", lines.R_b_f, u)
    centroid_f = np.einsum("gkij,nj->gkni", both, lines.points_s)
    a_f = np.einsum("gkij,nj->gkni", both, lines.directions_s)
    tilt = np.einsum("gni,gkni->gkn", u_f, a_f)
    known = np.einsum("gni,gkni->gkn", u_f, centroid_f) + (lines.p_b_f @ u.T).T[:, None]
    A = np.concatenate((u_f, np.ones((*u_f.shape[:2], 1))), axis=2)
    solution = -np.einsum("gij,gkj->gki", np.linalg.pinv(A), known)  # p_f_s and u0
    offset = known + np.einsum("gnj,gkj->gkn", A, solution)
    cost = (offset / MISFIT_OFFSET_SCALE) ** 2 + (tilt / MISFIT_TILT_SCALE) ** 2
    order = np.argsort(cost.sum(axis=2), axis=None)
    found: list[Array] = []
    for g, k in zip(*np.unravel_index(order, cost.shape[:2]), strict=True):
        p_f_s, plane = solution[g, k, :3], PluckerPlane(u[g], solution[g, k, 3])
        # A sensor and a flange on different sides of the board are a mirror image.
        if sensor_on_flange_side_share(lines, plane, p_f_s) > 0.5:
            found.append(pose(both[g, k], p_f_s))
        if len(found) == count:
            break
    return found


def half_sphere_directions(count: int) -> Array:
    """Unit vectors with z ≥ 0, evenly spread (Fibonacci lattice), shape (count, 3)."""
    k = np.arange(count)
    z = (k + 0.5) / count
    turn = k * np.pi * (3 - np.sqrt(5))
    r = np.sqrt(1 - z**2)
    return np.column_stack((r * np.cos(turn), r * np.sin(turn), z))


def plane_through_lines(T_b_f: Array, fits: Sequence[LineFit], T_f_s: Array) -> PlaneTarget:
    """The unknown plane through both ends of all lines, its normal towards the flange.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.
    fits : sequence of LineFit
        The line seen from each.
    T_f_s : ndarray, shape (4, 4)
        About how the sensor sits.
    """
    ends = np.stack(
        [
            transform_points(
                T, [fit.point_s + side * fit.span * fit.direction_s for side in (-0.5, 0.5)]
            )
            for T, fit in zip(T_b_f @ T_f_s, fits, strict=True)
        ]
    ).reshape(-1, 3)
    centre = ends.mean(axis=0)
    u = np.linalg.svd(ends - centre)[2][2]
    if u @ (T_b_f[:, :3, 3].mean(axis=0) - centre) < 0:
        u = -u
    near = (T_b_f[0] @ T_f_s @ np.append(fits[0].point_s, 1.0))[:3]
    return PlaneTarget.from_unknown_plane(PluckerPlane(u, -float(u @ centre)), near)


def fit_plane(
    points_b: ArrayLike,
    sigma: float,
    side_b: ArrayLike | None = None,
    *,
    geometry: float = 0.0,
    by_arm: Array | None = None,
) -> PlaneTarget:
    """Fit the plane through points touched with the arm's probe tip.

    Parameters
    ----------
    points_b : array_like, shape (n, 3)
        Where the tip touched, frame b, in metres; n ≥ 3.
    sigma : float
        Standard deviation of a touched point in each axis, in metres.
    side_b : array_like, shape (3,), optional
        A point on the side of the plane that its normal shall point to, such as the flange.
    geometry : float
        Standard deviation of the arm's geometry error, metres: points that are touched near each
        other err alike; see `tjscan.calibration.noise`.
    by_arm : ndarray, shape (n, 3, m), optional
        How the tip moves with draws of the arm's geometry, for an error of one metre, where the
        arm's postures are known; see `ArmGeometryDeviation.flange_motion`.

    Raises
    ------
    CalibrationRefused
        If the points are too few, collinear or too close together to fix a plane, or do not
        lie on one within the stated noise.
    """
    points = np.asarray(points_b, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ValueError(f"touched points are finite and of shape (n, 3), not {points.shape}")
    if len(points) < MIN_TOUCHES:
        raise CalibrationRefused(
            "too few touched points", f"{len(points)} were touched, a plane needs three or more"
        )
    centre = points.mean(axis=0)
    _, singular, axes = np.linalg.svd(points - centre, full_matrices=len(points) < 4)
    u = axes[2]
    if side_b is not None and u @ (np.asarray(side_b, dtype=float) - centre) < 0:
        u = -u
    residuals = (points - centre) @ u
    _check_touch_span(singular, sigma)
    across = np.column_stack(((points - centre) @ axes[:2].T, np.ones(len(points))))
    own, gain = sigma**2 * np.eye(len(points)), np.linalg.pinv(across)
    if by_arm is None:
        metres = np.linalg.norm(points[:, None] - points, axis=2)
        covariance = own + geometry**2 * np.exp(-0.5 * (metres / TYPICAL_FLANGE_LEVER) ** 2)
        information, moves = np.linalg.inv(gain @ covariance @ gain.T), None
    else:
        off = np.einsum("i,nim->nm", u, by_arm)
        covariance = own + geometry**2 * (off @ off.T)
        information, moves = np.linalg.inv(gain @ own @ gain.T), -gain @ off
    _check_flatness(residuals, across, covariance, sigma)
    plane = plane_through_point(centre, u)
    return PlaneTarget(plane, centre, axes[:2], information, residuals, singular, moves)


def plane_of_statement(stated: TargetStatement, noise: NoiseModel) -> PlaneTarget | None:
    """The plane as touched or stated; None if it is unknown.

    One that the user states is as sure as one touched at the corners of a square with side
    `STATED_PLANE_SQUARE_SIDE`; its normal may point either way.
    """
    points_b = stated.touched
    if stated.plane is not None:
        plane = PluckerPlane(np.array(stated.plane[:3]), 1e-3 * stated.plane[3])
        bare = PlaneTarget.from_unknown_plane(plane, stated.flange_b)
        corners = STATED_PLANE_SQUARE_SIDE / 2 * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
        points_b = bare.centre_b + corners @ bare.axes_b
    if points_b is None:
        return None
    return fit_plane(points_b, noise.touch, stated.flange_b, geometry=noise.geometry)


def _check_touch_span(singular: Array, sigma: float) -> None:
    tilt = sigma / max(singular[1], 1e-12)
    if singular[1] > MIN_TOUCH_PATTERN_RATIO * singular[0] and tilt < MAX_NORMAL_SIGMA:
        return
    shown = ", ".join(f"{1e3 * s:.2f}" for s in singular)
    raise CalibrationRefused(
        "touched points nearly on one line",
        f"their singular values are {shown} mm and leave the plane's normal uncertain by "
        f"{min(np.degrees(tilt), 90):.2f}°; touch points that span a wide triangle or rectangle",
    )


def _check_flatness(residuals: Array, across: Array, covariance: Array, sigma: float) -> None:
    dof = len(residuals) - 3
    if dof == 0:
        return
    # What no plane explains, in as many axes as there are degrees of freedom.
    rest = np.linalg.svd(across)[0][:, 3:]
    left = residuals @ rest
    if (
        chdtrc(dof, left @ np.linalg.solve(rest.T @ covariance @ rest, left))
        > MIN_TOUCH_PROBABILITY
    ):
        return
    shown = ", ".join(f"{1e3 * r:+.3f}" for r in residuals)
    worst = int(np.argmax(np.abs(residuals))) + 1
    raise CalibrationRefused(
        NOT_FLAT_REASON,
        f"their distances from the best plane are {shown} mm, more than {1e3 * sigma:.3f} mm of "
        f"noise explain; touch number {worst} again first, then check that the board is flat",
    )
