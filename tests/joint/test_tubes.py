"""Tubes from points, and the joint's frame that they make."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from cells import scan_example
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tjscan.core.errors import TubesNotFound
from tjscan.core.frames import (
    Array,
    JointOrBaseFrame,
    inverse_pose,
    pose,
    rotation_angle_between,
    transform_points,
)
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import read_joint
from tjscan.joint.geometry import cylindrical_to_j
from tjscan.joint.mesh import build_joint_mesh
from tjscan.joint.tubes.cylinder import Cylinder, cylinder_from_normals
from tjscan.joint.tubes.find import find_tubes_in_cloud
from tjscan.joint.tubes.fit import (
    ArmRepeatability,
    WallPoints,
    fit_tubes_to_walls,
    joint_frame_from_tubes,
    joint_pose_from_cylinders,
)
from tjscan.runs.scan.results import cloud_of_sections

CAD = Path(__file__).parent.parent.parent / "cad"
JOINTS = [read_joint(file) for file in sorted(CAD.glob("?joint-*.toml"))]
EXACT = 1e-9
"""Metres: rounding in lengths of a few metres."""

STILL_ARM = ArmRepeatability(0.0, 0.0)


def walls_of(joint: JointDefinition, views: int = 24, arc: float = 3.6) -> WallPoints:
    """Exact points of both walls as an arm sees them round an arc, in frame j."""
    points, on_brace, view, pivots = [], [], [], []
    for k, phi in enumerate(np.linspace(-0.3, arc - 0.3, views)):
        foot = float(joint.leg_surface.height(phi, joint.brace_radius))
        up = foot + np.linspace(0.02, 0.06, 4)
        out = joint.brace_radius + np.linspace(0.0, 0.04, 4)
        # A line across the leg bends out of the half-plane where it must stay on the surface.
        rho = np.minimum(out, 0.98 * joint.leg_radius)
        points += [
            cylindrical_to_j(phi, joint.brace_radius, up),
            joint.leg_surface.points_j(phi, rho),
        ]
        on_brace += [True] * 4 + [False] * 4
        view += [k] * 8
        pivots.append(cylindrical_to_j(phi, joint.brace_radius + 0.4, foot + 0.3))
    n = len(on_brace)
    return WallPoints(
        np.concatenate(points),
        np.array(on_brace),
        np.full(n, 1e-5),
        np.array(view),
        np.array(pivots),
    )


def moved(walls: WallPoints, T: Array) -> WallPoints:
    return replace(
        walls, points=transform_points(T, walls.points), pivots=transform_points(T, walls.pivots)
    )


def true_tubes(joint: JointDefinition, T: Array) -> tuple[Cylinder, Cylinder]:
    brace = Cylinder(
        np.array((0.0, 0.0, joint.leg_radius)), np.array((0, 0, 1.0)), joint.brace_radius
    )
    leg = Cylinder(np.zeros(3), joint.leg_surface.axis, joint.leg_radius)
    return brace.transformed(T), leg.transformed(T)


def nudged(tube: Cylinder) -> Cylinder:
    """A start as bad as normals of a scan make it."""
    return tube.boxplus(np.array((5e-3, -4e-3, 0.03, 0.02, 3e-3)))


poses = st.builds(
    lambda v, p: pose(Rotation.from_rotvec(v).as_matrix(), p),
    st.tuples(*[st.floats(-2, 2)] * 3),
    st.tuples(*[st.floats(-3, 3)] * 3),
)


@pytest.mark.parametrize("joint", JOINTS, ids=lambda joint: joint.name)
@given(T=poses)
@settings(max_examples=8, deadline=None)
def test_exact_walls_give_the_exact_frame_wherever_they_stand(
    joint: JointDefinition, T: Array
) -> None:
    brace, leg = true_tubes(joint, T)
    tubes = fit_tubes_to_walls(
        moved(walls_of(joint), T), ArmRepeatability(), nudged(brace), nudged(leg)
    )
    frame = joint_frame_from_tubes(tubes, T[:3, 0])
    assert np.linalg.norm(frame.T[:3, 3] - T[:3, 3]) < EXACT
    assert rotation_angle_between(frame.T, T) < EXACT
    assert frame.shape.as_array == pytest.approx(
        (joint.brace_radius, joint.leg_radius, joint.angle, 0.0), abs=EXACT
    )


def test_derivatives_of_the_distance_are_those_of_small_steps() -> None:
    tube = Cylinder(np.array((0.1, 0.2, 0.3)), np.array((1.0, 2.0, -1.0)), 0.25)
    points = np.random.default_rng(1).normal(size=(50, 3))
    numeric = [
        (tube.boxplus(h).signed_distances(points) - tube.boxplus(-h).signed_distances(points))
        / 2e-6
        for h in 1e-6 * np.eye(5)
    ]
    np.testing.assert_allclose(tube.jacobian(points), np.transpose(numeric), atol=1e-7)


def test_points_and_normals_of_a_cylinder_give_it_back() -> None:
    tube = Cylinder(np.array((1.0, -2.0, 0.5)), np.array((0.3, 0.1, 1.0)), 0.2)
    around = np.random.default_rng(2).normal(size=(40, 3)) + tube.point
    normals = tube.normals(around)
    points = around - tube.signed_distances(around)[:, None] * normals
    found = cylinder_from_normals(points, normals)
    assert found.radius == pytest.approx(tube.radius, abs=EXACT)
    assert np.abs(tube.signed_distances(points - tube.radius * normals) + tube.radius).max() < EXACT


def test_the_errors_of_the_frame_are_as_large_as_stated() -> None:
    # Views err as a whole; their points add a little of their own. Normalised error squared of
    # the ten numbers is 1 in the mean, within the spread of 25 draws of 10.
    joint, arm = JOINTS[0], ArmRepeatability()
    exact, rng, squares = walls_of(joint), np.random.default_rng(5), []
    for _ in range(25):
        error = rng.multivariate_normal(np.zeros(6), arm.covariance, size=len(exact.pivots))
        shift, turn = error[exact.view, :3], error[exact.view, 3:]
        noisy = exact.points + shift + np.cross(turn, exact.points - exact.pivots[exact.view])
        noisy = noisy + 1e-5 * rng.normal(size=noisy.shape)
        walls = replace(exact, points=noisy)
        frame = joint_frame_from_tubes(
            fit_tubes_to_walls(walls, arm, *true_tubes(joint, np.eye(4))), np.eye(3)[0]
        )
        turned = Rotation.from_matrix(frame.T[:3, :3]).as_rotvec()
        of_shape = frame.shape.as_array - (joint.brace_radius, joint.leg_radius, joint.angle, 0.0)
        found = np.concatenate((frame.T[:3, 3], turned, of_shape))
        squares.append(found @ np.linalg.solve(frame.covariance, found) / 10)
    assert 0.75 < np.mean(squares) < 1.3


def test_a_view_that_is_wrong_by_a_millimetre_moves_the_frame_by_less_than_a_tenth() -> None:
    joint = JOINTS[0]
    exact = walls_of(joint)
    points = exact.points.copy()
    points[exact.view == 7] += (1e-3, 0.0, 1e-3)
    tubes = fit_tubes_to_walls(
        replace(exact, points=points), ArmRepeatability(), *true_tubes(joint, np.eye(4))
    )
    assert np.linalg.norm(joint_frame_from_tubes(tubes, np.eye(3)[0]).T[:3, 3]) < 1e-4


def test_a_dented_tube_is_noticed_and_widens_the_covariance() -> None:
    joint = JOINTS[0]
    exact = walls_of(joint)
    x, y, _ = exact.points.T
    out = 0.5e-3 * np.cos(5 * np.arctan2(y, x))[:, None] * np.column_stack((x, y, 0 * x))
    points = exact.points + exact.on_brace[:, None] * out / joint.brace_radius
    start = true_tubes(joint, np.eye(4))
    dented = fit_tubes_to_walls(replace(exact, points=points), ArmRepeatability(), *start)
    round_ = fit_tubes_to_walls(exact, ArmRepeatability(), *start)
    assert dented.reduced_chi2 > 10
    assert dented.covariance[0, 0] > 5 * round_.covariance[0, 0]


def test_half_a_turn_is_settled_by_the_side_asked_for() -> None:
    brace, leg = true_tubes(JOINTS[0], np.eye(4))
    for side in (1.0, -1.0):
        T, _ = joint_pose_from_cylinders(brace, leg, np.array((side, 0.1, 0.0)))
        np.testing.assert_allclose(T, np.diag((side, side, 1.0, 1.0)), atol=EXACT)


def test_too_little_of_the_tubes_is_refused() -> None:
    joint = JOINTS[0]
    start = true_tubes(joint, np.eye(4))
    with pytest.raises(TubesNotFound, match="too few"):
        fit_tubes_to_walls(walls_of(joint, views=2), STILL_ARM, *start)
    with pytest.raises(TubesNotFound, match="circumference"):
        cylinder_from_normals(
            np.random.default_rng(0).normal(size=(9, 3)), np.tile((0, 0, 1.0), (9, 1))
        )
    with pytest.raises(TubesNotFound, match="parallel"):
        joint_pose_from_cylinders(start[0], start[0], np.eye(3)[0])


def cloud_of(joint: JointDefinition, T: Array) -> Array:
    """What a dense scanner sees of a joint from outside."""
    mesh = build_joint_mesh(joint)
    mesh = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    points = np.asarray(trimesh.sample.sample_surface(mesh, 60_000, seed=1)[0])
    rho = np.hypot(points[:, 0], points[:, 1])
    outside = joint.leg_surface.signed_distances(points) > -1e-4
    outside &= (rho > joint.brace_radius - 0.02) & (rho < joint.brace_radius + 0.1)
    noise = np.random.default_rng(0).normal(0, 5e-5, points.shape)
    return transform_points(T, (points + noise)[outside])


@pytest.mark.parametrize("joint", JOINTS, ids=lambda joint: joint.name)
def test_leg_and_brace_are_found_in_a_cloud(joint: JointDefinition) -> None:
    T = pose(Rotation.from_rotvec((1.0, -0.7, 2.0)).as_matrix(), (1, 2, 3))
    tubes = find_tubes_in_cloud(cloud_of(joint, T))
    found, shape = joint_pose_from_cylinders(tubes.brace, tubes.leg, T[:3, 0])
    # Its points lie on the facets of a mesh, up to a tenth of a millimetre inside.
    assert np.linalg.norm(found[:3, 3] - T[:3, 3]) < 1e-4
    assert rotation_angle_between(found, T) < np.radians(0.02)
    assert shape.brace_radius == pytest.approx(joint.brace_radius, abs=1e-4)
    assert shape.leg_radius == pytest.approx(joint.leg_radius, abs=1e-4)


def test_leg_and_brace_are_found_in_the_separate_lines_of_a_scan() -> None:
    points = cloud_of_sections(scan_example({}).sections, JointOrBaseFrame(None)).points
    tubes = find_tubes_in_cloud(points)
    T_b_j, shape = joint_pose_from_cylinders(tubes.brace, tubes.leg, np.array((1.0, 0.0, 0.0)))
    assert (
        np.linalg.norm(inverse_pose(T_b_j)[:3, :3] @ (T_b_j[:3, 3] - (0.522, 0.903, -0.128))) < 5e-4
    )
    assert 2 * shape.leg_radius == pytest.approx(0.600, abs=5e-4)


def test_a_cloud_without_two_tubes_is_refused() -> None:
    rng = np.random.default_rng(3)
    with pytest.raises(TubesNotFound):
        find_tubes_in_cloud(rng.uniform(size=(50, 3)))
    with pytest.raises(TubesNotFound):
        find_tubes_in_cloud(rng.uniform(size=(5000, 3)))
    phi, z = rng.uniform(0, 6.28, 5000), rng.uniform(0, 0.5, 5000)
    with pytest.raises(TubesNotFound):
        find_tubes_in_cloud(cylindrical_to_j(phi, 0.2, z))
