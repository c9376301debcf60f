"""Joints as built: what is out of round, off its place, tacked, curved or cut in facets."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import radians
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from tjscan.comparison.distance import DistanceStatistics, corner_to_edge_distances
from tjscan.core.config import table_to_dict, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.joint.definition import (
    NO_IMPERFECTIONS,
    BevelAsCut,
    BraceMisfit,
    Imperfections,
    JointDefinition,
    Ovality,
    RootAsFitted,
    SeamWeldCap,
    Spatter,
    TackWeld,
    interpolate_around_joint,
)
from tjscan.joint.edges import JointGrooveSections, feature_edges, is_within_spans, tack_spans
from tjscan.joint.file import JointFile, check_buildable, read_joint
from tjscan.joint.geometry import (
    Ellipse,
    LegSurface,
    OvalLegSurface,
    cylindrical_to_j,
    semi_axes_same_circumference,
)
from tjscan.joint.mesh import TriangleMesh, build_joint_mesh
from tjscan.laser.optics import RaycastSurface

CAD = Path(__file__).parents[2] / "cad"
EXACT = 1e-12
ON_MESH = 5e-6
"""Chord error of the mesh and float32 of the rays, in metres."""

ABOVE = 10e-3
"""Where rays onto beads start, in metres: higher than any tack."""

PHI = np.linspace(0, 2 * np.pi, 97, endpoint=False)

BENT = Imperfections(
    leg_ovality=Ovality(ovality=0.01, widest=0.5),
    brace_ovality=Ovality(ovality=0.008, widest=1.0),
    misfit=BraceMisfit(offset=2e-3, offset_towards=1.0, tilt=radians(0.3), tilt_towards=2.0),
    root=RootAsFitted(opening=(0.0, 1e-3, -1e-3, 0.5e-3), bead_height=(0.5e-3, 1e-3, -0.8e-3)),
    bevel=BevelAsCut(facet_angle=radians(6), facet_at=0.4),
)
DEPOSITED = replace(
    BENT,
    tacks=(TackWeld(at=0.3), TackWeld(at=2.5, length=0.05, height=0.004)),
    seams=(SeamWeldCap(at=radians(70)),),
    spatter=Spatter(density=60),
)
OPEN = replace(DEPOSITED, root=RootAsFitted(is_open=True, opening=(0.0, 1e-3)))


@cache
def joint(name: str = "tjoint-600x457") -> JointDefinition:
    return read_joint(CAD / f"{name}.toml")


def built(imperfections: Imperfections, name: str = "tjoint-600x457") -> JointDefinition:
    found = replace(joint(name), imperfections=imperfections)
    check_buildable(found)
    return found


@cache
def mesh_of(imperfections: Imperfections, name: str = "tjoint-600x457") -> TriangleMesh:
    return build_joint_mesh(built(imperfections, name))


# --- ideal


NOTHING = Imperfections(
    leg_ovality=Ovality(widest=1.0),
    brace_ovality=Ovality(widest=2.0),
    misfit=BraceMisfit(offset_towards=1.0, tilt_towards=2.0),
    bevel=BevelAsCut(facet_at=0.3),
)


def test_imperfections_of_no_size_leave_a_joint_as_drawn() -> None:
    ideal, other = build_joint_mesh(joint()), mesh_of(NOTHING)
    np.testing.assert_array_equal(other.vertices, ideal.vertices)
    np.testing.assert_array_equal(other.triangles, ideal.triangles)
    ours, theirs = feature_edges(joint()), feature_edges(built(NOTHING))
    for edge in ("p2", "p3", "p4"):
        np.testing.assert_array_equal(getattr(ours, edge).points_j, getattr(theirs, edge).points_j)


def test_a_file_without_the_table_is_ideal() -> None:
    assert joint().imperfections == NO_IMPERFECTIONS
    assert "imperfections" not in table_to_dict(JointFile.from_definition(joint()))


@pytest.mark.parametrize("imperfections", [NOTHING, BENT, DEPOSITED, OPEN])
def test_a_joint_is_written_and_read_again_the_same(imperfections: Imperfections) -> None:
    file = JointFile.from_definition(built(imperfections))
    again = validate_table(JointFile, table_to_dict(file))
    assert again.definition("x").imperfections == imperfections


# --- out of round


@settings(max_examples=30, deadline=None)
@given(st.floats(0.02, 1.0), st.floats(0, 0.05))
def test_an_oval_tube_keeps_its_circumference(radius: float, ovality: float) -> None:
    long, short = semi_axes_same_circumference(radius, ovality)
    assert long - short == pytest.approx(ovality * radius, abs=EXACT)
    around, _ = quad(lambda t: np.hypot(long * np.sin(t), short * np.cos(t)), 0, np.pi / 2)
    assert 4 * around == pytest.approx(2 * np.pi * radius, rel=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.5, 1.0), st.floats(0, 6.3), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02))
def test_an_ellipse_is_met_where_its_equation_holds(
    ratio: float, widest: float, x: float, y: float
) -> None:
    ellipse = Ellipse(0.3, ratio * 0.3, widest)
    centre = np.tile((x, y), (len(PHI), 1))
    rho = ellipse.radius_in_direction(PHI, centre)
    p = rho[:, None] * np.column_stack((np.cos(PHI), np.sin(PHI))) - centre
    u = p @ (np.cos(widest), np.sin(widest)) / 0.3
    v = p @ (-np.sin(widest), np.cos(widest)) / (ratio * 0.3)
    np.testing.assert_allclose(u**2 + v**2, 1, atol=1e-9)
    assert (rho > 0).all()


@pytest.mark.parametrize("angle", [90.0, 60.0])
def test_a_leg_hardly_oval_is_the_round_one(angle: float) -> None:
    flat = OvalLegSurface.from_ovality(0.3, radians(angle), 1e-10, 0.7)
    round_ = LegSurface(0.3, radians(angle))
    rho = np.linspace(0.1, 0.28, len(PHI))
    points = round_.points_j(PHI, rho)
    for ours, theirs in (
        (flat.height(PHI, rho), round_.height(PHI, rho)),
        (flat.slope(PHI, rho), round_.slope(PHI, rho)),
        (flat.azimuth_derivative(PHI, rho), round_.azimuth_derivative(PHI, rho)),
        (flat.normal(points), round_.normal(points)),
        (flat.signed_distances(points + 0.01), round_.signed_distances(points + 0.01)),
    ):
        np.testing.assert_allclose(ours, theirs, atol=1e-8)
    start = np.column_stack((rho, round_.height(PHI, rho) + 0.05))
    down = np.tile((0.2, -1.0), (len(PHI), 1))
    np.testing.assert_allclose(
        flat.ray_intersections(PHI, start, down),
        round_.ray_intersections(PHI, start, down),
        atol=1e-8,
    )
    assert isinstance(flat.offset_surface(0.01), OvalLegSurface)


@pytest.mark.parametrize("angle", [90.0, 60.0])
def test_an_oval_legs_derivatives_and_normals_are_those_of_its_points(angle: float) -> None:
    leg = OvalLegSurface.from_ovality(0.3, radians(angle), 0.03, 0.7)
    rho, h = np.full_like(PHI, 0.22), 1e-6
    around = (leg.points_j(PHI + h, rho) - leg.points_j(PHI - h, rho)) / (2 * h)
    rise = (leg.height(PHI, rho + h) - leg.height(PHI, rho - h)) / (2 * h)
    np.testing.assert_allclose(leg.azimuth_derivative(PHI, rho), around, atol=1e-8)
    np.testing.assert_allclose(leg.slope(PHI, rho), rise, atol=1e-8)
    points = leg.points_j(PHI, rho)
    np.testing.assert_allclose(leg.signed_distances(points), 0, atol=EXACT)
    normal = leg.normal(points)
    np.testing.assert_allclose(np.sum(normal * around, axis=1), 0, atol=1e-8)
    np.testing.assert_allclose(leg.signed_distances(points + 1e-3 * normal), 1e-3, atol=1e-7)
    met = leg.ray_intersections(
        PHI, np.column_stack((rho, np.full_like(rho, 0.6))), np.array([[0.0, -1.0]])
    )
    np.testing.assert_allclose(met[:, 1], leg.height(PHI, rho), atol=EXACT)


# --- fit-up


def test_the_bevel_ends_on_a_brace_off_its_place() -> None:
    off = BraceMisfit(offset=3e-3, offset_towards=0.4, tilt=radians(0.5), tilt_towards=2.0)
    d = built(Imperfections(misfit=off, brace_ovality=Ovality(ovality=0.01, widest=0.9)))
    s = JointGrooveSections(d, PHI)
    x, y, z = cylindrical_to_j(PHI, s.p2[:, 0], s.p2[:, 1]).T
    cx = 3e-3 * np.cos(0.4) + z * np.tan(radians(0.5)) * np.cos(2.0)
    cy = 3e-3 * np.sin(0.4) + z * np.tan(radians(0.5)) * np.sin(2.0)
    direction = np.arctan2(y - cy, x - cx) - 0.9
    long, short = semi_axes_same_circumference(d.brace_radius, 0.01)
    radius = 1 / np.hypot(np.cos(direction) / long, np.sin(direction) / short)
    np.testing.assert_allclose(np.hypot(x - cx, y - cy), radius, atol=1e-8)
    # And it still is the prepared bevel: it starts on the land.
    rise = s.p2 - s.land
    np.testing.assert_allclose(
        rise / np.linalg.norm(rise, axis=1, keepdims=True), s.bevel, atol=1e-9
    )


def test_the_root_opens_as_stated() -> None:
    d = built(Imperfections(root=RootAsFitted(opening=(0.0, 1e-3, -1e-3, 0.5e-3))))
    s = JointGrooveSections(d, PHI)
    gap = LegSurface(d.leg_radius, d.angle).signed_distances(
        cylindrical_to_j(PHI, s.land[:, 0], s.land[:, 1])
    )
    np.testing.assert_allclose(
        gap, d.root_opening + interpolate_around_joint((0.0, 1e-3, -1e-3, 0.5e-3), PHI)
    )
    quarters = np.linspace(0, 1.5 * np.pi, 4)
    found = interpolate_around_joint((0.0, 1e-3, -1e-3, 0.5e-3), quarters)
    np.testing.assert_allclose(found, np.array((0, 1e-3, -1e-3, 0.5e-3)), atol=EXACT)


def test_an_open_root_shows_the_land_and_its_foot_on_the_leg() -> None:
    d = built(Imperfections(root=RootAsFitted(is_open=True)))
    s = JointGrooveSections(d, PHI)
    np.testing.assert_array_equal(s.p3, s.land)
    foot = cylindrical_to_j(PHI, s.p4[:, 0], s.p4[:, 1])
    np.testing.assert_allclose(d.leg_surface.signed_distances(foot), 0, atol=EXACT)
    # Square to the leg in the half-plane, so no nearer than the opening itself.
    assert s.root_width.min() >= d.root_opening - EXACT
    assert s.root_width.max() < 1.1 * d.root_opening


# --- solids


@pytest.mark.parametrize("name", ["tjoint-600x457", "yjoint-600x457-60deg"])
@pytest.mark.parametrize("imperfections", [BENT, DEPOSITED, OPEN], ids=["bent", "tacked", "open"])
def test_solids_are_watertight(imperfections: Imperfections, name: str) -> None:
    mesh = mesh_of(imperfections, name)
    solid = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    assert solid.is_watertight
    assert solid.volume > 0


@pytest.mark.parametrize("name", ["tjoint-600x457", "yjoint-600x457-60deg"])
def test_corners_lie_on_the_solid(name: str) -> None:
    """Rays from over the corner, along the bisector of the faces that meet there."""
    d, mesh = built(BENT, name), mesh_of(BENT, name)
    s = JointGrooveSections(d, PHI)
    surface = RaycastSurface(mesh.vertices, mesh.triangles)
    out = s.p4 + 1e-3 * np.column_stack((np.ones_like(PHI), d.leg_surface.slope(PHI, s.p4[:, 0])))
    up = s.p2 + np.array((0.0, 1e-3))
    for corner, one, other in ((s.p2, up, s.p3), (s.p3, s.p2, s.p4), (s.p4, s.p3, out)):
        outward = sum(
            (end - corner) / np.linalg.norm(end - corner, axis=1, keepdims=True)
            for end in (one, other)
        )
        outward = np.where(corner is s.p2, -1, 1) * np.asarray(outward)
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        start = corner + 1e-4 * outward
        origin, goal = (cylindrical_to_j(PHI, rz[:, 0], rz[:, 1]) for rz in (start, corner))
        way = (goal - origin) / np.linalg.norm(goal - origin, axis=1, keepdims=True)
        hits = surface.cast_rays(origin, way)
        np.testing.assert_allclose(hits.distance, 1e-4, atol=2 * ON_MESH)


def heights_over(d: JointDefinition, mesh: TriangleMesh, start: Array, end: Array) -> Array:
    """How far the solid rises over the middles of lines in the half-planes, (n,)."""
    middle, along = (start + end) / 2, end - start
    normal = along[:, ::-1] * (1, -1) / np.linalg.norm(along, axis=1, keepdims=True)
    above = middle + ABOVE * normal
    origin, goal = (cylindrical_to_j(PHI, rz[:, 0], rz[:, 1]) for rz in (above, middle))
    way = (goal - origin) / ABOVE
    return ABOVE - RaycastSurface(mesh.vertices, mesh.triangles).cast_rays(origin, way).distance


def test_bead_and_bevel_rise_as_stated() -> None:
    d, mesh = built(BENT), mesh_of(BENT)
    s = JointGrooveSections(d, PHI)
    bead = heights_over(d, mesh, s.p4, s.p3)
    np.testing.assert_allclose(
        bead, interpolate_around_joint(BENT.root.bead_height, PHI), atol=0.05e-3
    )
    # Over the middle of a bevel whose facets meet at 0.4 of it.
    length = np.linalg.norm(s.p2 - s.p3, axis=1)
    knee = np.tan(radians(6)) * 0.4 * 0.6 * length
    bevel = heights_over(d, mesh, s.p3, s.p2)
    np.testing.assert_allclose(bevel, knee * 0.5 / 0.6, atol=ON_MESH)


def test_tacks_cover_the_root_where_they_are_and_nowhere_else() -> None:
    d = built(replace(NO_IMPERFECTIONS, tacks=DEPOSITED.tacks))
    spans = tack_spans(d)
    middle = spans.mean(axis=1)
    np.testing.assert_allclose(middle, (0.3, 2.5))
    for tack, span in zip(d.imperfections.tacks, spans, strict=True):
        phi = np.linspace(span[0], span[1], 200)
        land = JointGrooveSections(d, phi).land
        line = cylindrical_to_j(phi, land[:, 0], land[:, 1])
        length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
        assert length == pytest.approx(tack.length, rel=0.01)
    assert is_within_spans(spans, middle).all()
    inward = np.array((1e-3, -1e-3))
    assert is_within_spans(spans, spans + inward).all()
    assert not is_within_spans(spans, spans - inward).any()
    assert is_within_spans(spans, np.array([0.3 - 2 * np.pi])).all()

    tacked, bare = build_joint_mesh(d), build_joint_mesh(joint())
    s = JointGrooveSections(d, PHI)
    more = heights_over(d, tacked, s.p4, s.p3) - heights_over(d, bare, s.p4, s.p3)
    on = is_within_spans(spans, PHI)
    assert (more[on] > 0.5e-3).all()
    np.testing.assert_allclose(more[~on], 0, atol=ON_MESH)


def test_corners_under_a_tack_have_no_error() -> None:
    d = built(replace(NO_IMPERFECTIONS, tacks=DEPOSITED.tacks))
    edges = feature_edges(d)
    phi = np.array((0.3, 1.0, 2.5))
    s = JointGrooveSections(d, phi)
    ends = [cylindrical_to_j(phi, rz[:, 0], rz[:, 1]) for rz in (s.p2, s.p2, s.p3, s.p4, s.p4)]
    errors = corner_to_edge_distances(np.stack(ends, axis=1), edges)
    np.testing.assert_array_equal(
        np.isnan(errors), [[False, True, True], [False] * 3, [False, True, True]]
    )
    np.testing.assert_allclose(errors[~np.isnan(errors)], 0, atol=1e-6)
    assert DistanceStatistics.from_distances(errors).max < 1e-3


def test_a_seams_cap_stands_on_the_leg() -> None:
    d = built(replace(NO_IMPERFECTIONS, seams=(SeamWeldCap(at=radians(70), height=2e-3),)))
    mesh = build_joint_mesh(d)
    outward = np.array((0.0, np.sin(radians(70)), np.cos(radians(70))))
    origin = (d.leg_radius + 0.05) * outward + (0.3, 0, 0)
    hits = RaycastSurface(mesh.vertices, mesh.triangles).cast_rays(origin[None], -outward[None])
    assert hits.distance[0] == pytest.approx(0.05 - 2e-3, abs=1e-5)


def test_the_same_seed_spatters_alike() -> None:
    table = replace(NO_IMPERFECTIONS, spatter=Spatter(density=40, seed=3))
    np.testing.assert_array_equal(mesh_of(table).vertices, build_joint_mesh(built(table)).vertices)
    other = build_joint_mesh(built(replace(NO_IMPERFECTIONS, spatter=Spatter(density=40, seed=4))))
    assert len(other.vertices) != len(mesh_of(table).vertices)


# --- refused


@pytest.mark.parametrize(
    ("imperfections", "key"),
    [
        (Imperfections(seams=(SeamWeldCap(at=radians(20)),)), "imperfections.seams.0.at_deg"),
        (
            Imperfections(root=RootAsFitted(is_open=True, opening=(-3.5e-3,))),
            "groove.root_opening_mm",
        ),
    ],
)
def test_what_cannot_be_built_is_refused(imperfections: Imperfections, key: str) -> None:
    with pytest.raises(ConfigurationError) as refusal:
        built(imperfections)
    assert refusal.value.key == key


@pytest.mark.parametrize(
    ("table", "key"),
    [
        ({"tackz": []}, "imperfections.tackz"),
        ({"misfit": {"offset": 1.0}}, "imperfections.misfit.offset"),
        ({"leg_ovality": {"ovality_percent": 50.0}}, "imperfections.leg_ovality.ovality_percent"),
        ({"root": {"opening_mm": []}}, "imperfections.root.opening_mm"),
    ],
)
def test_wrong_keys_are_named(table: dict[str, object], key: str) -> None:
    data = table_to_dict(JointFile.from_definition(joint())) | {"imperfections": table}
    with pytest.raises(ConfigurationError) as refusal:
        validate_table(JointFile, data)
    assert refusal.value.key == key
