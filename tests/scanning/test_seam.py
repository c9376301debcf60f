"""Laws of the two tubes that sections tell of, and of what varies along them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from seams import Noise, seam

from tjscan.scanning.seam_fit import (
    MOST_RECENT_SECTIONS,
    LocalWalls,
    RecentSections,
    fit_tubes_to_sections,
)
from tjscan.scanning.target import ScanDirection


@pytest.mark.parametrize("joint", ["tjoint-600x457", "yjoint-600x457-60deg", "tjoint-406x324"])
@pytest.mark.parametrize("direction", ScanDirection)
def test_without_noise_five_sections_hold_both_tubes(joint: str, direction: ScanDirection) -> None:
    world = seam(joint, direction)
    fitted = fit_tubes_to_sections(RecentSections(world.walk(0.3, 0.05, 5)))
    walls, true = fitted.walls(), world.definition
    # A prior that asks for other sizes moves them by little.
    np.testing.assert_allclose(
        1 / walls.curvatures, (true.brace_radius, true.leg_radius), rtol=0.01
    )
    axes = np.cross(walls.across, walls.normals)
    assert abs(axes[0, 2]) == pytest.approx(1.0, abs=1e-5)
    assert abs(axes[1] @ true.leg_surface.axis) == pytest.approx(1.0, abs=1e-4)
    assert np.abs(fitted.residuals[:4]).max() < 20e-6


def test_with_noise_the_radii_are_as_uncertain_as_told() -> None:
    off = []
    for seed in range(20):
        world = seam(noise=Noise(), seed=seed)
        fitted = fit_tubes_to_sections(RecentSections(world.walk(0.3, 0.05, 5)))
        told = 0.7 * np.sqrt(fitted.covariance[4, 4])  # of ln(1/r); 0.7 is the prior's unit
        off.append(np.log(fitted.walls().curvatures[0] * world.definition.brace_radius) / told)
    # Tubes are round here: what is allowed for their being out of round is not used up.
    assert np.sqrt(np.mean(np.square(off))) < 1.5


def test_at_the_crown_the_seam_bends_as_both_tubes_do() -> None:
    world = seam()
    scans = world.walk(-0.4, 0.02, 6)
    azimuth = np.arctan2(scans[-1].T_b_g[1, 3], scans[-1].T_b_g[0, 3])
    assert abs(azimuth) < 0.1
    true = world.definition
    # There z = R - (r phi)²/2R, and the radius about the axis is r.
    expected = np.hypot(1 / true.brace_radius, 1 / true.leg_radius)
    assert fit_tubes_to_sections(RecentSections(scans)).seam_curvature() == pytest.approx(
        expected, rel=0.05
    )


def test_only_the_last_sections_count() -> None:
    scans = seam().walk(-1.0, 0.01, MOST_RECENT_SECTIONS + 3)
    track = RecentSections(scans)
    assert len(track.along) == MOST_RECENT_SECTIONS
    assert track.along[-1] == 0
    assert track.along[0] == pytest.approx(-0.01 * (MOST_RECENT_SECTIONS - 1), rel=1e-3)


@settings(deadline=None, max_examples=50)
@given(
    radius=st.floats(0.05, 5.0),
    h=st.floats(-0.02, 0.05),
    c=st.floats(-0.04, 0.04),
    along=st.floats(-1, 1),
)
def test_how_far_a_point_lies_outside_a_tube_is_exact(
    radius: float, h: float, c: float, along: float
) -> None:
    walls = LocalWalls(
        np.zeros((2, 3)),
        np.tile((0.0, 0.0, 1.0), (2, 1)),
        np.tile((0.0, 1.0, 0.0), (2, 1)),
        np.full(2, 1 / radius),
    )
    point = np.tile((along, c, h), (2, 1, 1))
    distance, slope = walls.offsets_and_slopes(point, np.tile((0.0, 0.0, 1.0), (2, 1, 1)))
    true = np.hypot(h + radius, c)
    np.testing.assert_allclose(distance, true - radius, atol=1e-12)
    np.testing.assert_allclose(slope, (h + radius) / true, atol=1e-12)


def test_a_wall_without_curvature_is_a_plane() -> None:
    walls = LocalWalls(np.zeros((2, 3)), np.eye(3)[[2, 2]], np.eye(3)[[1, 1]], np.zeros(2))
    distance, slope = walls.offsets_and_slopes(np.full((2, 1, 3), 0.03), np.full((2, 1, 3), 0.6))
    np.testing.assert_allclose(distance, 0.03)
    np.testing.assert_allclose(slope, 0.6)
