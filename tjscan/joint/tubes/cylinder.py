"""A tube's outer wall as a cylinder, and how far points lie outside it."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core import frames
from tjscan.core.errors import TubesNotFound
from tjscan.core.frames import Array, array_dataclass
from tjscan.core.robust import mad_sigma, tukey_root_weights


@array_dataclass
class Cylinder:
    """A cylinder of unlimited length.

    Parameters
    ----------
    point : ndarray, shape (3,)
        A point on its axis, amid the points that it was fitted to, metres.
    axis : ndarray, shape (3,)
        Unit vector along the axis.
    radius : float
        Metres.
    """

    point: Array
    axis: Array
    radius: float

    def __post_init__(self) -> None:
        axis = frames.unit_vector(np.asarray(self.axis, dtype=float))
        object.__setattr__(self, "axis", frames.readonly_copy(axis))

    def signed_distances(self, points: Array) -> Array:
        """Distances of points, shape (..., 3), outside the cylinder, in metres."""
        return np.asarray(np.linalg.norm(self._radial_vectors(points), axis=-1) - self.radius)

    def normals(self, points: Array) -> Array:
        """Outward unit normals, shape (..., 3), at or beside points off the axis."""
        return frames.unit_vectors(self._radial_vectors(points))

    def transformed(self, T: Array) -> Cylinder:
        """The same cylinder in the outer frame of `T`, shape (4, 4)."""
        return Cylinder(frames.transform_points(T, self.point), T[:3, :3] @ self.axis, self.radius)

    def recentred_beside(self, points: Array) -> Cylinder:
        """The same cylinder with its `point` beside the middle of points, shape (n, 3)."""
        along = (points.mean(axis=0) - self.point) @ self.axis
        return Cylinder(self.point + along * self.axis, self.axis, self.radius)

    def boxplus(self, step: Array) -> Cylinder:
        """A cylinder near this one, a small step away.

        Parameters
        ----------
        step : ndarray, shape (5,)
            Shift along two directions square to the axis (metres), tilt of the axis towards
            these (radians), growth of the radius (metres).
        """
        across = perpendicular_pair(self.axis)
        point, axis = self.point + step[:2] @ across, self.axis + step[2:4] @ across
        return Cylinder(point, axis, self.radius + step[4])

    def jacobian(self, points: Array) -> Array:
        """Derivatives of `distance` by `boxplus`'s numbers, shape (n, 5)."""
        sideways = self.normals(points) @ perpendicular_pair(self.axis).T
        along = (points - self.point) @ self.axis
        return -np.column_stack((sideways, along[:, None] * sideways, np.ones(len(points))))

    def _radial_vectors(self, points: Array) -> Array:
        q = points - self.point
        return np.asarray(q - (q @ self.axis)[..., None] * self.axis)


def perpendicular_pair(axis: Array) -> Array:
    """Two unit vectors, rows of shape (2, 3), square to each other and to a unit vector."""
    first = frames.unit_vector(np.cross(axis, np.eye(3)[np.abs(axis).argmin()]))
    return np.array((first, np.cross(axis, first)))


FIRST_REACH_FROM_CYLINDER: Final = 3e-3
"""Metres from a rough cylinder within which its points are sought at first."""

LEAST_POINT_SIGMA: Final = 10e-6
"""Metres; points are never taken for more certain than this."""

INLIER_REACH_SIGMAS: Final = 6.0
"""Standard deviations within which the spread is estimated again."""

MOST_CYLINDER_REFINEMENTS: Final = 100
CONVERGED_CYLINDER_STEP: Final = 1e-8
"""Metres and radians that no number moves by any more in the end."""

LEAST_NORMAL_SPREAD: Final = 0.05
"""Least singular value over the largest by which normals fix an axis: 10° round the tube."""

FEWEST_CYLINDER_POINTS: Final = 12
"""Points that a cylinder is fitted to."""


def cylinder_from_normals(points: Array, normals: Array) -> Cylinder:
    """Rough cylinder of points and normals, to start a fit from.

    The axis is what all normals are square to; seen along it, ``p = centre + radius n`` is
    linear in the rest.

    Parameters
    ----------
    points, normals : ndarray, shape (n, 3)
        On the wall, and outward there; n is 3 or more.

    Raises
    ------
    TubesNotFound
        If the normals turn too little to fix an axis.
    """
    if len(points) < 3:
        raise TubesNotFound(f"{len(points)} places on a wall are too few for a cylinder")
    _, spread, directions = np.linalg.svd(normals, full_matrices=False)
    if spread[1] < LEAST_NORMAL_SPREAD * spread[0]:
        raise TubesNotFound(
            "the wall was seen over too little of its circumference to show where its axis is: "
            "scan farther round"
        )
    axis = directions[2]
    plane = perpendicular_pair(axis)
    p, n = points @ plane.T, normals @ plane.T
    rows = [np.column_stack((np.tile(np.eye(2)[k], (len(p), 1)), n[:, k])) for k in (0, 1)]
    (*centre, radius), *_ = np.linalg.lstsq(np.concatenate(rows), p.T.ravel(), rcond=None)
    if radius < 0:  # the normals pointed inwards
        radius = -radius
    return Cylinder(np.array(centre) @ plane, axis, float(radius)).recentred_beside(points)


def fit_cylinder(start: Cylinder, points: Array, scale: float) -> tuple[Cylinder, bool]:
    """Fit a cylinder by least squares with Cauchy's loss, which converges from far away.

    Parameters
    ----------
    start : Cylinder
        Right to some centimetres.
    points : ndarray, shape (n, 3)
        Most of them on the wall, metres.
    scale : float
        Distance from the cylinder beyond which points lose weight, metres.

    Returns
    -------
    cylinder : Cylinder
        The fit; `start` if there are too few points.
    converged : bool
        Whether the points hold it.
    """
    if len(points) < FEWEST_CYLINDER_POINTS:
        return start, False
    tube = start.recentred_beside(points)

    def distance(step: Array) -> Array:
        return tube.boxplus(step).signed_distances(points)

    def jacobian(step: Array) -> Array:
        return tube.boxplus(step).jacobian(points)

    from scipy.optimize import least_squares  # heavy, and no job that is only read needs it

    found = least_squares(
        distance,
        np.zeros(5),
        jac=jacobian,
        loss="cauchy",
        f_scale=scale,
        x_scale=(0.1, 0.1, 1.0, 1.0, 0.1),
        max_nfev=40,
    )
    return tube.boxplus(found.x).recentred_beside(points), bool(found.success)


def refine_cylinder(tube: Cylinder, points: Array) -> Cylinder:
    """Refine a cylinder by least squares with Tukey's kernel.

    However the search began, it ends at the same cylinder: a wall holds far more points than
    ghosts and corners bring near it.

    Parameters
    ----------
    tube : Cylinder
        Right to a few millimetres.
    points : ndarray, shape (n, 3)
        Of the wall and of anything else, metres.
    """
    reach = FIRST_REACH_FROM_CYLINDER
    for _ in range(MOST_CYLINDER_REFINEMENTS):
        off = tube.signed_distances(points)
        near = np.abs(off) < reach
        if near.sum() <= 5:
            return tube
        sigma = max(mad_sigma(off[near]), LEAST_POINT_SIGMA)
        root = np.where(near, tukey_root_weights(off / sigma), 0.0)
        jacobian = tube.jacobian(points)
        solved, *_ = np.linalg.lstsq(root[:, None] * jacobian, -root * off)
        step = np.asarray(solved, dtype=float)
        tube = tube.boxplus(step)
        if np.abs(step).max() < CONVERGED_CYLINDER_STEP:
            break
        reach = INLIER_REACH_SIGMAS * sigma
    return tube.recentred_beside(points[near])
