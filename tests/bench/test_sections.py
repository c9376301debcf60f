"""The bench's own ray caster and sections against closed forms."""

import math

import numpy as np
import pytest
from _sections import EMITTER_Z, Array, Tubes, first_hits, hidden_corners, look_at, pose_before
from _steel import GROOVES, TUBES, Fault, cuts, draw, shoot

EXACT = 1e-12
SAG = 1e-6
"""Chords of half a millimetre leave a tube of 0.16 m by no more, in metres."""


@pytest.mark.parametrize("slope", [-0.6, 0.0, 0.3])
def test_rays_meet_a_plane_where_two_lines_cross(slope: float) -> None:
    line = np.array([[-0.2, 0.24 - 0.2 * slope], [0.2, 0.24 + 0.2 * slope]])
    seen = look_at([line])
    # x = u (z - z0) and z = 0.24 + slope x.
    depth = (0.24 - EMITTER_Z) / (1 - slope * seen.tangents)
    there = np.isfinite(seen.points[:, 0])
    assert there.sum() > 400
    np.testing.assert_allclose(seen.points[there, 1], (EMITTER_Z + depth)[there], atol=EXACT)
    # A plane's incidence is the angle between its normal and the ray.
    incidence = np.abs(np.arctan(slope) + np.arctan(seen.tangents))
    np.testing.assert_allclose(seen.incidence[there], incidence[there], atol=1e-6)


def test_rays_meet_the_near_side_of_a_circle() -> None:
    centre, radius = np.array((0.004, 0.29)), 0.05
    angle = np.linspace(0, 2 * np.pi, 20_001)
    circle = centre + radius * np.column_stack((np.cos(angle), np.sin(angle)))
    seen = look_at([circle])
    there = np.isfinite(seen.points[:, 0])
    off = np.linalg.norm(seen.points[there] - centre, axis=1) - radius
    assert there.sum() > 200
    assert np.abs(off).max() < 1e-8
    assert seen.points[there, 1].max() < centre[1]


def test_the_detector_hides_what_stands_behind_an_edge() -> None:
    floor = np.array([[-0.1, 0.26], [0.1, 0.26]])
    post = np.array([[0.0, 0.26], [0.0, 0.24]])
    second_eye = np.array((0.10, 0.06))
    seen = look_at([floor, post], second_eye)
    # The post's shadow on the floor, from the second eye: similar triangles.
    shadow = second_eye[0] * (1 - 0.20 / 0.18)
    x = seen.tangents * (0.26 - EMITTER_Z)
    lit = np.isfinite(seen.points[:, 0])
    assert not lit[(x < 0) & (x > shadow)].any()
    assert lit[(x > 0) | (x < shadow - 1e-4)].all()


def test_a_ray_that_meets_nothing_goes_on_for_ever() -> None:
    away = np.array([[0.01, 0.1], [0.02, 0.1]])
    assert np.isinf(first_hits([away], np.zeros(2), np.array([-0.1, 0.0]))).all()


@pytest.mark.parametrize("k", range(8))
def test_wall_and_leg_lie_on_their_tubes(k: int) -> None:
    g = draw(np.random.default_rng(k), k)
    pose, tubes = g.pose, g.pose.tubes

    def in_space(line: Array) -> Array:
        return np.asarray(pose.origin + line[:, :1] * pose.x + line[:, 1:] * pose.z)

    axis = np.array((math.sin(tubes.angle), 0.0, math.cos(tubes.angle)))
    wall, leg = in_space(g.wall), in_space(g.leg)
    np.testing.assert_allclose(np.hypot(wall[:, 0], wall[:, 1]), tubes.brace, atol=EXACT)
    off_axis = np.linalg.norm(np.cross(leg, axis), axis=1)
    np.testing.assert_allclose(off_axis, tubes.leg, atol=EXACT)
    seen = look_at(g.lines)
    on_leg = in_space(seen.points[seen.points[:, 0] < g.corners[2, 0] - 1e-3])
    off = np.linalg.norm(np.cross(on_leg, axis), axis=1) - tubes.leg
    assert np.nanmax(np.abs(off)) < SAG


@pytest.mark.parametrize("tubes", TUBES)
def test_tubes_meet_at_their_dihedral_angle(tubes: Tubes) -> None:
    for phi in np.linspace(0, 2 * np.pi, 7):
        pose = pose_before(tubes, phi, shift=None)
        wall, leg = cuts(pose)
        between = math.acos(wall.forward @ leg.forward)
        # cos(psi) = cos(phi) cos(theta) sqrt(1 - k² sin²(phi)) - k sin²(phi)
        k, s2 = tubes.brace / tubes.leg, math.sin(phi) ** 2
        cosine = math.cos(phi) * math.cos(tubes.angle) * math.sqrt(1 - k**2 * s2) - k * s2
        assert pose.dihedral == pytest.approx(math.acos(cosine), abs=1e-9)
        # The plane stands square to the groove but for its distance along the tubes.
        assert between == pytest.approx(pose.dihedral, abs=0.01)


@pytest.mark.parametrize("fault", GROOVES, ids=lambda f: f.name)
def test_corners_that_are_there_lie_where_their_lines_end(fault: Fault) -> None:
    for k in range(4):
        g = shoot(fault, k).groove
        p2, p3, p4 = g.corners
        tolerance = 0.3e-3 if fault.name == "flame-cut scallops" else 1e-9
        if fault.name in ("mill scale", "several at once"):
            tolerance = 0.5e-3
        assert np.linalg.norm(g.wall[-1] - p2) < tolerance
        assert np.linalg.norm(g.bevel[0] - p2) < 1e-9
        assert np.linalg.norm(g.bevel[-1] - p3) < 1e-9
        if g.there[2] and fault.name != "open root":
            assert np.linalg.norm(g.root[-1] - p4) < 1e-9
            assert np.linalg.norm(g.leg[0] - p4) < tolerance


@pytest.mark.parametrize("fault", GROOVES, ids=lambda f: f.name)
def test_a_row_shows_the_same_profiles_again(fault: Fault) -> None:
    np.testing.assert_array_equal(shoot(fault, 5).points, shoot(fault, 5).points)


def test_a_corner_is_hidden_where_reflections_leave_too_little_on_one_side() -> None:
    tangents = np.linspace(-0.2, 0.2, 401)
    corner = np.array((0.0005,))
    surface = np.ones(401, dtype=bool)
    surface[193:201] = False
    # Columns 189 to 200 lie before the corner: the first four are left of them.
    assert hidden_corners(tangents, corner, surface).tolist() == [True]
    surface[193] = True
    assert hidden_corners(tangents, corner, surface).tolist() == [False]
    assert hidden_corners(-tangents, -corner, surface).tolist() == [False]
