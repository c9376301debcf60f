"""Bringing one joint onto another by their own frames: the tubes of both are found."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, Final

import numpy as np

from tjscan.comparison.alignment import LEAST_FITNESS, MOST_PARTNER_DISTANCE, NOISE_FLOOR, Alignment
from tjscan.comparison.distance import distances_to_cloud
from tjscan.comparison.shapes import Mesh, Shape
from tjscan.comparison.surface import MeshDistance
from tjscan.core.errors import ComparisonRefused, TubesNotFound
from tjscan.core.frames import (
    Array,
    inverse_pose,
    pose,
    rot_z,
    rotation_angle_between,
    transform_points,
)
from tjscan.core.robust import mad_sigma
from tjscan.joint.tubes.find import find_tubes_in_cloud
from tjscan.joint.tubes.frame import JointFrame, joint_frame_from_tubes

MESH_SAMPLES: Final = 40_000
"""Points drawn on a mesh to find its tubes in."""

RAY_START_OFFSET: Final = 1e-4
"""Metres that a ray begins off the surface it leaves."""

MOST_DIAMETER_DIFFERENCE: Final = 5e-3
"""Metres by which diameters may differ before two joints are two joints."""

CLEAR_RESIDUAL_RATIO: Final = 0.8
"""Ratio of residuals below which one of two turns is the right one."""

TURN_SAMPLE: Final = 20_000
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
    ours, theirs = _frame_of(measured), _frame_of(reference)
    _check_sizes(measured, ours, reference, theirs)
    T_m, T_r = (np.eye(4) if frame is None else frame.T for frame in (ours, theirs))
    sample = points[:: max(1, len(points) // TURN_SAMPLE)]
    far = _distances(reference, surface)
    turns = [T_r @ pose(rot_z(angle)) @ inverse_pose(T_m) for angle in (0.0, np.pi)]
    off = [np.abs(far(transform_points(T, sample))) for T in turns]
    # Medians: ghosts and flyers must not decide.
    medians = [float(np.median(distances)) for distances in off]
    less = int(np.argmin([rotation_angle_between(np.eye(4), T) for T in turns]))
    best = int(np.argmin(medians))
    clear = medians[best] < CLEAR_RESIDUAL_RATIO * medians[1 - best]
    chosen = best if clear else less
    near = off[chosen] < MOST_PARTNER_DISTANCE
    if near.mean() < LEAST_FITNESS:
        raise ComparisonRefused(
            f"{100 * near.mean():.0f} % of the points lie within "
            f"{1e3 * MOST_PARTNER_DISTANCE:.0f} mm of the "
            f"reference once the joints' own frames coincide, {100 * LEAST_FITNESS:.0f} % must: "
            "these are two different joints, or one of them was not seen well enough"
        )
    T = turns[chosen]
    width = 3 * max(mad_sigma(off[chosen][near]), NOISE_FLOOR)
    held = off[chosen] < width
    residual = float(np.sqrt(np.mean(off[chosen][held] ** 2)))
    moved = float(np.sqrt(np.mean(np.sum((transform_points(T, points) - points) ** 2, axis=1))))
    note = "" if clear else "half a turn about the brace fits as well: azimuths may be off by 180°"
    return Alignment("joint", T, float(held.mean()), residual, 0, moved, note)


def _frame_of(shape: Shape) -> JointFrame | None:
    """Frame j of a shape in its own frame; None if that is its frame already."""
    if shape.is_in_joint_frame:
        return None
    try:
        points = shape.points if shape.mesh is None else _outside(shape.mesh)
        if points is None:
            raise TubesNotFound("it holds edges alone")
        return joint_frame_from_tubes(find_tubes_in_cloud(points), np.array((1.0, 0.0, 0.0)))
    except TubesNotFound as error:
        raise ComparisonRefused(
            f"{shape.name}: leg and brace can't be found in it: {error}. Compare with --align none "
            "or icp, or with a cloud that shows more of both tubes"
        ) from error


def _outside(mesh: Mesh) -> Array:
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


def _check_sizes(
    measured: Shape, ours: JointFrame | None, reference: Shape, theirs: JointFrame | None
) -> None:
    if ours is None or theirs is None:
        return
    for name, radius, other in (
        ("brace", ours.shape.brace_radius, theirs.shape.brace_radius),
        ("leg", ours.shape.leg_radius, theirs.shape.leg_radius),
    ):
        if 2 * abs(radius - other) > MOST_DIAMETER_DIFFERENCE:
            raise ComparisonRefused(
                f"the {name} of {measured.name} is {2e3 * radius:.1f} mm wide, that of "
                f"{reference.name} {2e3 * other:.1f} mm: these are two different joints"
            )


def _distances(reference: Shape, surface: MeshDistance | None) -> Callable[[Array], Array]:
    """Distances of points from the reference."""
    if surface is not None:
        return surface.signed_distances
    if (points := reference.points) is not None:
        return lambda moved: distances_to_cloud(moved, points)
    raise ComparisonRefused(f"{reference.name} holds edges only: nothing to align to")
