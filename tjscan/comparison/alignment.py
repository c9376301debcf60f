"""Bringing what was measured onto its reference: by closest points, or by both joints' tubes."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, Final

import numpy as np
from scipy.spatial import KDTree

from tjscan.comparison.distance import MeshDistance, distances_to_cloud
from tjscan.comparison.shapes import Mesh, Shape
from tjscan.core.errors import ComparisonRefused, TubesNotFound
from tjscan.core.frames import (
    Array,
    Mask,
    array_dataclass,
    inverse_pose,
    pose,
    rot_z,
    rotation_angle_between,
    transform_points,
)
from tjscan.core.robust import TUKEY_CUTOFF, mad_sigma
from tjscan.joint.tubes.find import find_tubes_in_cloud
from tjscan.joint.tubes.fit import JointFrame, joint_frame_from_tubes

MOST_ALIGNED_POINTS: Final = 30_000
"""Points that are aligned; more would not make six numbers surer."""

MOST_ICP_ROUNDS: Final = 100
CONVERGED_ICP_MOVE: Final = 1e-7
"""Metres that the farthest point moves in a round when it is time to stop."""

MOST_PARTNER_DISTANCE: Final = 20e-3
"""Metres; a point farther from the reference than this is no partner of anything."""

LEAST_RESIDUAL_SIGMA: Final = 20e-6
"""Metres; residuals are never taken for more certain than this."""

LEAST_PARTNER_SHARE: Final = 0.6
"""Share of the points that must have a partner in the end."""

LEAST_ALIGNMENT_STIFFNESS: Final = 1e-4
"""Smallest eigenvalue of the mean normal matrix; lengths count in radii of the cloud."""

NEIGHBOURS_FOR_NORMAL: Final = 12

LINE_VARIANCE_RATIO: Final = 0.02
"""Variance across over variance along, below which neighbours lie on a line."""

NearestOnReference = Callable[[Array], tuple[Array, Array]]
"""Maps points to their nearest ones on the reference, and the normals there."""


@array_dataclass
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
    nearest = o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS_FOR_NORMAL)
    cloud.estimate_covariances(nearest)
    spread = np.linalg.eigvalsh(np.asarray(cloud.covariances))
    if np.median(spread[:, 1]) < LINE_VARIANCE_RATIO * np.median(spread[:, 2]):
        raise ComparisonRefused(
            "the reference's points are on separate lines, which give no direction across: align "
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
        why = "they overlap too little, or begin too far apart to be aligned from where they are"
        _check_enough_points_near(near, "", why)
        width = 3 * max(mad_sigma(off[near]), LEAST_RESIDUAL_SIGMA)
        if move < CONVERGED_ICP_MOVE or rounds == MOST_ICP_ROUNDS:
            break
        source = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(moved[near] - centre))
        target = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(feet[near] - centre))
        target.normals = o3d.utility.Vector3dVector(normals[near])
        loss = registration.TukeyLoss(TUKEY_CUTOFF / 3 * width)
        estimate = registration.TransformationEstimationPointToPlane(loss)
        same = np.arange(near.sum(), dtype=np.int32)
        pairs = o3d.utility.Vector2iVector(np.column_stack((same, same)))
        _check_points_cannot_slide(moved[near] - centre, normals[near])
        step = np.asarray(estimate.compute_transformation(source, target, pairs))
        step = pose(p=centre) @ step @ pose(p=-centre)
        move = float(np.linalg.norm(transform_points(step, moved) - moved, axis=1).max())
        T, rounds = step @ T, rounds + 1
    held = near & (off < width)
    fitness = float(held.mean())
    if fitness < LEAST_PARTNER_SHARE:
        raise ComparisonRefused(
            f"only {100 * fitness:.0f} % of the points are on the reference after alignment, "
            f"{100 * LEAST_PARTNER_SHARE:.0f} % must: they show something else for the most part"
        )
    residual = float(np.sqrt(np.mean(off[held] ** 2)))
    far = float(np.sqrt(np.mean(np.sum((transform_points(T, points) - points) ** 2, axis=1))))
    return Alignment("icp", T, fitness, residual, rounds, far)


def _check_enough_points_near(near: Mask, when: str, causes: str) -> None:
    """Refuse points if too few are near the reference."""
    if near.mean() < LEAST_PARTNER_SHARE:
        raise ComparisonRefused(
            f"{100 * near.mean():.0f} % of the points are within "
            f"{1e3 * MOST_PARTNER_DISTANCE:.0f} mm of the reference{when}, "
            f"{100 * LEAST_PARTNER_SHARE:.0f} % must: {causes}"
        )


def _check_points_cannot_slide(points: Array, normals: Array) -> None:
    """Refuse points that could slide or turn on the reference unnoticed."""
    radius = float(np.sqrt(np.mean(np.sum(points * points, axis=1))))
    J = np.column_stack((np.cross(points / radius, normals), normals))
    least = float(np.linalg.eigvalsh(J.T @ J / len(J))[0])
    if least < LEAST_ALIGNMENT_STIFFNESS:
        raise ComparisonRefused(
            f"the points could slide or turn along the reference (stiffness {least:.1e}, "
            f"{LEAST_ALIGNMENT_STIFFNESS:g} is needed): they hold no pose. Compare more of the "
            "surface, or with --align none"
        )


MESH_SAMPLES: Final = 40_000
"""Points drawn on a mesh to find its tubes in."""

RAY_START_OFFSET: Final = 1e-4
"""Metres that a ray begins off the surface it leaves."""

MOST_DIAMETER_DIFFERENCE: Final = 5e-3
"""Metres by which diameters may differ before two joints are two joints."""

CLEAR_TURN_RESIDUAL_RATIO: Final = 0.8
"""Ratio of residuals below which one of two turns is the right one."""

TURN_DECISION_POINTS: Final = 20_000
"""Points that decide between both turns."""


def align_joints(measured: Shape, reference: Shape, surface: MeshDistance | None) -> Alignment:
    """Align the measured joint to the reference by the frames of their fitted tubes.

    An upright brace leaves open which way x points along the leg. Both are tried and that with
    the smaller residual is taken; where they are alike, the one that turns less.

    Parameters
    ----------
    measured : Shape
        With points.
    reference : Shape
        A mesh, a cloud or edges.
    surface : MeshDistance, optional
        Of the reference's mesh.

    Raises
    ------
    ComparisonRefused
        If tubes can't be found in either, they are of other sizes, or the points don't come to lie
        on the reference.
    """
    points = measured.points
    if points is None:
        raise ComparisonRefused(f"{measured.name} holds no points to find its tubes in")
    ours, theirs = _joint_frame_of_shape(measured), _joint_frame_of_shape(reference)
    _check_diameters(measured, ours, reference, theirs)
    T_m, T_r = (np.eye(4) if frame is None else frame.T for frame in (ours, theirs))
    sample = points[:: max(1, len(points) // TURN_DECISION_POINTS)]
    far = _distance_function(reference, surface)
    turns = [T_r @ pose(rot_z(angle)) @ inverse_pose(T_m) for angle in (0.0, np.pi)]
    off = [np.abs(far(transform_points(T, sample))) for T in turns]
    # Medians: ghosts and flyers must not decide.
    medians = [float(np.median(distances)) for distances in off]
    less = int(np.argmin([rotation_angle_between(np.eye(4), T) for T in turns]))
    best = int(np.argmin(medians))
    clear = medians[best] < CLEAR_TURN_RESIDUAL_RATIO * medians[1 - best]
    chosen = best if clear else less
    near = off[chosen] < MOST_PARTNER_DISTANCE
    why = "these are two different joints, or one of them was not seen well enough"
    _check_enough_points_near(near, " once the joints' own frames coincide", why)
    T = turns[chosen]
    width = 3 * max(mad_sigma(off[chosen][near]), LEAST_RESIDUAL_SIGMA)
    held = off[chosen] < width
    residual = float(np.sqrt(np.mean(off[chosen][held] ** 2)))
    moved = float(np.sqrt(np.mean(np.sum((transform_points(T, points) - points) ** 2, axis=1))))
    note = "" if clear else "half a turn about the brace fits as well: azimuths may be off by 180°"
    return Alignment("joint", T, float(held.mean()), residual, 0, moved, note)


def _joint_frame_of_shape(shape: Shape) -> JointFrame | None:
    """Frame j of a shape in its own frame; None if that is its frame already."""
    if shape.is_in_joint_frame:
        return None
    try:
        points = shape.points if shape.mesh is None else _points_on_outside(shape.mesh)
        if points is None:
            raise TubesNotFound("it holds edges alone")
        return joint_frame_from_tubes(find_tubes_in_cloud(points), np.array((1.0, 0.0, 0.0)))
    except TubesNotFound as error:
        raise ComparisonRefused(
            f"{shape.name}: leg and brace can't be found in it: {error}. Compare with --align none "
            "or icp, or with a cloud that shows more of both tubes"
        ) from error


def _points_on_outside(mesh: Mesh) -> Array:
    """Points on a mesh whose normals meet nothing: inner walls are no tubes to fit."""
    o3d: Any = import_module("open3d")
    import trimesh

    solid = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    points, faces = trimesh.sample.sample_surface(solid, MESH_SAMPLES, seed=1)
    normals = solid.face_normals[faces]
    centre = mesh.vertices.mean(axis=0)
    scene: Any = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(np.ascontiguousarray(mesh.vertices - centre, dtype=np.float32)),
        o3d.core.Tensor(np.ascontiguousarray(mesh.triangles, dtype=np.uint32)),
    )
    start = points + RAY_START_OFFSET * normals - centre
    rays = o3d.core.Tensor(np.concatenate((start, normals), axis=1).astype(np.float32))
    free = np.isinf(scene.cast_rays(rays)["t_hit"].numpy())
    return np.asarray(points[free])


def _check_diameters(
    measured: Shape, ours: JointFrame | None, reference: Shape, theirs: JointFrame | None
) -> None:
    if ours is None or theirs is None:
        return
    for name in ("brace", "leg"):
        radius, other = (getattr(one.shape, f"{name}_radius") for one in (ours, theirs))
        if 2 * abs(radius - other) > MOST_DIAMETER_DIFFERENCE:
            raise ComparisonRefused(
                f"the {name} of {measured.name} is {2e3 * radius:.1f} mm wide, that of "
                f"{reference.name} {2e3 * other:.1f} mm: these are two different joints"
            )


def _distance_function(reference: Shape, surface: MeshDistance | None) -> Callable[[Array], Array]:
    """Distances of points from the reference."""
    if surface is not None:
        return surface.signed_distances
    if (points := reference.points) is not None:
        return lambda moved: distances_to_cloud(moved, points)
    raise ComparisonRefused(f"{reference.name} holds edges only: nothing to align to")
