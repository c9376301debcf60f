"""Frame g and the measures of a groove, on sections drawn by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array, rot_y
from tjscan.groove.section import GrooveMeasures, measure_groove, section_from_points

ROUNDING = 1e-12

# Wall along x at z = 0.2; bevel at 45°; root along x; leg falling away at 45°.
DRAWN = np.array(
    [
        [0.050, 0, 0.200],
        [0.020, 0, 0.200],
        [0.000, 0, 0.220],
        [-0.006, 0, 0.220],
        [-0.046, 0, 0.180],
    ]
)


def test_frame_g_has_the_papers_axes() -> None:
    T = section_from_points(DRAWN).T_s_g
    np.testing.assert_allclose(T[:3, 0], (0, 1, 0), atol=ROUNDING)  # v4 x v1: along y_s
    np.testing.assert_allclose(T[:3, 1], (1, 0, 0), atol=ROUNDING)  # up the brace
    np.testing.assert_allclose(T[:3, 2], (0, 0, -1), atol=ROUNDING)  # back to the sensor
    np.testing.assert_allclose(T[:3, 3], (-0.026, 0, 0.2), atol=ROUNDING)
    v1, v4 = DRAWN[1] - DRAWN[0], DRAWN[4] - DRAWN[3]
    across = np.cross(v4, v1)
    np.testing.assert_allclose(T[:3, 0], across / np.linalg.norm(across), atol=ROUNDING)


@pytest.mark.parametrize("over_surface", [False, True])
@given(seed=st.integers(0, 100_000))
def test_measures_change_with_corners_and_tangents_as_their_derivatives_say(
    over_surface: bool, seed: int
) -> None:
    random = np.random.default_rng(seed)
    corners = np.array(DRAWN)[1:4, [0, 2]] + random.uniform(-2e-3, 2e-3, (3, 2))
    tangents = np.array((np.pi, -0.75 * np.pi)) + random.uniform(-0.3, 0.3, 2)
    state = np.concatenate((corners.ravel(), tangents))
    # Points that were seen between p3 and p4 stay where they are when these move.
    share = np.array((0.1, 0.4, 0.8))[:, None]
    surface = corners[1] + share * (corners[2] - corners[1]) + random.uniform(-1e-3, 1e-3, (3, 2))

    def at(values: Array) -> GrooveMeasures:
        p2, p3, p4 = values[:6].reshape(3, 2).tolist()
        wall, leg = ((float(np.cos(a)), float(np.sin(a))) for a in values[6:])
        return measure_groove(p2, p3, p4, wall, leg, surface if over_surface else None)

    def numbers(values: Array) -> Array:
        found = at(values)
        return np.array([found.gamma_1 + found.gamma_2, found.width, found.depth, found.area])

    step = 1e-6  # a micrometre and a microradian: deep in the linear range
    slopes = [(numbers(state + e) - numbers(state - e)) / (2 * step) for e in step * np.eye(8)]
    np.testing.assert_allclose(np.array(slopes).T, at(state).jacobian, rtol=1e-6, atol=1e-8)


def test_a_surface_that_stands_proud_leaves_less_than_no_area() -> None:
    p2, p3, p4 = DRAWN[1:4, [0, 2]].tolist()
    tangents = (-1.0, 0.0), (-(0.5**0.5), -(0.5**0.5))
    proud = np.array([(p3[0], 0.1), (p4[0], 0.1)])
    assert measure_groove((p2[0], p2[1]), (p3[0], p3[1]), (p4[0], p4[1]), *tangents, proud).area < 0


def test_known_measures() -> None:
    section = section_from_points(DRAWN)
    assert section.groove_angle == pytest.approx(np.pi / 2)
    assert section.gamma_1 == pytest.approx(np.pi / 4)
    assert section.gamma_2 == pytest.approx(np.pi / 4)
    assert section.work_angle == pytest.approx(0, abs=ROUNDING)
    assert section.root_width == pytest.approx(0.006)
    assert section.depth == pytest.approx(0.020)
    # A trapezium: from p2 to the origin 46 mm, from p3 to p4 6 mm, 20 mm apart.
    assert section.area == pytest.approx(0.5 * (0.046 + 0.006) * 0.020)


@pytest.mark.parametrize("lean", np.radians([-20, 0, 35]))
def test_work_angle_is_half_the_difference(lean: float) -> None:
    # The leg rises towards the sensor's side by `lean` against 45°.
    points = DRAWN.copy()
    out = 0.04 * np.array([-np.sin(np.pi / 4 + lean), 0, -np.cos(np.pi / 4 + lean)])
    points[4] = points[3] + out
    section = section_from_points(points)
    assert section.gamma_2 == pytest.approx(np.pi / 4 + lean)
    assert section.work_angle == pytest.approx(-lean / 2)
    assert section.gamma_1 + section.gamma_2 == pytest.approx(section.groove_angle)


def turned(points: Array, angle: float, shift: tuple[float, float]) -> Array:
    return np.asarray(points @ rot_y(angle).T + (shift[0], 0.0, shift[1]))


@settings(max_examples=30, deadline=None)
@given(angle=st.floats(-3, 3), x=st.floats(-0.1, 0.1), z=st.floats(-0.1, 0.1))
def test_measures_do_not_depend_on_the_pose(angle: float, x: float, z: float) -> None:
    here = section_from_points(DRAWN)
    there = section_from_points(turned(DRAWN, angle, (x, z)))
    for name in ("groove_angle", "work_angle", "root_width", "depth", "area"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), abs=1e-9)
    expected = np.vstack((turned(here.T_s_g[:3, 3], angle, (x, z)),))
    np.testing.assert_allclose(there.T_s_g[:3, 3], expected[0], atol=1e-9)
    np.testing.assert_allclose(there.T_s_g[:3, :3], rot_y(angle) @ here.T_s_g[:3, :3], atol=1e-9)


def test_a_mirrored_section_turns_x_of_g_round() -> None:
    section = section_from_points(DRAWN * (-1, 1, 1))
    np.testing.assert_allclose(section.T_s_g[:3, 0], (0, -1, 0), atol=ROUNDING)
    np.testing.assert_allclose(section.T_s_g[:3, 2], (0, 0, -1), atol=ROUNDING)
    assert np.linalg.det(section.T_s_g[:3, :3]) == pytest.approx(1)
    assert section.area == pytest.approx(section_from_points(DRAWN).area)


def test_tangents_replace_chords() -> None:
    bent = DRAWN.copy()
    bent[4] += (0.0, 0, 0.003)  # the far end of a leg that falls away
    leg = DRAWN[4] - DRAWN[3]
    section = section_from_points(bent, leg_s=leg / np.linalg.norm(leg))
    assert section.groove_angle == pytest.approx(np.pi / 2)
    assert section.area == pytest.approx(section_from_points(DRAWN).area)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000))
def test_uncertainty_propagates_as_differences_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a = 1e-5 * rng.standard_normal((8, 8))
    covariance = a @ a.T
    section = section_from_points(DRAWN, covariance=covariance)
    # Width by hand: it depends on x of p3 and p4 alone, these lying level.
    along = np.zeros(8)
    along[2], along[4] = 1, -1
    variance = section.measure_covariance[1, 1]
    assert variance == pytest.approx(along @ covariance @ along, rel=2e-5)
    assert section.area_sigma > 0


def test_a_section_can_not_be_written_to() -> None:
    section = section_from_points(DRAWN)
    with pytest.raises(ValueError, match="read-only"):
        section.points_s[0, 0] = 1


def test_parallel_wall_and_leg_span_no_frame() -> None:
    points = DRAWN.copy()
    points[4] = points[3] + (-0.04, 0, 0)
    with pytest.raises(GrooveNotFound) as caught:
        section_from_points(points)
    assert caught.value.reason == "no bevel"


@pytest.mark.parametrize(
    "points", [np.zeros((4, 3)), np.full((5, 3), np.nan), np.add(DRAWN, (0, 0.001, 0))]
)
def test_what_is_no_section_is_refused(points: Array) -> None:
    with pytest.raises(ValueError, match="five finite points"):
        section_from_points(points)
