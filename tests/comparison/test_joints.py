"""Joints brought onto each other by their own tubes, wherever they stand."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cells import scan_example
from command import tjscan
from scipy.spatial.transform import Rotation

from tjscan.comparison.clouds import read_shape_file
from tjscan.comparison.compare import compare_shapes
from tjscan.comparison.shapes import Mesh, Shape, UnitAndFrame
from tjscan.core.errors import ComparisonRefused
from tjscan.core.frames import (
    Array,
    JointOrBaseFrame,
    inverse_pose,
    pose,
    rot_z,
    rotation_angle_between,
    transform_points,
)
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import read_joint
from tjscan.joint.mesh import build_joint_mesh
from tjscan.runs.scan.results import cloud_of_sections

CAD = Path(__file__).parent.parent.parent / "cad"
PAPER, LEANING = CAD / "tjoint-600x457.toml", CAD / "yjoint-600x457-60deg.toml"

SPREAD = 50e-6
"""Metres: standard deviation of the points put about a joint."""

NEAR = 0.1e-3, np.radians(0.02)
"""What facets of a mesh (a tenth of a millimetre inside the tubes) leave of a pose."""

SCANNED = 0.5e-3, np.radians(0.1)
"""What a scan over 150° of the joint holds of it: each view is off by the arm's 0.05 mm."""


def moves(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-3, 3, 3))


@cache
def solid_of(joint: JointDefinition) -> Mesh:
    built = build_joint_mesh(joint)
    return Mesh(built.vertices, built.triangles.astype(np.intp))


def cloud_of(joint: JointDefinition, T: Array) -> Array:
    """Points about the groove on the outer walls, moved by `T`."""
    import trimesh

    mesh = solid_of(joint)
    solid = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    points, _ = trimesh.sample.sample_surface(solid, 50_000, seed=1)
    rho = np.hypot(points[:, 0], points[:, 1])
    from_leg = np.linalg.norm(
        points - np.outer(points @ joint.leg_surface.axis, joint.leg_surface.axis), axis=1
    )
    outside = (from_leg > joint.leg_radius - 1e-4) & (rho > joint.brace_radius - 1e-4)
    outside &= (rho < joint.brace_radius + 0.1) & (points[:, 2] > 0)
    noise = np.random.default_rng(0).normal(0, SPREAD, points.shape)
    return transform_points(T, (points + noise)[outside])


def measured(points: Array) -> Shape:
    return Shape("measured", UnitAndFrame("m", "the test", "w"), points)


def off(T: Array) -> tuple[float, float]:
    return float(np.linalg.norm(T[:3, 3])), rotation_angle_between(np.eye(4), T)


@pytest.mark.parametrize("file", [PAPER, LEANING], ids=lambda file: file.stem)
def test_a_cloud_finds_its_joint_wherever_it_stands(file: Path) -> None:
    T = moves(1)
    found = compare_shapes(measured(cloud_of(read_joint(file), T)), read_shape_file(file), "joint")
    left = found.alignment.T @ T
    if file is PAPER and abs(rotation_angle_between(np.eye(4), left)) > 1:
        left = pose(rot_z(np.pi)) @ left  # an upright joint is the same from behind
    distance, angle = off(left)
    assert distance < NEAR[0]
    assert angle < NEAR[1]
    assert found.reference.stated.frame == "j"
    # A brace that leans has a heel, so there is nothing to choose.
    assert bool(found.alignment.note) == (file is PAPER)
    assert found.deviations[0].statistics.rms < 0.2


def test_tubes_are_found_in_a_foreign_mesh_too() -> None:
    joint = read_joint(LEANING)
    T, S = moves(3), moves(4)
    solid = solid_of(joint)
    mesh = Mesh(transform_points(S, solid.vertices), solid.triangles)
    reference = Shape("cad", UnitAndFrame("m", "the test", "cad"), mesh=mesh)
    found = compare_shapes(measured(cloud_of(joint, T)), reference, "joint")
    distance, angle = off(inverse_pose(S) @ found.alignment.T @ T)
    assert distance < 2 * NEAR[0]
    assert angle < 2 * NEAR[1]
    assert found.measured.stated.frame == "cad"


def test_tubes_are_found_in_a_foreign_cloud_too() -> None:
    joint = read_joint(LEANING)
    T, S = moves(5), moves(6)
    reference = Shape("camera", UnitAndFrame("m", "the test", "camera"), cloud_of(joint, S))
    found = compare_shapes(measured(cloud_of(joint, T)[::2]), reference, "joint")
    distance, angle = off(inverse_pose(S) @ found.alignment.T @ T)
    assert distance < 2 * NEAR[0]
    assert angle < 2 * NEAR[1]


def test_a_scan_in_the_arms_frame_finds_its_joint() -> None:
    points_b = cloud_of_sections(scan_example({}).sections, JointOrBaseFrame()).points
    found = compare_shapes(
        Shape("run", UnitAndFrame("mm", "the run", "b"), points_b), read_shape_file(PAPER), "joint"
    )
    T_b_j = pose(rot_z(np.pi), (0.522, 0.903, -0.128))
    left = found.alignment.T @ T_b_j
    if rotation_angle_between(np.eye(4), left) > 1:
        left = pose(rot_z(np.pi)) @ left
    distance, angle = off(left)
    assert distance < SCANNED[0]
    assert angle < SCANNED[1]


def test_a_shape_in_its_own_joints_frame_stays_there() -> None:
    cloud = cloud_of(read_joint(LEANING), np.eye(4))
    own = Shape("stitched", UnitAndFrame("mm", "the run", "j"), cloud, is_in_joint_frame=True)
    alignment = compare_shapes(own, read_shape_file(LEANING), "joint").alignment
    np.testing.assert_array_equal(alignment.T, np.eye(4))
    assert alignment.moved == 0


def test_other_joints_and_no_joints_are_refused() -> None:
    rng = np.random.default_rng(0)
    heap = measured(rng.uniform(-0.3, 0.3, (3000, 3)))
    with pytest.raises(ComparisonRefused, match="leg and brace can't be found"):
        compare_shapes(heap, read_shape_file(PAPER), "joint")
    small, large = (read_joint(CAD / f"tjoint-{name}.toml") for name in ("406x324", "600x457"))
    reference = Shape("camera", UnitAndFrame("m", "the test", "c"), cloud_of(large, moves(7)))
    with pytest.raises(ComparisonRefused, match="two different joints"):
        compare_shapes(measured(cloud_of(small, moves(8))), reference, "joint")


def test_the_command_aligns_a_cloud_in_a_frame_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "camera.xyz"
    np.savetxt(file, 1e3 * cloud_of(read_joint(LEANING), moves(9)))
    words = ("--units", "mm", "--frame", "camera", "--align", "joint", "--tolerance-mm", "0.5")
    assert tjscan("compare", file, LEANING, *words) == 0
    assert "aligned by joint" in capsys.readouterr().out
    assert tjscan("compare", file, CAD / "tjoint-406x324.toml", *words) == 1
    assert "different joints" in capsys.readouterr().err
