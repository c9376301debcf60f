"""Leg and brace fitted together to the walls that one arm saw.

Every view has an error of its own, the arm's, that all its points share. It is larger than the
points' own noise, so that views are weighed, not points: the residuals of a view are whitened
with their common covariance.

The joint's own frame j is made of these two tubes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import radians
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core import pose_vector
from tjscan.core.errors import TubesNotFound
from tjscan.core.frames import Array, Mask, array_dataclass, inverse_pose, pose, unit_vector
from tjscan.core.robust import mad_sigma, tukey_weights
from tjscan.joint.tubes.cylinder import Cylinder


@dataclass(frozen=True, slots=True)
class ArmRepeatability:
    """Errors of the flange's pose that an arm reports; all points of a view share them.

    The defaults are the assumption that the simulated arm is made of.

    Parameters
    ----------
    position, angle : float
        Root mean square of the distance (metres) and of the angle (radians) between where the
        flange is and where the arm reports it.
    """

    position: float = 5e-5
    angle: float = 1e-4

    @property
    def covariance(self) -> Array:
        """Covariance of translation and rotation vector of the flange, shape (6, 6)."""
        return np.diag(np.repeat(np.square([self.position, self.angle]) / 3, 3))


@array_dataclass
class WallPoints:
    """Points on the walls of brace and leg, by view, with their standard deviations.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Metres, in the frame of the arm's poses.
    on_brace : ndarray, shape (n,)
        True on the brace, False on the leg.
    sigma : ndarray, shape (n,)
        Standard deviation of each point by itself along the wall's normal, metres.
    view : ndarray, shape (n,)
        Which view each was seen in, from 0.
    pivots : ndarray, shape (m, 3)
        Where the flange was in each of m views.
    """

    points: Array
    on_brace: Mask
    sigma: Array
    view: NDArray[np.intp]
    pivots: Array

    def __len__(self) -> int:
        return len(self.points)

    def indices_by_view(self) -> list[NDArray[np.intp]]:
        """Indices of the points of each view that has any."""
        order = np.argsort(self.view, kind="stable")
        return np.split(order, np.flatnonzero(np.diff(self.view[order])) + 1)


MOST_FIT_ROUNDS: Final = 60
CONVERGED_TUBE_FIT_STEP: Final = 1e-9
"""Metres and radians that no parameter moves by any more when a fit ends."""

LEAST_POINT_WEIGHT: Final = 1e-6

FEWEST_TUBE_FIT_VIEWS: Final = 3

TUBE_DERIVATIVE_STEP: Final = 1e-6
"""Metres and radians between tubes whose difference is a derivative: deep in the linear range."""


@array_dataclass
class FittedTubes:
    """Brace and leg as fitted cylinders, with their covariance.

    Parameters
    ----------
    brace, leg : Cylinder
        In the frame of the points.
    covariance : ndarray, shape (10, 10)
        Of `Cylinder.boxplus`'s numbers of the brace, then of the leg. It is scaled up if the
        points are farther from cylinders than their errors explain, as on tubes out of round.
    reduced_chi2 : float
        Chi-squared over what is expected of it; about 1 if the tubes are round and the stated
        errors true.
    rms : float
        Of the points that count, about the cylinders, metres.
    by_points : ndarray, shape (n, 10, 3)
        How these numbers change as each wall point moves. Empty if points have no views.
    """

    brace: Cylinder
    leg: Cylinder
    covariance: Array
    reduced_chi2: float
    rms: float
    by_points: Array = field(default_factory=lambda: np.zeros((0, 10, 3)))

    def jacobian_of(self, function: Callable[[Cylinder, Cylinder], Array]) -> Array:
        """Derivatives of a function of brace and leg by their numbers, shape (m, 10)."""

        def value(change: Array) -> Array:
            return function(self.brace.boxplus(change[:5]), self.leg.boxplus(change[5:]))

        changes = TUBE_DERIVATIVE_STEP * np.eye(10)
        columns = [
            (value(change) - value(-change)) / (2 * TUBE_DERIVATIVE_STEP) for change in changes
        ]
        return np.column_stack(columns)


def fit_tubes_to_walls(
    walls: WallPoints,
    repeatability: ArmRepeatability,
    brace: Cylinder,
    leg: Cylinder,
    shared_moves: Array | None = None,
) -> FittedTubes:
    """Fit leg and brace to wall points; Gauss–Newton, reweighted with Tukey's kernel.

    Parameters
    ----------
    walls : WallPoints
        What was seen.
    repeatability : ArmRepeatability
        Of the arm that carried the laser.
    brace, leg : Cylinder
        Where to start.
    shared_moves : ndarray, shape (n, 3, k), optional
        How each point moves, metres, by k standard normal draws that all views share: residuals
        may be larger by these before they widen the covariance, which does not hold them
        otherwise.

    Raises
    ------
    TubesNotFound
        If the points don't hold both cylinders.
    """
    if len(views := walls.indices_by_view()) < FEWEST_TUBE_FIT_VIEWS:
        raise TubesNotFound(f"{len(views)} views of the walls are too few for two cylinders")
    common = repeatability.covariance
    brace = brace.recentred_beside(walls.points[walls.on_brace])
    leg = leg.recentred_beside(walls.points[~walls.on_brace])
    weights = np.ones(len(walls))
    for count in range(MOST_FIT_ROUNDS):
        residuals, jacobian, shared = _linearised_distances(walls, brace, leg)
        own = np.einsum("ij,jk,ik->i", shared, common, shared) + walls.sigma**2
        if count:
            standard = residuals / np.sqrt(own)
            weights = tukey_weights(standard / max(1.0, mad_sigma(standard)), LEAST_POINT_WEIGHT)
        own_variance = walls.sigma**2 / weights
        rows = np.column_stack((jacobian, residuals))
        white = _whitened_rows(rows, shared, own_variance, common, views)
        solved, _, rank, _ = np.linalg.lstsq(white[:, :-1], -white[:, -1], rcond=1e-10)
        step = np.asarray(solved, dtype=float)
        if rank < 10 or not np.abs(step).max() < 1.0:
            message = "the walls that were seen leave leg or brace free to move: scan farther round"
            raise TubesNotFound(message)
        brace, leg = brace.boxplus(step[:5]), leg.boxplus(step[5:])
        if count > 1 and np.abs(step).max() < CONVERGED_TUBE_FIT_STEP:
            break
    counted = weights > 0.1
    reduced_chi2 = float(white[:, -1] @ white[:, -1]) / max(int(counted.sum()) - 10, 1)
    spread = np.asarray(np.linalg.inv(white[:, :-1].T @ white[:, :-1]), dtype=float)
    rms = float(np.sqrt(np.mean(residuals[counted] ** 2)))
    # Twice whitened: by the inverse of the covariance, as normal equations weigh residuals.
    normals, A = shared[:, :3], white[:, :-1]
    weighed = np.empty_like(jacobian)
    for chosen in views:
        factor = _covariance_factor(shared[chosen], own_variance[chosen], common)
        weighed[chosen] = np.linalg.solve(factor.T, A[chosen])
    by_points = (-weighed @ spread)[:, :, None] * normals[:, None]
    expected = 1.0
    if shared_moves is not None:
        across = np.einsum("ni,nik->nk", normals, shared_moves)
        moved = _whitened_rows(across, shared, own_variance, common, views)
        left = (moved - A @ (spread @ (A.T @ moved)))[counted]
        expected += float(np.sum(left**2)) / max(int(counted.sum()) - 10, 1)
    reduced_chi2 /= expected
    return FittedTubes(brace, leg, max(1.0, reduced_chi2) * spread, reduced_chi2, rms, by_points)


def _linearised_distances(
    walls: WallPoints, brace: Cylinder, leg: Cylinder
) -> tuple[Array, Array, Array]:
    """Distances (n,), their derivatives by the tubes (n, 10) and by their view's pose (n, 6)."""
    distance, normals = np.empty(len(walls)), np.empty((len(walls), 3))
    jacobian = np.zeros((len(walls), 10))
    for tube, chosen, columns in (
        (brace, walls.on_brace, slice(0, 5)),
        (leg, ~walls.on_brace, slice(5, 10)),
    ):
        points = walls.points[chosen]
        distance[chosen], normals[chosen] = tube.signed_distances(points), tube.normals(points)
        jacobian[chosen, columns] = tube.jacobian(points)
    levers = walls.points - walls.pivots[walls.view]
    return distance, jacobian, np.column_stack((normals, np.cross(levers, normals)))


def _whitened_rows(
    rows: Array, shared: Array, own: Array, common: Array, views: list[np.ndarray]
) -> Array:
    """Rows (n, k) made independent and of unit variance, view by view."""
    white = np.empty_like(rows)
    for chosen in views:
        factor = _covariance_factor(shared[chosen], own[chosen], common)
        white[chosen] = np.linalg.solve(factor, rows[chosen])
    return white


def _covariance_factor(shared: Array, own: Array, common: Array) -> Array:
    """Cholesky factor of the covariance of a view's residuals."""
    return np.asarray(np.linalg.cholesky(shared @ common @ shared.T + np.diag(own)))


def dihedral_angles(brace: Cylinder, leg: Cylinder, points: Array) -> Array:
    """Angle between the outer walls of brace and leg where they meet, in the plane square to both.

    180° less the angle between the outward normals: 90° at the crown of a T-joint, more towards
    its saddle.

    Parameters
    ----------
    brace, leg : Cylinder
        In one frame.
    points : ndarray, shape (n, 3)
        At or beside the line where they meet, metres.

    Returns
    -------
    ndarray, shape (n,)
        Radians.
    """
    cosines = np.sum(brace.normals(points) * leg.normals(points), axis=1)
    return np.asarray(np.pi - np.arccos(np.clip(cosines, -1, 1)))


def dihedral_sigmas(tubes: FittedTubes, points: Array) -> Array:
    """Standard deviations of `dihedral_angles` by the tubes' covariance, shape (n,), radians.

    Parameters
    ----------
    tubes : FittedTubes
        Brace and leg.
    points : ndarray, shape (n, 3)
        Metres.
    """
    jacobian = tubes.jacobian_of(lambda brace, leg: dihedral_angles(brace, leg, points))
    return np.asarray(np.sqrt(np.sum((jacobian @ tubes.covariance) * jacobian, axis=1)))


LEAST_BRACE_LEAN: Final = radians(2.0)
"""A brace that leans less has no heel: x may point either way along the leg."""

LEAST_AXES_ANGLE: Final = radians(15.0)
"""Tubes nearer to parallel than this make no joint."""


@dataclass(frozen=True, slots=True)
class TubeDimensions:
    """Dimensions of a pair of tubes: radii, angle between the axes, and their offset.

    Parameters
    ----------
    brace_radius, leg_radius : float
        Metres.
    angle : float
        Between the axes, on the heel's side, radians.
    offset : float
        How far the leg's axis passes the brace's, along y of j, metres.
    """

    brace_radius: float
    leg_radius: float
    angle: float
    offset: float

    @property
    def as_array(self) -> Array:
        """The four numbers as an array, shape (4,)."""
        return np.array((self.brace_radius, self.leg_radius, self.angle, self.offset))


@array_dataclass
class JointFrame:
    """Frame j as fitted tubes define it: its pose and covariance.

    Parameters
    ----------
    T : ndarray, shape (4, 4)
        Frame j in the frame of the tubes.
    shape : TubeDimensions
        Radii, angle and offset of the tubes.
    covariance : ndarray, shape (10, 10)
        Of the pose, as translation and rotation vector in j (metres, radians), then of the
        shape's four numbers.
    by_points : ndarray, shape (n, 10, 3)
        How these change as each wall point moves in the frame of the tubes, see `FittedTubes`.
    """

    T: Array
    shape: TubeDimensions
    covariance: Array
    by_points: Array = field(default_factory=lambda: np.zeros((0, 10, 3)))


def joint_frame_from_tubes(tubes: FittedTubes, towards: Array) -> JointFrame:
    """Frame j of two tubes, with its covariance.

    Parameters
    ----------
    tubes : FittedTubes
        Brace and leg; the brace's `point` lies on the brace's side of the leg.
    towards : ndarray, shape (3,)
        For an upright brace: x points along the leg to the side that this vector points to. Half
        a turn about the brace changes nothing else. A leaning brace has a heel, which decides.

    Raises
    ------
    TubesNotFound
        If the tubes are all but parallel.
    """
    T, shape = joint_pose_from_cylinders(tubes.brace, tubes.leg, towards)

    def motion_and_shape(brace: Cylinder, leg: Cylinder) -> Array:
        T_moved, there = joint_pose_from_cylinders(brace, leg, T[:3, 0])
        motion = pose_vector.pose_to_vector(inverse_pose(T) @ T_moved)
        return np.concatenate((motion, there.as_array))

    jacobian = tubes.jacobian_of(motion_and_shape)
    covariance = jacobian @ tubes.covariance @ jacobian.T
    return JointFrame(T, shape, covariance, jacobian @ tubes.by_points)


def joint_pose_from_cylinders(
    brace: Cylinder, leg: Cylinder, towards: Array
) -> tuple[Array, TubeDimensions]:
    """Pose of frame j, and the tubes' dimensions, from two cylinders.

    Parameters
    ----------
    brace, leg : Cylinder
        In one frame; the brace's `point` lies on the brace's side of the leg.
    towards : ndarray, shape (3,)
        The side that x points to if the brace is upright, see `joint_frame_from_tubes`.

    Returns
    -------
    T : ndarray, shape (4, 4)
        Pose of frame j in the frame of the cylinders.
    shape : TubeDimensions
        Radii, angle and offset of the tubes.
    """
    cosine = float(brace.axis @ leg.axis)
    if 1 - cosine * cosine < np.sin(LEAST_AXES_ANGLE) ** 2:
        message = "the two tubes that were found are all but parallel: they make no joint"
        raise TubesNotFound(message)
    # Where the axes come nearest: the joining line is square to both.
    between = leg.point - brace.point
    along = (between @ brace.axis - cosine * (between @ leg.axis)) / (1 - cosine * cosine)
    origin = brace.point + along * brace.axis
    z = -np.sign(along) * brace.axis
    leaning = abs(np.arccos(abs(cosine)) - np.pi / 2) > LEAST_BRACE_LEAN
    to_heel = leg.axis * (np.sign(leg.axis @ z) if leaning else np.sign(leg.axis @ towards) or 1.0)
    x = unit_vector(to_heel - (to_heel @ z) * z)
    y = np.cross(z, x)
    angle = float(np.arctan2(to_heel @ x, to_heel @ z))
    shape = TubeDimensions(brace.radius, leg.radius, angle, float((leg.point - origin) @ y))
    return pose(np.column_stack((x, y, z)), origin), shape
