from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tjscan.joint.geometry import (
    LegSurface,
    cylindrical_to_j,
    radial_direction,
    tangential_direction,
)

EXACT = 1e-12
"""Rounding of float64 in metres and radians."""

STEP = 1e-6
DIFFERENCE = 1e-8
"""Error of a central difference over STEP, in metres per radian."""

angles = st.floats(np.deg2rad(45), np.deg2rad(90))
azimuths = st.floats(0, 2 * np.pi)
ratios = st.floats(0.1, 1 / 1.05)
radii = st.floats(0.05, 1.0)

PAPER = LegSurface(0.300, np.pi / 2)
BRACE = 0.2286


@settings(max_examples=50, deadline=None)
@given(radii, ratios, angles, azimuths)
def test_points_lie_on_both_cylinders(R: float, k: float, theta: float, phi: float) -> None:
    leg = LegSurface(R, theta)
    point = leg.points_j(phi, k * R)
    assert leg.signed_distances(point) == pytest.approx(0, abs=EXACT)
    assert np.hypot(point[0], point[1]) == pytest.approx(k * R, abs=EXACT)


@settings(max_examples=50, deadline=None)
@given(radii, ratios, angles, azimuths)
def test_dihedral_angle_is_that_of_the_tangent_planes(
    R: float, k: float, theta: float, phi: float
) -> None:
    leg = LegSurface(R, theta)
    normal = leg.normal(leg.points_j(phi, k * R))
    assert leg.dihedral_angle(phi, k * R) == pytest.approx(
        np.pi - np.arccos(normal @ radial_direction(phi))
    )


@settings(max_examples=50, deadline=None)
@given(ratios, angles, azimuths)
def test_derivatives_are_those_of_the_surface(k: float, theta: float, phi: float) -> None:
    leg, rho = LegSurface(0.3, theta), k * 0.3
    around = (leg.points_j(phi + STEP, rho) - leg.points_j(phi - STEP, rho)) / (2 * STEP)
    outward = (leg.height(phi, rho + STEP) - leg.height(phi, rho - STEP)) / (2 * STEP)
    np.testing.assert_allclose(leg.azimuth_derivative(phi, rho), around, atol=DIFFERENCE)
    np.testing.assert_allclose(leg.slope(phi, rho), outward, atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(leg.tangent(phi, rho)), 1)
    assert leg.tangent(phi, rho) @ tangential_direction(phi) > 0


@settings(max_examples=50, deadline=None)
@given(angles, azimuths, st.floats(0.02, 0.28), st.floats(-0.3, 0.3))
def test_a_ray_ends_on_the_surface_and_on_itself(
    theta: float, phi: float, rho: float, lean: float
) -> None:
    leg = LegSurface(0.3, theta)
    start = np.array([[rho, float(leg.height(phi, rho)) + 0.05]])
    ray = np.array([[np.sin(lean), -np.cos(lean)]])
    end = leg.ray_intersections(np.array([phi]), start, ray)
    assume(np.isfinite(end).all())  # a ray that leans outward may pass by
    assert leg.signed_distances(cylindrical_to_j(phi, end[:, 0], end[:, 1]))[0] == pytest.approx(
        0, abs=EXACT
    )
    travel = end - start
    assert travel[0] @ ray[0] > 0
    assert travel[0, 0] * ray[0, 1] == pytest.approx(travel[0, 1] * ray[0, 0], abs=EXACT)


def test_a_ray_that_passes_by_ends_nowhere() -> None:
    end = PAPER.ray_intersections(
        np.array([np.pi / 2]), np.array([[0.31, 0.5]]), np.array([[0.0, -1.0]])
    )
    assert np.isnan(end).all()


@settings(max_examples=20, deadline=None)
@given(angles, azimuths, st.floats(1e-3, 0.02))
def test_an_offset_surface_keeps_its_distance(theta: float, phi: float, gap: float) -> None:
    leg = LegSurface(0.3, theta)
    assert leg.signed_distances(leg.offset_surface(gap).points_j(phi, 0.2)) == pytest.approx(
        gap, abs=EXACT
    )


def test_a_right_angled_joint_is_the_textbook_curve() -> None:
    phi = np.linspace(0, 2 * np.pi, 50)
    np.testing.assert_allclose(
        PAPER.height(phi, BRACE), np.sqrt(0.3**2 - (BRACE * np.sin(phi)) ** 2), atol=EXACT
    )
    np.testing.assert_allclose(
        np.cos(PAPER.dihedral_angle(phi, BRACE)), -BRACE / 0.3 * np.sin(phi) ** 2, atol=EXACT
    )


def test_the_papers_joint_has_its_known_figures() -> None:
    """Dihedral angle 90° to 139.6°, a drop of 105.7 mm, half an intersection of 755 mm."""
    assert np.rad2deg(PAPER.dihedral_angle(0, BRACE)) == pytest.approx(90)
    assert np.rad2deg(PAPER.dihedral_angle(np.pi / 2, BRACE)) == pytest.approx(139.6, abs=0.05)
    drop = PAPER.height(0, BRACE) - PAPER.height(np.pi / 2, BRACE)
    assert 1e3 * drop == pytest.approx(105.7, abs=0.05)
    assert 1e3 * PAPER.arc_length(BRACE, 0, np.pi) == pytest.approx(755, abs=0.5)


def test_the_heel_of_a_leaning_brace_is_at_azimuth_zero() -> None:
    leaning = LegSurface(0.3, np.deg2rad(60))
    assert np.rad2deg(leaning.dihedral_angle(0, BRACE)) == pytest.approx(60)
    assert np.rad2deg(leaning.dihedral_angle(np.pi, BRACE)) == pytest.approx(120)
    assert leaning.height(0, BRACE) > leaning.height(np.pi, BRACE)
