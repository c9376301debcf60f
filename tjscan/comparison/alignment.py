"""Bringing what was measured onto its reference: iterated closest points with a robust kernel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import KDTree

from tjscan.core.errors import ComparisonRefused
from tjscan.core.frames import Array, frozen_arrays, pose, rotation_angle_between, transform_points
from tjscan.core.robust import TUKEY_CUTOFF, mad_sigma

MOST_ALIGNED_POINTS: Final = 30_000
"""Points that are aligned; more would not make six numbers surer."""

MOST_ROUNDS: Final = 100
CONVERGED_STEP: Final = 1e-7
"""Metres that the farthest point moves in a round when it is time to stop."""

MOST_PARTNER_DISTANCE: Final = 20e-3
"""Metres; a point farther from the reference than this is no partner of anything."""

NOISE_FLOOR: Final = 20e-6
"""Metres; residuals are never taken for more certain than this."""

LEAST_FITNESS: Final = 0.6
"""Share of the points that must have a partner in the end."""

LEAST_STIFFNESS: Final = 1e-4
"""Smallest eigenvalue of the mean normal matrix; lengths count in radii of the cloud."""

NORMAL_NEIGHBOURS: Final = 12

LINE_VARIANCE_RATIO: Final = 0.02
"""Variance across over variance along, below which neighbours lie on a line."""

NearestOnReference = Callable[[Array], tuple[Array, Array]]
"""Maps points to their nearest ones on the reference, and the normals there."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class Alignment:
    """Result of an alignment: the pose that brings what was measured onto its reference, and fit.

    Parameters
    ----------
    method : str
        ``none``, ``joint`` or ``icp``.
    T : ndarray, shape (4, 4)
        Maps what was measured into the reference's frame.
    fitness : float
        Share of the points that have a partner.
    residual : float
        Root mean square distance of these from the planes of their partners, metres; from the
        reference, where tubes were brought together.
    rounds : int
        How many it took.
    moved : float
        Root mean square of how far the points moved, metres.
    note : str
        What to know of it; empty if there is nothing.
    """

    method: str
    T: Array
    fitness: float = 1.0
    residual: float = 0.0
    rounds: int = 0
    moved: float = 0.0
    note: str = ""

    @property
    def rotation_angle(self) -> float:
        """Angle of the alignment's rotation, radians."""
        return rotation_angle_between(np.eye(4), self.T)


NO_ALIGNMENT: Final = Alignment("none", np.eye(4))


def nearest_point_finder_in_cloud(points: Array) -> NearestOnReference:
    """Function that finds nearest points in a cloud, shape (n, 3), and estimated normals.

    Raises
    ------
    ComparisonRefused
        If the points lie on separate lines, where neighbours give no normal.
    """
    import open3d as o3d

    # A copy, for Open3D takes no array that is read-only.
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.array(points)))
    nearest = o3d.geometry.KDTreeSearchParamKNN(NORMAL_NEIGHBOURS)
    cloud.estimate_covariances(nearest)
    spread = np.linalg.eigvalsh(np.asarray(cloud.covariances))
    if np.median(spread[:, 1]) < LINE_VARIANCE_RATIO * np.median(spread[:, 2]):
        raise ComparisonRefused(
            "the reference's points lie on separate lines, which give no direction across: align "
            "to a mesh or to a denser cloud"
        )
    cloud.estimate_normals(nearest)
    normals, tree = np.asarray(cloud.normals).copy(), KDTree(points)

    def partner(moved: Array) -> tuple[Array, Array]:
        _, at = tree.query(moved)
        return points[at], normals[at]

    return partner


def align_icp(points: Array, partner: NearestOnReference) -> Alignment:
    """Align points to a reference by iterative closest points, beginning where they are.

    Each round Open3D solves point to plane with Tukey's kernel, whose width follows the median
    residual; partners are exact nearest points.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Metres.
    partner : callable
        The reference.

    Raises
    ------
    ComparisonRefused
        If too few points lie on the reference, or they leave a direction free.
    """
    import open3d as o3d

    points = points[:: max(1, len(points) // MOST_ALIGNED_POINTS)]
    centre = points.mean(axis=0)
    registration = o3d.pipelines.registration
    T, rounds, move = np.eye(4), 0, np.inf
    while True:
        moved = transform_points(T, points)
        feet, normals = partner(moved)
        apart = np.linalg.norm(moved - feet, axis=1)
        off = np.abs(np.sum((moved - feet) * normals, axis=1))
        near = apart < MOST_PARTNER_DISTANCE
        if near.mean() < LEAST_FITNESS:
            raise ComparisonRefused(
                f"{100 * near.mean():.0f} % of the points lie within "
                f"{1e3 * MOST_PARTNER_DISTANCE:.0f} mm of the "
                f"reference, {100 * LEAST_FITNESS:.0f} % must: they overlap too little, or begin "
                "too far apart to be aligned from where they are"
            )
        width = 3 * max(mad_sigma(off[near]), NOISE_FLOOR)
        if move < CONVERGED_STEP or rounds == MOST_ROUNDS:
            break
        source = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(moved[near] - centre))
        target = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(feet[near] - centre))
        target.normals = o3d.utility.Vector3dVector(normals[near])
        estimate = registration.TransformationEstimationPointToPlane(
            registration.TukeyLoss(TUKEY_CUTOFF / 3 * width)
        )
        same = np.arange(near.sum(), dtype=np.int32)
        pairs = o3d.utility.Vector2iVector(np.column_stack((same, same)))
        _check_stiffness(moved[near] - centre, normals[near])
        step = np.asarray(estimate.compute_transformation(source, target, pairs))
        step = pose(p=centre) @ step @ pose(p=-centre)
        move = float(np.linalg.norm(transform_points(step, moved) - moved, axis=1).max())
        T, rounds = step @ T, rounds + 1
    held = near & (off < width)
    fitness = float(held.mean())
    if fitness < LEAST_FITNESS:
        raise ComparisonRefused(
            f"only {100 * fitness:.0f} % of the points come to lie on the reference, "
            f"{100 * LEAST_FITNESS:.0f} % must: they show something else for the most part"
        )
    residual = float(np.sqrt(np.mean(off[held] ** 2)))
    far = float(np.sqrt(np.mean(np.sum((transform_points(T, points) - points) ** 2, axis=1))))
    return Alignment("icp", T, fitness, residual, rounds, far)


def _check_stiffness(points: Array, normals: Array) -> None:
    """Refuse points that could slide or turn on the reference unnoticed."""
    radius = float(np.sqrt(np.mean(np.sum(points * points, axis=1))))
    J = np.column_stack((np.cross(points / radius, normals), normals))
    least = float(np.linalg.eigvalsh(J.T @ J / len(J))[0])
    if least < LEAST_STIFFNESS:
        raise ComparisonRefused(
            f"the points could slide or turn along the reference (stiffness {least:.1e}, "
            f"{LEAST_STIFFNESS:g} is needed): they hold no pose. Compare more of the surface, or "
            "with --align none"
        )
