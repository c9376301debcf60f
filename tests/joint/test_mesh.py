from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
import trimesh
from hypothesis import event, given, settings
from hypothesis import strategies as st

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import JointGrooveSections, feature_edges
from tjscan.joint.file import JointFile, check_buildable, read_joint
from tjscan.joint.geometry import cylindrical_to_j
from tjscan.joint.mesh import (
    MOST_CHORD_ERROR,
    TriangleMesh,
    brace_vertex_azimuths,
    build_joint_mesh,
    largest_chord_error,
)

CAD = Path(__file__).parents[2] / "cad"
JOINTS = sorted(CAD.glob("?joint-*.toml"))
PAPER = CAD / "tjoint-600x457.toml"

ACCURACY = 5e-6
"""A sixth of the range noise of a good line laser, in metres."""

NEAR = 40e-3
"""How far from the groove's corners a profile reaches on wall and leg, in metres."""

LIFT = 0.2e-3
"""Where rays start over a surface, in metres: less than any groove is wide."""

MOST_TRIANGLES = 150_000
"""More would slow down every ray."""


@cache
def built(file: Path) -> tuple[JointDefinition, TriangleMesh]:
    joint = read_joint(file)
    return joint, build_joint_mesh(joint)


def solid_of(mesh: TriangleMesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)


def height_over_mesh(mesh: TriangleMesh, points: Array, normals: Array) -> Array:
    """How far exact points lie over the mesh along their normals, in metres, shape (n,).

    Rays are what the mesh is for, and float32 is good to 0.1 µm over so short a way.
    """
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(mesh.vertices.astype(np.float32)),
        o3d.core.Tensor.from_numpy(mesh.triangles.astype(np.uint32)),
    )
    rays = np.column_stack((points + LIFT * normals, -normals)).astype(np.float32)
    hits: Array = scene.cast_rays(o3d.core.Tensor.from_numpy(rays))["t_hit"].numpy()
    return np.asarray(hits - LIFT, dtype=float)


def square_to(rz: Array) -> Array:
    """Unit vectors square to lines in the radial half-planes, on their upper or outer side."""
    turned = np.column_stack((rz[:, 1], -rz[:, 0]))
    return np.asarray(turned / np.linalg.norm(rz, axis=1, keepdims=True))


def assert_true_to_the_closed_form(joint: JointDefinition, mesh: TriangleMesh, n: int) -> None:
    rng = np.random.default_rng(5)
    phi, share = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, 1, (n, 1))
    s = JointGrooveSections(joint, phi)
    rho = np.minimum(s.p4[:, 0] + share[:, 0] * NEAR, 0.99 * joint.leg_radius)
    above = min(NEAR, joint.brace_length - float(s.p2[:, 1].max()))
    surfaces = {
        "wall": (s.p2 + share * (0, above), np.tile((1.0, 0.0), (n, 1))),
        "bevel": (s.p2 + share * (s.p3 - s.p2), square_to(s.p2 - s.p3)),
        "bead": (s.p3 + share * (s.p4 - s.p3), square_to(s.p3 - s.p4)),
        "leg": (
            np.column_stack((rho, joint.leg_surface.height(phi, rho))),
            square_to(-np.column_stack((np.ones(n), joint.leg_surface.slope(phi, rho)))),
        ),
    }
    for name, (rz, normal_rz) in surfaces.items():
        points = cylindrical_to_j(phi, rz[:, 0], rz[:, 1])
        normals = cylindrical_to_j(phi, normal_rz[:, 0], normal_rz[:, 1])
        assert np.abs(height_over_mesh(mesh, points, normals)).max() < ACCURACY, name


def assert_sound(mesh: TriangleMesh) -> None:
    solid = solid_of(mesh)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.euler_number == 0, "one tube with a blind pipe on it has one hole"
    assert solid.volume > 0
    assert len(mesh.triangles) < MOST_TRIANGLES


@pytest.mark.parametrize("file", JOINTS, ids=lambda file: file.stem)
def test_the_solid_is_watertight(file: Path) -> None:
    assert_sound(built(file)[1])


@pytest.mark.parametrize("file", JOINTS, ids=lambda file: file.stem)
def test_exact_points_of_the_groove_lie_on_the_mesh(file: Path) -> None:
    assert_true_to_the_closed_form(*built(file), n=20_000)


@pytest.mark.parametrize("file", JOINTS, ids=lambda file: file.stem)
def test_points_of_the_mesh_lie_on_the_closed_form(file: Path) -> None:
    joint, mesh = built(file)
    points = solid_of(mesh).triangles_center
    phi, rho = np.arctan2(points[:, 1], points[:, 0]), np.hypot(points[:, 0], points[:, 1])
    s = JointGrooveSections(joint, phi)
    rz = np.column_stack((rho, points[:, 2]))
    seen = (rho > s.land[:, 0]) & (joint.leg_surface.signed_distances(points) > -ACCURACY)
    seen &= np.linalg.norm(rz - s.p3, axis=1) < NEAR + s.bevel_length

    def off_line(a: Array, b: Array) -> Array:
        along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
        offset = rz - a
        return np.asarray(np.abs(offset[:, 0] * along[:, 1] - offset[:, 1] * along[:, 0]))

    off = np.column_stack(
        (
            np.abs(rho - joint.brace_radius),
            np.abs(joint.leg_surface.signed_distances(points)),
            off_line(s.p2, s.p3),
            off_line(s.p3, s.p4),
        )
    )
    assert seen.sum() > 20_000
    assert off.min(axis=1)[seen].max() < ACCURACY


@pytest.mark.parametrize("file", JOINTS, ids=lambda file: file.stem)
def test_feature_edges_are_the_creases_of_the_mesh(file: Path) -> None:
    joint, mesh = built(file)
    solid, edges = solid_of(mesh), feature_edges(joint)
    sharp = solid.face_adjacency_edges[solid.face_adjacency_angles > np.deg2rad(15)]
    ends = mesh.vertices[sharp]
    for line in (edges.p2, edges.p3, edges.p4):
        distance = line.distances(ends.reshape(-1, 3)).reshape(-1, 2)
        on_it = ends[np.all(distance < ACCURACY, axis=1)]
        length = np.linalg.norm(on_it[:, 1] - on_it[:, 0], axis=1).sum()
        steps = np.diff(line.points_j, axis=0, append=line.points_j[:1])
        assert length == pytest.approx(np.linalg.norm(steps, axis=1).sum(), rel=1e-4)


def test_volume_lies_between_what_it_must_hold_and_may_hold() -> None:
    joint, mesh = built(PAPER)
    phi = np.linspace(0, 2 * np.pi, 3600, endpoint=False)
    bore = joint.leg_radius - joint.leg_wall
    leg = np.pi * (joint.leg_radius**2 - bore**2) * joint.leg_length
    ring = np.pi * (joint.brace_radius**2 - joint.brace_inner_radius**2)
    top = JointGrooveSections(joint, phi).p2[:, 1].mean()
    foot = joint.leg_surface.height(phi, joint.brace_radius).mean()
    least, most = (leg + ring * (joint.brace_length - z) for z in (top, foot))
    assert least < solid_of(mesh).volume < most


def test_the_mesh_ends_where_the_tubes_end() -> None:
    joint, mesh = built(PAPER)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    half, radius = joint.leg_length / 2, joint.leg_radius
    np.testing.assert_allclose(low, (-half, -radius, -radius), atol=ACCURACY)
    np.testing.assert_allclose(high, (half, radius, joint.brace_length), atol=ACCURACY)


def test_a_kink_of_the_groove_table_is_followed() -> None:
    joint = read_joint(PAPER)
    table = tuple((np.deg2rad(psi), np.deg2rad(a)) for psi, a in ((90, 45), (115, 45), (120, 60)))
    kinked = replace(joint, groove_table=table)
    assert largest_chord_error(kinked) <= MOST_CHORD_ERROR
    assert len(brace_vertex_azimuths(kinked)) > len(brace_vertex_azimuths(joint))
    assert_true_to_the_closed_form(kinked, build_joint_mesh(kinked), n=5_000)


def test_arrays_are_read_only() -> None:
    _, mesh = built(PAPER)
    assert mesh.triangles.dtype == np.int32
    for array in (mesh.vertices, mesh.triangles):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


@settings(max_examples=20, deadline=None)
@given(
    brace=st.floats(0.168, 0.610),
    ratio=st.floats(1.05, 3.0),
    leg_wall=st.floats(0.008, 0.040),
    brace_wall=st.floats(0.008, 0.040),
    angle=st.floats(60, 90),
    opening=st.floats(45, 65),
    root=st.tuples(st.floats(0, 0.006), st.floats(0, 0.003), st.floats(0, 0.004)),
)
def test_any_size_is_built_soundly_or_refused_clearly(
    brace: float,
    ratio: float,
    leg_wall: float,
    brace_wall: float,
    angle: float,
    opening: float,
    root: tuple[float, float, float],
) -> None:
    try:
        joint = JointDefinition(
            name="any",
            leg_radius=ratio * brace / 2,
            leg_wall=leg_wall,
            leg_length=3.5 * ratio * brace + 0.3,
            brace_radius=brace / 2,
            brace_wall=brace_wall,
            brace_length=1.5 * ratio * brace + 0.3,
            angle=float(np.deg2rad(angle)),
            groove_table=tuple(
                (float(np.deg2rad(psi)), float(np.deg2rad(groove)))
                for psi, groove in ((60, 40), (90, opening), (140, 65))
            ),
            root_opening=root[0],
            root_face=root[1],
            root_bead=root[2],
        )
        check_buildable(joint)
    except ConfigurationError as refusal:
        key = refusal.key or ""
        event(f"refused for {key}")
        assert key.split(".")[0] in JointFile.model_fields
        return
    mesh = build_joint_mesh(joint)
    assert_sound(mesh)
    assert_true_to_the_closed_form(joint, mesh, n=2_000)
