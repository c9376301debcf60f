"""The light of the simulated laser goes where geometry says."""

import numpy as np
import open3d as o3d
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tjscan.core.frames import Array, pose, rot_x, rot_y, rot_z, transform_points
from tjscan.laser.faults import LaserRayHits
from tjscan.laser.model import LaserModel
from tjscan.laser.optics import (
    LEAST_GHOST_DISTANCE,
    RaycastSurface,
    laser_ray_directions,
    trace_laser_rays,
)

EXACT = 1e-9
"""Metres: distances come from float64 planes; float32 only chooses the triangle."""
ON_MESH = 1e-6
"""Metres: Open3D measures distances to a mesh in float32."""

IDEAL = LaserModel.without_faults()
MIRRORING = LaserModel.without_faults(ghosts=0.1)
T_J_S = pose(rot_z(0.4) @ rot_y(-0.7) @ rot_x(2.0), (0.31, -0.22, 0.47))
"""A pose like any other."""

Part = tuple[Array, NDArray[np.intp]]
"""Vertices in frame j and triangles."""

QUAD = np.array([[0, 1, 2], [0, 2, 3]])

angles = st.floats(-np.pi, np.pi)
lengths = st.floats(-1.0, 1.0)


def plane(normal: Array, point: Array, T_j_s: Array = T_J_S, half: float = 0.5) -> Part:
    """Vertices in frame j and triangles of a square given in frame s."""
    across = np.linalg.svd(normal[None])[2][1:]
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    return transform_points(T_j_s, point + corners @ across), QUAD


def together(*parts: Part) -> RaycastSurface:
    starts = np.cumsum([0] + [len(v) for v, _ in parts])
    return RaycastSurface(
        np.vstack([v for v, _ in parts]),
        np.vstack([t + start for (_, t), start in zip(parts, starts, strict=False)]),
    )


def points(hits: LaserRayHits, distance: Array, model: LaserModel = IDEAL) -> Array:
    """Points in frame s at these distances."""
    return np.asarray(distance[:, None] * hits.directions_s + [0, 0, model.emitter_z])


def seen_points(hits: LaserRayHits) -> Array:
    return points(hits, hits.distance)[hits.seen]


def wedge(opening: float, pull: float) -> tuple[list[Part], tuple[Array, Array], Array]:
    """A valley of two half planes, its bottom crossing the central ray at z = 240 mm.

    Returns its parts, the normals of its lower and upper half in frame s, and the bottom.
    """
    bottom = np.array([0.0, 0.0, 0.24])
    turn = rot_x(pull)
    along = turn @ [0.0, 1.0, 0.0]
    parts, normals = [], []
    for side in (-1.0, 1.0):
        up = turn @ [side * np.sin(opening / 2), 0.0, -np.cos(opening / 2)]
        corners = np.array(
            [
                bottom + 0.2 * along,
                bottom - 0.2 * along,
                bottom - 0.2 * along + 0.2 * up,
                bottom + 0.2 * along + 0.2 * up,
            ]
        )
        parts.append((transform_points(T_J_S, corners), QUAD))
        normal = np.cross(along, up)
        normals.append(-np.sign(normal[2]) * normal)  # towards the sensor
    return parts, (normals[0], normals[1]), bottom


@settings(deadline=None, max_examples=60)
@given(
    rotation=st.tuples(angles, angles, angles),
    place=st.tuples(lengths, lengths, lengths),
    tilt=st.tuples(st.floats(-1.0, 1.0), st.floats(-0.9, 0.9)),
    z=st.floats(0.195, 0.285),
)
def test_a_plane_is_seen_exactly_where_it_is(
    rotation: tuple[float, float, float],
    place: tuple[float, float, float],
    tilt: tuple[float, float],
    z: float,
) -> None:
    a, b, c = rotation
    T_j_s = pose(rot_z(a) @ rot_y(b) @ rot_x(c), place)
    normal_s = rot_x(tilt[0]) @ rot_y(tilt[1]) @ [0, 0, -1]
    point_s = np.array([0, 0, z])
    surface = RaycastSurface(*plane(normal_s, point_s, T_j_s))
    hits = trace_laser_rays(surface, T_j_s, IDEAL, laser_ray_directions(IDEAL))
    found = seen_points(hits)
    assert len(found) > 0
    np.testing.assert_allclose((found - point_s) @ normal_s, 0, atol=EXACT)
    np.testing.assert_allclose(found[:, 1], 0, atol=EXACT)
    np.testing.assert_allclose(hits.incidence_cosine, -hits.directions_s @ normal_s, atol=EXACT)


@pytest.mark.parametrize(("z", "width"), [(0.190, 0.083), (0.290, 0.121)])
def test_the_range_is_the_sensors_trapezoid(z: float, width: float) -> None:
    inside = z + (1e-9 if z < 0.24 else -1e-9)
    surface = RaycastSurface(*plane(np.array([0, 0, 1.0]), np.array([0, 0, inside])))
    x = seen_points(trace_laser_rays(surface, T_J_S, IDEAL, laser_ray_directions(IDEAL)))[:, 0]
    assert len(x) == IDEAL.columns
    assert np.all(np.diff(x) > 0)
    np.testing.assert_allclose((x[0], x[-1]), (-width / 2, width / 2), atol=1e-8)


def test_nothing_is_seen_outside_the_range() -> None:
    for z in (IDEAL.near - 1e-6, IDEAL.far + 1e-6):
        surface = RaycastSurface(*plane(np.array([0, 0, 1.0]), np.array([0, 0, z])))
        assert not trace_laser_rays(surface, T_J_S, IDEAL, laser_ray_directions(IDEAL)).seen.any()
    steep = RaycastSurface(*plane(rot_y(1.2) @ [0, 0, 1.0], np.array([0, 0, 0.24])))
    hits = trace_laser_rays(steep, T_J_S, IDEAL, laser_ray_directions(IDEAL))
    z_s = points(hits, hits.distance)[:, 2]
    np.testing.assert_array_equal(hits.seen, (z_s >= IDEAL.near) & (z_s <= IDEAL.far))
    assert 0 < hits.seen.sum() < IDEAL.columns


def test_all_points_lie_on_the_mesh() -> None:
    leg = trimesh.creation.cylinder(0.3, 1.5, sections=360)
    leg.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    brace = trimesh.creation.cylinder(0.2286, 1.2, sections=360)
    solid = trimesh.util.concatenate([leg, brace])
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(solid.vertices.astype(np.float32)),
        o3d.core.Tensor.from_numpy(solid.faces.astype(np.uint32)),
    )
    surface = RaycastSurface(solid.vertices, solid.faces)
    z_s = np.array([-1.0, 0.0, -1.0]) / np.sqrt(2)
    R_j_s = np.column_stack((np.cross([0, -1.0, 0], z_s), [0, -1.0, 0], z_s))
    T_j_s = pose(R_j_s, np.array([0.2286, 0, 0.3]) - 0.24 * z_s)
    found = seen_points(trace_laser_rays(surface, T_j_s, IDEAL, laser_ray_directions(IDEAL)))
    assert len(found) > 400
    points_j = transform_points(T_j_s, found).astype(np.float32)
    away = scene.compute_distance(o3d.core.Tensor.from_numpy(points_j)).numpy()
    assert away.max() < ON_MESH


@pytest.mark.parametrize(("height", "hidden"), [(0.0179, False), (0.0181, True)])
def test_a_step_hides_its_foot_from_the_detector(height: float, hidden: bool) -> None:
    """The wall stands 5 mm beside the laser plane on a floor at z = 260 mm.

    Similar triangles: it hides the line when higher than 5 / 80 of the detector's 288.4 mm.
    """
    floor = plane(np.array([0, 0, 1.0]), np.array([0, 0, 0.26]))
    wall_s = np.array(
        [
            [-0.5, 0.005, 0.26],
            [0.5, 0.005, 0.26],
            [0.5, 0.005, 0.26 - height],
            [-0.5, 0.005, 0.26 - height],
        ]
    )
    wall = (transform_points(T_J_S, wall_s), QUAD)
    surface = together(floor, wall)
    seen = trace_laser_rays(surface, T_J_S, IDEAL, laser_ray_directions(IDEAL)).seen
    assert seen.all() != hidden
    assert seen.any() != hidden
    for free in (
        LaserModel.without_faults(detector_y=-0.08),
        LaserModel.without_faults(detector_y=0, detector_z=IDEAL.emitter_z),
    ):
        assert trace_laser_rays(surface, T_J_S, free, laser_ray_directions(free)).seen.all()


@pytest.mark.parametrize("half", [0.5, 0.002])  # the small one's other side hides nothing
@pytest.mark.parametrize(("beyond", "seen"), [(-0.002, True), (0.002, False)])
def test_a_face_turned_away_from_the_detector_is_not_seen(
    beyond: float, seen: bool, half: float
) -> None:
    edge_on = np.arctan((0.24 - IDEAL.detector_z) / IDEAL.detector_y)
    a = edge_on + beyond
    normal, point = np.array([0, -np.sin(a), -np.cos(a)]), np.array([0, 0, 0.24])
    hits = trace_laser_rays(
        RaycastSurface(*plane(normal, point, half=half)), T_J_S, IDEAL, laser_ray_directions(IDEAL)
    )
    hit = np.isfinite(hits.distance)
    assert hit.sum() > 10
    np.testing.assert_array_equal(hits.seen[hit], seen)


@pytest.mark.parametrize("opening", np.radians([50, 70, 90, 110]))
@pytest.mark.parametrize("pull", np.radians([0, 10, -20]))
def test_a_ghost_is_the_mirror_image_of_the_other_face(opening: float, pull: float) -> None:
    parts, normals, bottom = wedge(opening, pull)
    surface = together(*parts)
    hits = trace_laser_rays(surface, T_J_S, MIRRORING, laser_ray_directions(MIRRORING))
    images = points(hits, hits.ghost)
    for own, other in (normals, normals[::-1]):
        on_own = np.abs((points(hits, hits.distance) - bottom) @ own) < EXACT
        mirrored = other - 2 * (other @ own) * own
        ghosts = images[on_own & np.isfinite(hits.ghost)]
        assert len(ghosts) > 20
        np.testing.assert_allclose((ghosts - bottom) @ mirrored, 0, atol=EXACT)
        assert np.all((ghosts - bottom) @ own < 0)  # behind the mirror
        assert np.all((ghosts[:, 2] >= IDEAL.near) & (ghosts[:, 2] <= IDEAL.far))
    ghosting = np.isfinite(hits.ghost)
    assert np.all(hits.ghost[ghosting] - hits.distance[ghosting] > LEAST_GHOST_DISTANCE)


def test_what_the_detector_does_not_see_shows_no_ghost_either() -> None:
    valley, _, _ = wedge(np.pi / 2, 0.0)
    screen_s = [[0, 0.005, 0.1], [0.2, 0.005, 0.1], [0.2, 0.005, 0.24], [0, 0.005, 0.24]]
    screen = (transform_points(T_J_S, screen_s), QUAD)
    open_view = trace_laser_rays(
        together(*valley), T_J_S, MIRRORING, laser_ray_directions(MIRRORING)
    )
    view = trace_laser_rays(
        together(*valley, screen), T_J_S, MIRRORING, laser_ray_directions(MIRRORING)
    )
    hidden = open_view.seen & ~view.seen
    assert np.sum(hidden & np.isfinite(open_view.ghost)) > 100
    assert not np.any(hidden & np.isfinite(view.ghost))
    assert np.sum(np.isfinite(view.ghost)) > 100


@pytest.mark.parametrize("opening", np.radians([180, 220]))
def test_without_a_second_face_there_is_no_ghost(opening: float) -> None:
    parts, _, _ = wedge(opening, 0.1)
    hits = trace_laser_rays(together(*parts), T_J_S, MIRRORING, laser_ray_directions(MIRRORING))
    assert hits.seen.any()
    assert np.isnan(hits.ghost).all()


def test_moving_surface_and_sensor_together_changes_nothing() -> None:
    T = pose(rot_x(1.0) @ rot_z(-2.0), (0.8, -0.5, 0.9))
    v = np.vstack([plane(rot_y(t) @ [0, 0, -1.0], np.array([0, 0, 0.27]))[0] for t in (-0.7, 0.7)])
    t = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    here = trace_laser_rays(RaycastSurface(v, t), T_J_S, MIRRORING, laser_ray_directions(MIRRORING))
    there = trace_laser_rays(
        RaycastSurface(transform_points(T, v), t),
        T @ T_J_S,
        MIRRORING,
        laser_ray_directions(MIRRORING),
    )
    np.testing.assert_array_equal(here.seen, there.seen)
    np.testing.assert_allclose(here.distance, there.distance, atol=EXACT)
    np.testing.assert_allclose(here.ghost, there.ghost, atol=EXACT)


def test_a_scene_far_from_the_origin_is_seen_as_well_as_a_near_one() -> None:
    T = pose(p=(1e4, -2e4, 3e4))  # where float32 has steps of 2 mm
    v, t = plane(rot_y(0.3) @ [0, 0, -1.0], np.array([0, 0, 0.24]))
    here = trace_laser_rays(RaycastSurface(v, t), T_J_S, IDEAL, laser_ray_directions(IDEAL))
    there = trace_laser_rays(
        RaycastSurface(transform_points(T, v), t), T @ T_J_S, IDEAL, laser_ray_directions(IDEAL)
    )
    np.testing.assert_array_equal(here.seen, there.seen)
    np.testing.assert_allclose(here.distance, there.distance, atol=EXACT)


def test_the_sense_of_the_triangles_does_not_matter() -> None:
    v, t = plane(rot_y(0.3) @ [0, 0, -1.0], np.array([0, 0, 0.24]))
    one, other = (
        trace_laser_rays(RaycastSurface(v, k), T_J_S, IDEAL, laser_ray_directions(IDEAL))
        for k in (t, t[:, ::-1])
    )
    np.testing.assert_allclose(one.distance, other.distance, atol=EXACT)
    np.testing.assert_allclose(one.normals_s, other.normals_s, atol=EXACT)


def test_drawing_the_sensor_back_moves_the_points_away() -> None:
    surface = RaycastSurface(*plane(np.array([0, 0, 1.0]), np.array([0, 0, 0.24])))
    back = T_J_S @ pose(p=(0, 0, -0.01))
    for T_j_s, z in ((T_J_S, 0.24), (back, 0.25)):
        np.testing.assert_allclose(
            seen_points(trace_laser_rays(surface, T_j_s, IDEAL, laser_ray_directions(IDEAL)))[:, 2],
            z,
            atol=EXACT,
        )


@pytest.mark.parametrize(
    ("vertices", "triangles"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]]),
        (np.full((3, 3), np.nan), [[0, 1, 2]]),
        (np.eye(3), np.empty((0, 3), dtype=int)),
        (np.eye(3), [[0, 1, 3]]),
        (np.eye(3), [[0, 1, -1]]),
        (np.eye(3), [[0.0, 1.0, 2.0]]),
        (np.eye(3), [[0, 1]]),
    ],
)
def test_what_is_no_mesh_is_refused(vertices: Array, triangles: Array) -> None:
    with pytest.raises(ValueError, match=r"vertices|triangles"):
        RaycastSurface(vertices, triangles)
